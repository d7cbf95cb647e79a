"""What an exported controller becomes beside C99: a package of ros2_control, tables for drives, a gimbal on a wire."""

from __future__ import annotations

import ctypes
import socket
import struct
import subprocess
import threading
from pathlib import Path
from shutil import which
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Sample
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.export import odrive, simplefoc
from gimbal_pin.export.compiled import at, single
from gimbal_pin.log import Frame, Log, encode_frame, follow
from gimbal_pin.log.io.link import decode_frame, open_link
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result
from tests.exported import COMPILERS, EVERYTHING, Twin, built, compile_, has, modelled, sources
from tests.rigs import bundled

HELLO = 1
LOG = 2

pytest.importorskip("casadi")
compiled_here = pytest.mark.skipif(not has("gcc"), reason="no C compiler")
STUBS = Path(__file__).parents[1] / "ros2"


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A controller's YAML of a gimbal with two axes."""
    path = tmp_path_factory.mktemp("yaml") / "controller.yaml"
    tune(nominal(bundled("turret"))).save(path)
    return path


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """A compiled device."""
    return built(modelled(bundled("turret")), tmp_path_factory.mktemp("device"))


@pytest.mark.skipif(which("g++") is None, reason="no C++ compiler")
def test_the_plugin_gives_the_torques_of_the_c_controller(
    run: Run, controller: Path, tmp_path: Path
) -> None:
    """Compiled as C++17 against stubs of the published interface, and called as a controller manager calls it."""
    result(run, "export", controller, "--ros2", tmp_path)
    c = [name for name in sources(tmp_path) if name != "gimbal_about.c"]
    compile_(tmp_path, COMPILERS["gcc"], "-O1", "-c", *c)
    own = ["gimbal_ros2_controller.cpp", str(STUBS / "run.cpp")]
    objects = [name.replace(".c", ".o") for name in c]
    strict = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I.", f"-I{STUBS}"]
    subprocess.run([*strict, "-o", "run", *own, *objects, "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "run"], capture_output=True, text=True, check=True)
    *interfaces, last = done.stdout.splitlines()
    assert last == "200 updates equal"
    rows = ElementTree.parse(tmp_path / "gimbal.urdf").findall("ros2_control/*/*/..")
    offered = {f"{one.get('name')}/{row.get('name')}" for one in rows for row in one}
    assert set(interfaces) <= offered
    again = Rig.load(str(tmp_path / "gimbal.urdf"))
    np.testing.assert_allclose(again.phi, bundled("turret").phi, atol=1e-9)
    told = yaml.safe_load((tmp_path / "controllers.yaml").read_text())["controller_manager"]
    plugin = ElementTree.parse(tmp_path / "gimbal_plugin.xml").getroot()[0].get("name")
    assert told["ros__parameters"]["gimbal_controller"]["type"] == plugin
    assert told["ros__parameters"]["update_rate"] == 1000


# --- Tables --------------------------------------------------------------------------------------------------------


@compiled_here
def test_the_table_of_a_drive_is_the_models_torque(tmp_path: Path) -> None:
    """At any angle, turns away from zero too, within 1 % of cogging; friction added at a rate."""
    model = modelled(bundled("thesis"), EVERYTHING[:2])
    for name, text in simplefoc(model).items():
        (tmp_path / name).write_text(text)
    body = "float torque(int j, float q, float v)\n{\n    return gimbal_feed_torque(j, q, v);\n}\n"
    head = "float torque(int j, float q, float v);\n"
    (tmp_path / "table.c").write_text(f'#include "gimbal_feed_forward.h"\n{head}{body}')
    library = ("-fPIC", "-shared", "-o", "table.so", "table.c", "-lm")
    compile_(tmp_path, COMPILERS["gcc"], *library)
    torque = ctypes.CDLL(str(tmp_path / "table.so")).torque
    torque.argtypes = [ctypes.c_int, ctypes.c_float, ctypes.c_float]
    torque.restype = ctypes.c_float
    for q in np.random.default_rng(0).uniform(-20, 20, 100).tolist():
        for v in (0.0, 0.5, -0.5):
            sample = Sample(0.0, q, v, 0.0, float(np.sign(v)), 0.0)
            right = sum(float(term.torque(sample)) for term in model.by_joint[0])
            assert torque(0, q, v) == pytest.approx(right, abs=1e-3)
    assert torque(0, float("nan"), 0.0) == torque(0, 0.0, float("inf")) == 0.0


def test_an_odrives_map_counts_as_its_firmware_does() -> None:
    """The firmware takes entry mod(int(3600 turns), 3600): its middle is the model's torque there."""
    model = modelled(bundled("thesis"), EVERYTHING[:1])
    axis = odrive(model)["axes"][model.rig.joints[0]]
    (term,) = (term for term in model.by_joint[0] if not term.effect.affine)
    assert len(axis["cogging_map"]) == 3600
    for k in (0, 17, 3599):
        here = Sample(0.0, 2 * np.pi * (k + 0.5) / 3600, 0.0, 0.0, 0.0, 0.0)
        assert axis["cogging_map"][k] == pytest.approx(float(term.torque(here)), abs=1e-4)


def test_a_geared_motor_has_no_map_over_its_turn(
    run: Run, controller: Path, tmp_path: Path
) -> None:
    (tmp_path / "geared.yaml").write_text("urdf: turret\nmotors:\n  pan: {gear_ratio: 5}\n")
    words = ("export", controller, "--odrive", tmp_path / "map.json")
    refused(run(*words, "--rig", tmp_path / "geared.yaml"), 2, "geared by 5")
    refused(run("export", controller), 2, "--ros2")


# --- The link ------------------------------------------------------------------------------------------------------


@given(st.binary(max_size=600), st.integers(0, 255), st.integers(0, 65535), st.data())
def test_a_frame_comes_back_and_with_another_byte_is_none(
    body: bytes, kind: int, sequence: int, draw: st.DataObject
) -> None:
    data = bytearray(encode_frame(Frame(kind, sequence, body)))
    assert data.index(b"\0") == len(data) - 1
    del data[-1]
    assert decode_frame(bytes(data)) == Frame(kind, sequence, body)
    data[draw.draw(st.integers(0, len(data) - 1))] ^= draw.draw(st.integers(1, 255))
    assert decode_frame(bytes(data)) is None


@compiled_here
def test_the_compiled_link_asks_for_the_log_with_a_hello_alone(twin: Twin) -> None:
    """Hostile bytes, and the frames that once carried new gains, neither begin the log nor keep a HELLO from it."""
    link = ctypes.create_string_buffer(65536)
    twin.library.code.gimbal_link_start(link)
    hello = encode_frame(Frame(HELLO, 0, b""))
    others = [encode_frame(Frame(kind, 7, bytes(100))) for kind in (0, 2, 3, 4, 255)]
    flawed = [hello[:k] + b"\7" + hello[k + 1 :] for k in range(len(hello) - 1)]
    last = bytes([*hello[:-1]])
    asked = []
    for data in (*others, *flawed, b"\1" * 100000 + b"\0", last, hello[-1:]):
        size = ctypes.c_size_t(len(data))
        asked.append(twin.library.code.gimbal_link_receive(link, data, size) & 1)
    assert asked == [*[0] * (len(asked) - 1), 1]


def listen(datagrams: list[bytes]) -> list[Log]:
    """Return what is heard of a gimbal of two joints that answers a HELLO with these."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gimbal:
        gimbal.bind(("127.0.0.1", 0))

        def answer() -> None:
            _, host = gimbal.recvfrom(65536)
            for datagram in datagrams:
                gimbal.sendto(datagram, host)

        thread = threading.Thread(target=answer)
        thread.start()
        address = f"udp://127.0.0.1:{gimbal.getsockname()[1]}"
        heard = list(follow(address, bundled("turret"), idle=0.3))
        thread.join()
    return heard


@compiled_here
def test_the_log_of_the_compiled_link_is_heard_but_for_corrupted_frames(twin: Twin) -> None:
    log = prescribed(nominal(bundled("turret")), seconds=0.4)
    code = twin.library.code
    code.gimbal_link_log.restype = ctypes.c_size_t
    link = ctypes.create_string_buffer(65536)
    out = ctypes.create_string_buffer(65536)
    code.gimbal_link_start(link)
    datagrams = []
    for k in range(len(log)):
        rows = [single(x[k]) for x in (log.q, log.v, log.tau)]
        time = ctypes.c_uint64(round(1e6 * log.t[k]))
        count = code.gimbal_link_log(link, time, 0, *map(at, rows), out)
        data = bytearray(out.raw[:count])
        data[10] ^= 0x55 if k % 50 == 49 else 0
        datagrams.append(bytes(data))
    heard = listen([b"".join(datagrams[k : k + 20]) for k in range(0, len(datagrams), 20)])
    kept = np.arange(len(log)) % 50 != 49
    for name in ("t", "q", "v", "tau"):
        found = np.concatenate([getattr(each, name) for each in heard])
        np.testing.assert_allclose(found, getattr(log, name)[kept], rtol=1e-6, atol=1e-6)


def sample(k: int, lost: int = 0, stamp: int | None = None, angle: float | None = None) -> bytes:
    """Return the frame of a sample at k hundredths of a second, or at another stamp, µs."""
    time = 10_000 * k if stamp is None else stamp
    numbers = [0.001 * k if angle is None else angle, 0.002 * k, 0.1, 0.2, 0.01 * k, 0.0]
    return encode_frame(Frame(LOG, k, struct.pack("<QI6f", time, lost, *numbers)))


def angles(logs: list[Log]) -> list[int]:
    """Return the hundredths of a second of the samples of logs, by their first angle."""
    return [round(1000 * q) for log in logs for q in log.q[:, 0].tolist()]


FAR = [sample(5, stamp=2**63)] * 30


@pytest.mark.parametrize(
    "datagrams",
    [
        [sample(k) for first in range(0, 56, 7) for k in reversed(range(first, first + 7))],
        [*map(sample, range(30)), *FAR, *map(sample, range(30, 56)), sample(10), sample(55)],
        [b"\5garbage", *FAR, *map(sample, range(56))],
    ],
    ids=["overtaking", "far and repeated", "garbage and far first"],
)
def test_what_is_out_of_order_or_none_costs_no_sample(datagrams: list[bytes]) -> None:
    assert angles(listen(datagrams)) == list(range(56))


@pytest.mark.parametrize("restart", [0, 1_700_000_000_000_000])
def test_a_gimbal_that_restarts_begins_a_trajectory_of_its_own(restart: int) -> None:
    """Its samples follow those before after 1 s, whatever its clock says, and a note names the time."""
    first = range(200, 250)
    second = range(30)
    heard = listen([*map(sample, first), *(sample(k, stamp=restart + 10_000 * k) for k in second)])
    assert angles(heard) == [*first, *second]
    t = np.concatenate([log.t for log in heard])
    np.testing.assert_allclose(np.diff(t[49:]), [1.0, *[0.01] * 29], atol=1e-6)
    (said,) = [event for log in heard for event in log.events if "trajectory of its own" in event]
    assert said.startswith("3.5 s: udp://127.0.0.1:")


@pytest.mark.parametrize(("lost", "angle"), [(1, None), (0b11111, np.nan)])
def test_samples_without_encoders_are_left_out_and_said(lost: int, angle: float | None) -> None:
    flawed = [sample(k, lost, angle=angle) for k in range(20, 30)]
    heard = listen([*map(sample, range(20)), *flawed, *map(sample, range(30, 60))])
    assert angles(heard) == [*range(20), *range(30, 60)]
    assert any("encoders" in event for log in heard for event in log.events)
    with pytest.raises(LogError, match="given up its encoders"):
        listen(flawed)


@pytest.mark.parametrize(
    "address", ["udp://127.0.0.1", "udp://:1", "udp://h:99999", "serial:/dev/null", "udp:x@1"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="udp://HOST:PORT"), open_link(address):
        pass


def test_a_gimbal_that_is_not_there_is_told(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    with (
        pytest.raises(LogError, match="cannot be reached"),
        open_link(f"serial:{tmp_path}/none@115200"),
    ):
        pass
    with pytest.raises(LogError, match="no two samples"):
        listen([])
