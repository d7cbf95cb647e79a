"""What an exported controller becomes beside C99: a package of ros2_control, tables for drives, a gimbal on a wire."""

from __future__ import annotations

import ctypes
import json
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.dynamics import Sensors, nominal, simulate
from gimbal_pin.effects import Sample
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.export import odrive, simplefoc
from gimbal_pin.export.compiled import at, single
from gimbal_pin.export.tables import FRICTION_RATES, feed
from gimbal_pin.log import Frame, Log, encode_frame, follow, read_log, write_log, write_yaml
from gimbal_pin.log.io.link import decode_frame, open_link
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.command_line import Run, refused, result
from tests.exported import COMPILERS, EVERYTHING, Twin, built, compile_, has, modelled, sources
from tests.rigs import bundled

BINS = 3600
HELLO = 1
LOG = 2

pytest.importorskip("casadi")
compiled_here = pytest.mark.skipif(not has("gcc"), reason="no C compiler")
STUBS = Path(__file__).parents[1] / "ros2"


@pytest.fixture(scope="module")
def turret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A controller's YAML of a gimbal with two axes."""
    path = tmp_path_factory.mktemp("yaml") / "controller.yaml"
    write_yaml(tune(nominal(bundled("turret"))).to_dict(), path)
    return path


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """The compiled device of the loopback."""
    return built(modelled(bundled("turret"), EVERYTHING[:1]), tmp_path_factory.mktemp("device"))


# --- ros2_control --------------------------------------------------------------------------------------------------


@pytest.mark.skipif(which("g++") is None, reason="no C++ compiler")
def test_the_plugin_gives_the_torques_of_the_c_controller(
    run: Run, turret: Path, tmp_path: Path
) -> None:
    """Compiled as C++17 against stubs of the published interface, and called as a controller manager calls it."""
    out = tmp_path / "ros2"
    result(run, "export", turret, "--ros2", out)
    c = [name for name in sources(out) if name != "gimbal_about.c"]
    compile_(out, COMPILERS["gcc"], "-O1", "-c", *c)
    strict = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I.", f"-I{STUBS}"]
    own = [
        "gimbal_ros2_controller.cpp",
        str(STUBS / "run.cpp"),
        *(name.replace(".c", ".o") for name in c),
    ]
    subprocess.run([*strict, "-o", "run", *own, "-lm"], cwd=out, check=True)
    done = subprocess.run([out / "run"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    *interfaces, last = done.stdout.splitlines()
    assert last == "200 updates equal"
    robot = ElementTree.parse(out / "gimbal.urdf").getroot()
    tags = robot.find("ros2_control")
    offered = {
        f"{own.get('name')}/{row.get('name')}"
        for own in tags or ()
        for kind in ("state_interface", "command_interface")
        for row in own.findall(kind)
    }
    assert set(interfaces) <= offered
    loaded = Rig.load(str(out / "gimbal.urdf"))
    assert loaded.joints == bundled("turret").joints
    np.testing.assert_allclose(loaded.phi, bundled("turret").phi, atol=1e-9)
    package = ElementTree.parse(out / "package.xml").getroot()
    plugin = ElementTree.parse(out / "gimbal_plugin.xml").getroot()
    told = yaml.safe_load((out / "controllers.yaml").read_text())["controller_manager"][
        "ros__parameters"
    ]
    assert (
        plugin[0].get("name")
        == told["gimbal_controller"]["type"]
        == f"{package.findtext('name')}/GimbalController"
    )
    assert (
        told["update_rate"] == 1000
        and f"project({package.findtext('name')} " in (out / "CMakeLists.txt").read_text()
    )


# --- Tables --------------------------------------------------------------------------------------------------------


@compiled_here
@pytest.mark.parametrize("language", ["c", "c++"])
def test_the_table_of_a_drive_is_the_models_torque(language: str, tmp_path: Path) -> None:
    """At any angle, turns away from zero too, within 1 % of cogging; friction added at a rate."""
    model = modelled(bundled("thesis"), EVERYTHING[:2])
    for name, text in simplefoc(model).items():
        (tmp_path / name).write_text(text)
    program = '#include "gimbal_feed_forward.h"\nfloat torque(int j, float q, float v);\n'
    body = "float torque(int j, float q, float v)\n{\n    return gimbal_feed_torque(j, q, v);\n}\n"
    head = 'extern "C" {\n' + program + "}\n" if language == "c++" else program
    (tmp_path / f"table.{language}").write_text(
        head.replace("extern", "#include <math.h>\nextern", 1) + body
    )
    flags = ["-std=c99"] if language == "c" else ["-std=c++17"]
    command = [
        "gcc",
        "-x",
        language,
        *flags,
        "-Wall",
        "-Wextra",
        "-Werror",
        "-pedantic",
        "-fPIC",
        "-shared",
    ]
    subprocess.run(
        [*command, "-o", "table.so", f"table.{language}", "-lm"], cwd=tmp_path, check=True
    )
    torque = ctypes.CDLL(str(tmp_path / "table.so")).torque
    torque.argtypes = [ctypes.c_int, ctypes.c_float, ctypes.c_float]
    torque.restype = ctypes.c_float
    terms = model.by_joint[0]
    for q in np.random.default_rng(0).uniform(-20, 20, 300).tolist():
        for v in (0.0, 0.5, -0.5):
            sample = Sample(0.0, q, v, 0.0, float(np.sign(v)), 0.0)
            assert torque(0, q, v) == pytest.approx(
                sum(float(term.torque(sample)) for term in terms), abs=1e-3
            )
    assert torque(0, float("nan"), 0.0) == torque(0, 0.0, float("inf")) == 0.0


def test_an_odrives_map_counts_as_its_firmware_does() -> None:
    """The firmware takes entry mod(int(3600 turns), 3600): its middle is the model's torque there."""
    model = modelled(bundled("thesis"), EVERYTHING[:1])
    axis = odrive(model)["axes"][model.rig.joints[0]]
    (term,) = (term for term in model.by_joint[0] if not term.effect.affine)
    for k in (0, 17, BINS - 1):
        here = Sample(0.0, 2 * np.pi * (k + 0.5) / BINS, 0.0, 0.0, 0.0, 0.0)
        assert axis["cogging_map"][k] == pytest.approx(float(term.torque(here)), abs=1e-4)
    still = feed(model.by_joint[1], 64)
    assert (
        not still.angle.any()
        and still.forward[1] == -still.backward[1] > 0
        and len(still.forward) == len(FRICTION_RATES)
    )


def test_a_geared_motor_has_no_map_over_its_turn(run: Run, turret: Path, tmp_path: Path) -> None:
    (tmp_path / "geared.yaml").write_text("urdf: turret\nmotors:\n  pan: {gear_ratio: 5}\n")
    words = ("export", turret, "--rig", tmp_path / "geared.yaml", "--odrive", tmp_path / "map.json")
    refused(run(*words), 2, "geared by 5")
    refused(run("export", turret), 2, "--ros2")
    result(
        run, "export", turret, "--odrive", tmp_path / "map.json", "--simplefoc", tmp_path / "foc"
    )
    assert (
        len(json.loads((tmp_path / "map.json").read_text())["axes"]["pan"]["cogging_map"]) == BINS
    )


# --- The link ------------------------------------------------------------------------------------------------------


@given(st.binary(max_size=600), st.integers(0, 255), st.integers(0, 65535))
def test_a_frame_comes_back(body: bytes, kind: int, sequence: int) -> None:
    data = encode_frame(Frame(kind, sequence, body))
    assert data.count(b"\0") == 1 and data.endswith(b"\0")
    assert decode_frame(data[:-1]) == Frame(kind, sequence, body)


@given(st.binary(max_size=60), st.data())
def test_a_frame_with_another_byte_is_none(body: bytes, draw: st.DataObject) -> None:
    data = bytearray(encode_frame(Frame(LOG, 1, body))[:-1])
    place = draw.draw(st.integers(0, len(data) - 1))
    data[place] ^= draw.draw(st.integers(1, 255))
    assert decode_frame(bytes(data)) is None
    assert decode_frame(draw.draw(st.binary(max_size=40))) is None


class Device:
    """The compiled link on a UDP socket of this machine: it streams a log."""

    def __init__(self, twin: Twin, log: Log | None) -> None:
        """Take the log."""
        self.code = twin.library.code
        self.log = log
        self.code.gimbal_link_log.restype = ctypes.c_size_t
        self.code.gimbal_link_receive.restype = ctypes.c_bool
        self.link = ctypes.create_string_buffer(65536)
        self.out = ctypes.create_string_buffer(65536)
        self.code.gimbal_link_start(self.link)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.002)
        self.ended, self.sent = False, 0

    def step(self) -> None:
        """Take bytes that came, and send some samples."""
        try:
            data, host = self.socket.recvfrom(65536)
        except TimeoutError:
            data, host = b"", None
        self.receive(data)
        if host is not None:
            self.host = host
        if hasattr(self, "host"):
            rows = range(self.sent, min(self.sent + 20, 0 if self.log is None else len(self.log)))
            if datagram := b"".join(map(self.row, rows)):
                self.socket.sendto(datagram, self.host)
            self.sent += len(rows)

    def receive(self, data: bytes) -> bool:
        """Give bytes to the compiled link."""
        return bool(self.code.gimbal_link_receive(self.link, data, ctypes.c_size_t(len(data))))

    def row(self, k: int) -> bytes:
        """Return a row of the log as a frame; every 50th is corrupted on its way."""
        log = self.log
        assert log is not None and log.v is not None and log.tau is not None
        rows = [single(x[k]) for x in (log.q, log.v, log.tau)]
        time = ctypes.c_uint64(round(1e6 * log.t[k]))
        count = self.code.gimbal_link_log(self.link, time, 0, *map(at, rows), self.out)
        data = bytearray(self.out.raw[:count])
        data[10] ^= 0x55 if k % 50 == 49 else 0
        return bytes(data)

    @contextmanager
    def running(self) -> Iterator[str]:
        """Run beside the test, and give the address."""

        def loop() -> None:
            while not self.ended:
                self.step()

        thread = threading.Thread(target=loop)
        thread.start()
        try:
            yield f"udp://127.0.0.1:{self.socket.getsockname()[1]}"
        finally:
            self.ended = True
            thread.join()
            self.socket.close()


@pytest.fixture(scope="module")
def moved(twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """A log of the simulated turret as the compiled controller moves it."""
    rig = twin.stored.model.rig
    path = tmp_path_factory.mktemp("log") / "log.csv"
    motion = fourier(rig, 0, 8.0, twin.law.dt)
    sensors = Sensors.of(rig, twin.law.dt, torque_std=0.02)
    write_log(
        simulate(nominal(rig), twin.law, motion, rng=np.random.default_rng(0), sensors=sensors),
        path,
    )
    return read_log(path, rig)


@compiled_here
def test_a_running_gimbal_is_identified(run: Run, twin: Twin, moved: Log, tmp_path: Path) -> None:
    """The log that comes over UDP identifies what the file does, but for the corrupted frames, which are missing."""
    device = Device(twin, moved)
    with device.running() as address:
        heard = list(follow(address, bundled("turret"), idle=0.7))
    t = np.concatenate([log.t for log in heard])
    kept = np.setdiff1d(np.arange(len(moved)), np.arange(49, len(moved), 50))
    np.testing.assert_allclose(t, np.round(moved.t[kept], 6), atol=1e-9)
    np.testing.assert_allclose(
        np.concatenate([log.tau for log in heard]), moved.tau[kept], rtol=1e-6, atol=1e-9
    )
    device = Device(twin, moved)
    path = tmp_path / "found.json"
    with device.running() as address:
        code, _, err = run("identify", "turret", address, "--follow", "--idle", 0.7, "--json", path)
    assert code == 0, err
    whole = result(run, "identify", "turret", moved.name)["base_parameters"]
    for row, right in zip(json.loads(path.read_text())["base_parameters"], whole, strict=True):
        assert (
            row["name"] == right["name"] and abs(row["value"] - right["value"]) < 4 * right["std"]
        ), row


@compiled_here
def test_the_link_asks_for_the_log_with_a_hello_alone(twin: Twin) -> None:
    """Hostile bytes, and the frames that once carried new gains, neither begin the log nor keep a HELLO from it."""
    device = Device(twin, None)
    rng = np.random.default_rng(0)
    hello = encode_frame(Frame(HELLO, 0, b""))
    for kind in (0, 2, 3, 4, 255):
        assert not device.receive(encode_frame(Frame(kind, 7, rng.bytes(int(rng.integers(400))))))
    for _ in range(1000):
        bad = bytearray(hello)
        bad[rng.integers(len(bad) - 1)] ^= int(rng.integers(1, 256))
        assert not device.receive(bytes(bad[: rng.integers(1, len(bad))]) + b"\0")
        device.receive(rng.bytes(int(rng.integers(1, 400))))
    assert not device.receive(b"\1" * 100000 + b"\0")
    assert [device.receive(bytes([byte])) for byte in hello] == [*[False] * (len(hello) - 1), True]
    device.socket.close()


def sent(datagrams: list[bytes]) -> list[Log]:
    """Return what is heard of a gimbal of two joints that answers a HELLO with these."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gimbal:
        gimbal.bind(("127.0.0.1", 0))

        def answer() -> None:
            _, host = gimbal.recvfrom(65536)
            for datagram in datagrams:
                gimbal.sendto(datagram, host)

        thread = threading.Thread(target=answer)
        thread.start()
        heard = list(
            follow(f"udp://127.0.0.1:{gimbal.getsockname()[1]}", bundled("turret"), idle=0.3)
        )
        thread.join()
    return heard


def sample(k: int, lost: int = 0, stamp: int | None = None, values: float | None = None) -> bytes:
    """The frame of a sample at k hundredths of a second, or at another stamp, µs."""
    numbers = [0.001 * k, 0.002 * k, 0.1, 0.2, 0.01 * k, 0.0] if values is None else [values] * 6
    return encode_frame(
        Frame(LOG, k, struct.pack("<QI6f", 10_000 * k if stamp is None else stamp, lost, *numbers))
    )


def angles(logs: list[Log]) -> list[int]:
    """Return the hundredths of a second of the samples of logs, by their first angle."""
    return [round(1000 * q) for log in logs for q in log.q[:, 0].tolist()]


@pytest.mark.parametrize("block", [2, 7, 20])
def test_samples_that_overtake_each_other_stand_in_order(block: int) -> None:
    order = [
        k for first in range(0, 60, block) for k in reversed(range(first, min(first + block, 60)))
    ]
    heard = sent([sample(k) for k in (*order, 10, 59)])
    assert angles(heard) == list(range(60)) and not [event for log in heard for event in log.events]


@pytest.mark.parametrize("stamp", [10**12, 2**63, 2**64 - 1, 0])
@pytest.mark.parametrize("count", [1, 30])
def test_a_far_stamp_that_nothing_continues_is_left_out(stamp: int, count: int) -> None:
    first = range(200, 230)
    second = range(230, 260)
    far = [sample(5, stamp=stamp)] * count
    heard = sent([*map(sample, first), *far, *map(sample, second)])
    assert angles(heard) == [*first, *second]
    assert angles(sent([*far, *map(sample, first)])) == [*first]


@pytest.mark.parametrize(
    "restart", [0, 10**9, 1_700_000_000_000_000], ids=["restart", "later", "clock set"]
)
def test_a_gimbal_that_restarts_begins_a_trajectory_of_its_own(restart: int) -> None:
    """Its samples follow those before after 1 s, whatever its clock says, and a note names the time."""
    first = range(200, 250)
    second = range(30)
    heard = sent([*map(sample, first), *(sample(k, stamp=restart + 10_000 * k) for k in second)])
    t = np.concatenate([log.t for log in heard])
    assert angles(heard) == [*first, *second]
    np.testing.assert_allclose(t[:50], 0.01 * np.array(first), atol=1e-6)
    np.testing.assert_allclose(np.diff(t[49:]), [1.0, *[0.01] * 29], atol=1e-6)
    (said,) = [event for log in heard for event in log.events if "trajectory of its own" in event]
    assert said.startswith("3.5 s: udp://127.0.0.1:")


@pytest.mark.parametrize(
    ("lost", "values"),
    [(1, None), (0b11111, None), (0b11111, np.nan), (0, np.nan)],
    ids=["q", "all", "nan", "x"],
)
def test_samples_without_encoders_are_left_out_and_said(lost: int, values: float | None) -> None:
    """Without its gyros alone the angles are still measured: those samples stay."""
    heard = sent(
        [
            sample(k, lost if 20 <= k < 30 else 0, values=values if 20 <= k < 30 else None)
            for k in range(60)
        ]
    )
    assert angles(heard) == [*range(20), *range(30, 60)]
    (said,) = [event for log in heard for event in log.events if "encoders" in event]
    assert said.startswith("0.2 s: udp://127.0.0.1:")
    assert angles(sent([sample(k, 0b11110) for k in range(20)])) == [*range(20)]
    with pytest.raises(LogError, match="given up its encoders"):
        sent([sample(k, lost, values=values) for k in range(60)])


def test_a_datagram_that_is_no_frame_swallows_no_other() -> None:
    heard = sent([part for k in range(20) for part in (b"\5garbage", sample(k))])
    assert angles(heard) == [*range(20)]


def test_a_pipe_without_an_end_of_a_line_is_refused(run: Run) -> None:
    with Path("/dev/zero").open("rb") as zeros:
        refused(run("identify", "turret", f"/dev/fd/{zeros.fileno()}", "--follow"), 2, "is binary")


@pytest.mark.parametrize(
    "address", ["udp://127.0.0.1", "udp://:1", "udp://h:99999", "serial:/dev/null", "udp:x@1"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="udp://HOST:PORT"), open_link(address):
        pass


def test_a_gimbal_that_is_not_there_is_told(run: Run, turret: Path, tmp_path: Path) -> None:
    pytest.importorskip("serial")
    with (
        pytest.raises(LogError, match="cannot be reached"),
        open_link(f"serial:{tmp_path}/none@115200"),
    ):
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"udp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(LogError, match="no two samples"):
            list(follow(address, bundled("turret"), idle=0.2))
