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

from gimbal_pin import export_controller
from gimbal_pin.control import stored as read
from gimbal_pin.control import tune
from gimbal_pin.dynamics import Reference, Sensors, nominal, simulate
from gimbal_pin.effects import Sample
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.export import odrive, simplefoc
from gimbal_pin.export.compiled import at, single
from gimbal_pin.export.tables import FRICTION_RATES, feed
from gimbal_pin.log import Frame, Log, encode_frame, follow, read_log, write_log, write_yaml
from gimbal_pin.log.io.link import compute_siphash, decode_frame, open_link, seal_frame
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.command_line import Run, refused, result
from tests.exported import COMPILERS, EVERYTHING, Twin, built, compile_, has, modelled, sources
from tests.rigs import bundled

BINS = 3600
HELLO = 1
LOG = 2
TUNE = 3

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
def test_the_plugin_gives_the_torques_of_the_c_controller(run: Run, turret: Path, tmp_path: Path) -> None:
    """Compiled as C++17 against stubs of the published interface, and called as a controller manager calls it."""
    out = tmp_path / "ros2"
    result(run, "export", turret, "--ros2", out)
    c = [name for name in sources(out) if name != "gimbal_about.c"]
    compile_(out, COMPILERS["gcc"], "-O1", "-c", *c)
    strict = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I.", f"-I{STUBS}"]
    own = ["gimbal_ros2_controller.cpp", str(STUBS / "run.cpp"), *(name.replace(".c", ".o") for name in c)]
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
    told = yaml.safe_load((out / "controllers.yaml").read_text())["controller_manager"]["ros__parameters"]
    assert plugin[0].get("name") == told["gimbal_controller"]["type"] == f"{package.findtext('name')}/GimbalController"
    assert (
        told["update_rate"] == 1000 and f"project({package.findtext('name')} " in (out / "CMakeLists.txt").read_text()
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
    (tmp_path / f"table.{language}").write_text(head.replace("extern", "#include <math.h>\nextern", 1) + body)
    flags = ["-std=c99"] if language == "c" else ["-std=c++17"]
    command = ["gcc", "-x", language, *flags, "-Wall", "-Wextra", "-Werror", "-pedantic", "-fPIC", "-shared"]
    subprocess.run([*command, "-o", "table.so", f"table.{language}", "-lm"], cwd=tmp_path, check=True)
    torque = ctypes.CDLL(str(tmp_path / "table.so")).torque
    torque.argtypes, torque.restype = [ctypes.c_int, ctypes.c_float, ctypes.c_float], ctypes.c_float
    terms = model.by_joint[0]
    for q in np.random.default_rng(0).uniform(-20, 20, 300).tolist():
        for v in (0.0, 0.5, -0.5):
            sample = Sample(0.0, q, v, 0.0, float(np.sign(v)), 0.0)
            assert torque(0, q, v) == pytest.approx(sum(float(term.torque(sample)) for term in terms), abs=1e-3)
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
    result(run, "export", turret, "--odrive", tmp_path / "map.json", "--simplefoc", tmp_path / "foc")
    assert len(json.loads((tmp_path / "map.json").read_text())["axes"]["pan"]["cogging_map"]) == BINS


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


SECRET = bytes(range(1, 17))
PAPER = bytes(range(16))
"""Key of the test vectors of SipHash's paper (15 bytes) and reference code: the first n of the bytes 0, 1, 2, …"""


@pytest.mark.parametrize(
    ("count", "tag"),
    [
        (0, "310e0edd47db6f72"),
        (1, "fd67dc93c539f874"),
        (7, "37d1018bf50002ab"),
        (8, "6224939a79f5f593"),
        (15, "e545be4961ca29a1"),
        (63, "724506eb4c328a95"),
    ],
)
def test_a_tag_is_that_of_siphashs_authors(count: int, tag: str) -> None:
    assert compute_siphash(PAPER, bytes(range(count))).hex() == tag


def tuning(count: int, body: bytes, sequence: int = 7, secret: bytes = SECRET) -> bytes:
    """A TUNE as a host with a secret sends it."""
    return encode_frame(seal_frame(Frame(TUNE, sequence, body), secret, count))


class Device:
    """The compiled controller and its link on a UDP socket of this machine: it streams a log, and is tuned."""

    def __init__(self, twin: Twin, log: Log | None, secret: bytes | None = SECRET, count: int = 0) -> None:
        """Take what it streams, its secret and the last count that it stored, and parameters of its own."""
        self.code, self.n, self.log = twin.library.code, twin.library.n, log
        code = self.code
        for name in ("log", "answer"):
            getattr(code, f"gimbal_link_{name}").restype = ctypes.c_size_t
        code.gimbal_link_receive.restype = code.gimbal_link_apply.restype = ctypes.c_bool
        about = export_controller(twin.stored)
        size = int(
            subprocess.run([twin.folder / "sizes"], capture_output=True, check=True, text=True).stdout.split()[0]
        )
        self.link = ctypes.create_string_buffer(65536)
        self.p = ctypes.create_string_buffer(ctypes.string_at(twin.library.parameters, size), size)
        self.tuning, self.out = about.tuning, ctypes.create_string_buffer(65536)
        code.gimbal_link_start(self.link, secret, ctypes.c_uint64(count))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.002)
        self.ended, self.sent, self.applied = False, 0, 0

    def step(self) -> None:
        """Hear what came, apply it between two steps, and send."""
        try:
            data, host = self.socket.recvfrom(65536)
        except TimeoutError:
            data, host = b"", None
        self.receive(data)
        if host is not None:
            self.host = host
        self.applied += self.applied_now()
        if hasattr(self, "host"):
            if count := self.code.gimbal_link_answer(self.link, self.out):
                self.socket.sendto(self.out.raw[:count], self.host)
            rows = range(self.sent, min(self.sent + 20, 0 if self.log is None else len(self.log)))
            if datagram := b"".join(map(self.row, rows)):
                self.socket.sendto(datagram, self.host)
            self.sent += len(rows)

    def receive(self, data: bytes) -> bool:
        """Give bytes to the compiled link."""
        return bool(self.code.gimbal_link_receive(self.link, self.p, data, ctypes.c_size_t(len(data))))

    def applied_now(self) -> bool:
        """Let the compiled link change the parameters."""
        return bool(self.code.gimbal_link_apply(self.link, self.p))

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

    def answer(self) -> tuple[int, int] | None:
        """Return sequence and status of the answer that is due."""
        count = self.code.gimbal_link_answer(self.link, self.out)
        frame = decode_frame(self.out.raw[: count - 1]) if count else None
        assert frame is None or frame.type == 4
        return None if frame is None else struct.unpack("<HH", frame.body)  # type: ignore[return-value]

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
def sized(twin: Twin) -> Twin:
    """With a program that tells the size of the parameters."""
    program = '#include <stdio.h>\n#include "gimbal_controller.h"\nint main(void)\n{\n'
    (twin.folder / "sizes.c").write_text(
        program + '    printf("%zu", sizeof(struct gimbal_parameters));\n    return 0;\n}\n'
    )
    compile_(twin.folder, COMPILERS["gcc"], "-o", "sizes", "sizes.c")
    return twin


@pytest.fixture(scope="module")
def moved(twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """A log of the simulated turret as the compiled controller moves it."""
    rig, path = twin.stored.model.rig, tmp_path_factory.mktemp("log") / "log.csv"
    motion, sensors = fourier(rig, 0, 8.0, twin.law.dt), Sensors.of(rig, twin.law.dt, torque_std=0.02)
    write_log(simulate(nominal(rig), twin.law, motion, rng=np.random.default_rng(0), sensors=sensors), path)
    return read_log(path, rig)


@compiled_here
def test_a_running_gimbal_is_identified_and_tuned(run: Run, sized: Twin, moved: Log, tmp_path: Path) -> None:
    """The log that comes over UDP identifies what the file does, but for the corrupted frames, which are missing."""
    device = Device(sized, moved)
    with device.running() as address:
        heard = list(follow(address, bundled("turret"), idle=0.7))
    t = np.concatenate([log.t for log in heard])
    kept = np.setdiff1d(np.arange(len(moved)), np.arange(49, len(moved), 50))
    np.testing.assert_allclose(t, np.round(moved.t[kept], 6), atol=1e-9)
    np.testing.assert_allclose(np.concatenate([log.tau for log in heard]), moved.tau[kept], rtol=1e-6, atol=1e-9)
    device, path = Device(sized, moved), tmp_path / "found.json"
    with device.running() as address:
        code, _, err = run("identify", "turret", address, "--follow", "--idle", 0.7, "--json", path)
    assert code == 0, err
    whole = result(run, "identify", "turret", moved.name)["base_parameters"]
    for row, right in zip(json.loads(path.read_text())["base_parameters"], whole, strict=True):
        assert row["name"] == right["name"] and abs(row["value"] - right["value"]) < 4 * right["std"], row


@compiled_here
def test_new_gains_are_taken_between_two_steps(run: Run, sized: Twin, tmp_path: Path) -> None:
    """And the torque is then that of a controller that was exported with them."""
    stored = sized.stored
    softer = tune(stored.model, kind=stored.wish.kind).to_dict()
    for gains in softer["joints"].values():
        for key in ("kp", "ki", "kd"):
            gains[key] *= 0.5
    write_yaml(softer, tmp_path / "softer.yaml")
    key = tmp_path / "gimbal.key"
    key.write_text(SECRET.hex() + "\n")
    wanted = read(softer, stored.model.rig, "here")
    device, n = Device(sized, None), sized.library.n
    with device.running() as address:
        code, out, err = run("export", tmp_path / "softer.yaml", "--live", address, "--secret", key)
        assert code == 0 and "in force" in out, err
    assert device.applied >= 1
    rng = np.random.default_rng(0)
    q, v = rng.normal(0, 0.3, n), rng.normal(0, 0.1, n)
    aim = Reference(q + 1e-3, v, np.zeros(n))
    right, _ = wanted.law.torque(0.0, q, v, aim, wanted.law.start())
    tau, memory = np.empty(n, np.float32), ctypes.create_string_buffer(sized.library.code.gimbal_tracking_size())
    device.code.gimbal_tracking_start(memory)
    given = [single(q), single(v), single(aim.q, aim.v, aim.a)]
    device.code.gimbal_tracking_step(device.p, memory, ctypes.c_float(0.0), *map(at, given), at(tau))
    old, _ = stored.law.torque(0.0, q, v, aim, stored.law.start())
    np.testing.assert_allclose(tau, right, atol=2e-5 * float(stored.model.tau_max.max()))
    assert np.abs(right - old).max() > 1e-3


@compiled_here
def test_a_hostile_frame_changes_nothing(sized: Twin) -> None:
    """Gains that are no number, negative, unstable, too fast for the delay, or terms beyond the limit; other sizes."""
    device, n = Device(sized, None), sized.library.n
    before, own = device.p.raw, np.frombuffer(device.tuning[4:], "<f4")
    kp, _, kd = own[:3]
    hostile = [(0, np.nan), (0, -1.0), (1, 2 * kp * kd), (2, 1e9), (0, np.inf), (6 * n, 1e6), (3 * n + 1, -5.0)]
    for sequence, (place, value) in enumerate(hostile):
        values = own.copy()
        values[place] = value
        assert device.receive(tuning(1 + sequence, device.tuning[:4] + values.tobytes(), sequence))
        assert not device.applied_now() and device.answer() == (sequence, 2), (place, value)
    for k, body in enumerate((b"", device.tuning[:-1], device.tuning + b"\0", b"\7\0" + device.tuning[2:])):
        device.receive(tuning(10 + k, body, 99))
        assert not device.applied_now() and device.answer() == (99, 1)
    good = tuning(20, device.tuning)
    rng = np.random.default_rng(0)
    for _ in range(3000):
        bad = bytearray(good)
        bad[rng.integers(len(bad) - 1)] ^= int(rng.integers(1, 256))
        device.receive(bytes(bad[: rng.integers(1, len(bad))]) + b"\0")
        device.receive(rng.bytes(int(rng.integers(1, 400))))
        assert not device.applied_now() and device.answer() is None
    device.receive(b"\1" * 100000 + b"\0")
    assert device.p.raw == before
    for byte in good:  # and its own values pass, byte by byte
        device.receive(bytes([byte]))
    assert device.applied_now() and device.answer() == (7, 0)
    device.receive(encode_frame(Frame(HELLO, 0, b"")))
    device.socket.close()


@compiled_here
def test_only_who_has_the_secret_tunes_and_each_frame_once(sized: Twin) -> None:
    """No tag, another secret, a changed byte under a right CRC, an old count, a gimbal without a secret."""
    device = Device(sized, None)
    other, body = bytes(16), device.tuning
    right = decode_frame(tuning(5, body)[:-1])
    assert right is not None
    forged = [Frame(TUNE, 7, body), Frame(TUNE, 7, b""), Frame(TUNE, 8, right.body)]
    for place in (4, -9, -1):
        changed = bytearray(right.body)
        changed[place] ^= 1
        forged.append(right._replace(body=bytes(changed)))
    for frame in forged:
        assert not device.receive(encode_frame(frame)) and not device.applied_now()
        assert device.answer() == (frame.sequence, 3), frame
    assert not device.receive(tuning(6, body, secret=other)) and device.answer() == (7, 3)
    assert device.receive(encode_frame(right)) and device.applied_now() and device.answer() == (7, 0)
    assert not device.receive(encode_frame(right)) and device.answer() is None
    assert not device.receive(tuning(4, body)) and not device.applied_now() and device.answer() == (7, 4)
    assert device.receive(tuning(6, body)) and device.applied_now() and device.answer() == (7, 0)
    device.socket.close()
    for secret in (None, other):
        without = Device(sized, None, secret)
        assert not without.receive(tuning(9, body, secret=other)) and not without.applied_now()
        assert without.answer() == (7, 3)
        without.socket.close()
    again = Device(sized, None, count=6)
    assert not again.receive(tuning(6, body)) and not again.applied_now() and again.answer() is None
    again.socket.close()


@compiled_here
@given(key=st.binary(min_size=16, max_size=16), data=st.binary(max_size=300))
def test_both_ends_make_the_same_tag(sized: Twin, key: bytes, data: bytes) -> None:
    tag = sized.library.code.gimbal_link_tag
    tag.restype = ctypes.c_uint64
    assert tag(key, data, ctypes.c_size_t(len(data))) == int.from_bytes(compute_siphash(key, data), "little")


def test_gains_are_sent_with_a_secret_alone(run: Run, turret: Path, tmp_path: Path) -> None:
    """Refused before anything is sent, or worked on; the secret itself is in no message."""
    key, live = tmp_path / "gimbal.key", ("--live", "udp://127.0.0.1:9")
    refused(run("export", turret, *live), 2, "--live", "--secret FILE")
    refused(run("export", turret, "--secret", key, "--c", tmp_path / "c"), 2, "--secret", "--live ADDRESS")
    for text in ("", "0" * 32, "1234", "g" * 32, "1" * 64):
        key.write_text(text)
        said = run("export", turret, *live, "--secret", key)
        refused(said, 2, "gimbal.key", "is no secret of 32 hexadecimal digits", "openssl rand -hex 16")
        assert not text or text not in said[2]


@compiled_here
@pytest.mark.parametrize(
    ("secret", "count", "said"),
    [(PAPER, 0, "another secret"), (None, 0, "or none"), (SECRET, 2**63, "clock")],
    ids=["another", "none", "stale"],
)
def test_a_gimbal_that_refuses_a_host_says_why(
    run: Run, turret: Path, sized: Twin, tmp_path: Path, secret: bytes | None, count: int, said: str
) -> None:
    key, device = tmp_path / "gimbal.key", Device(sized, None, secret, count)
    key.write_text(SECRET.hex())
    with device.running() as address:
        refused(run("export", turret, "--live", address, "--secret", key), 2, said)
    assert device.applied == 0


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
        heard = list(follow(f"udp://127.0.0.1:{gimbal.getsockname()[1]}", bundled("turret"), idle=0.5))
        thread.join()
    return heard


def sample(k: int) -> bytes:
    """The frame of a sample at k hundredths of a second."""
    return encode_frame(Frame(LOG, k, struct.pack("<QI6f", 10_000 * k, 0, *(0.01 * k * np.arange(1, 7)))))


def test_a_gimbal_that_begins_anew_is_heard_and_said() -> None:
    """Its stamps start at 0 again: the samples are a trajectory of their own. One that is overtaken is left out."""
    first, second = [*range(200, 250), 260, 255], range(30)
    heard = sent([sample(k) for k in (*first, *second)])
    t, q = np.concatenate([log.t for log in heard]), np.concatenate([log.q[:, 0] for log in heard])
    kept = [*first[:-1], *second]
    np.testing.assert_allclose(q, 0.01 * np.array(kept), atol=1e-6)
    np.testing.assert_allclose(t[:51], 0.01 * np.array(kept[:51]), atol=1e-6)
    np.testing.assert_allclose(np.diff(t[50:]), [1.0, *[0.01] * 29], atol=1e-6)
    said = [event for log in heard for event in log.events if "began anew" in event]
    assert len(said) == 1 and said[0].startswith("3.6 s: udp://127.0.0.1:")


def test_a_datagram_that_is_no_frame_swallows_no_other() -> None:
    heard = sent([part for k in range(20) for part in (b"\5garbage", sample(k))])
    assert np.concatenate([log.q[:, 0] for log in heard]) == pytest.approx(0.01 * np.arange(20), abs=1e-6)


def test_a_pipe_without_an_end_of_a_line_is_refused(run: Run) -> None:
    with Path("/dev/zero").open("rb") as zeros:
        refused(run("identify", "turret", f"/dev/fd/{zeros.fileno()}", "--follow"), 2, "is binary")


@pytest.mark.parametrize("address", ["udp://127.0.0.1", "udp://:1", "udp://h:99999", "serial:/dev/null", "udp:x@1"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="udp://HOST:PORT"), open_link(address):
        pass


def test_a_gimbal_that_is_not_there_is_told(run: Run, turret: Path, tmp_path: Path) -> None:
    pytest.importorskip("serial")
    with pytest.raises(LogError, match="cannot be reached"), open_link(f"serial:{tmp_path}/none@115200"):
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"udp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(LogError, match="no sample"):
            list(follow(address, bundled("turret"), idle=0.2))
