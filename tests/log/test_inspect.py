"""`inspect`: what is planted in a log's columns is found, and the mapping proposed reads the log."""

from __future__ import annotations

import struct
from math import pi
from pathlib import Path

import numpy as np
import pytest
from real_data.cases import CAMERA, measured
from real_data.proposed import differing, is_unknown, singles

from gimbal_pin.log import Inspected, Log, inspect, log_columns, parse_expression, read_log
from gimbal_pin.rig import Rig
from tests.command_line import Run, refused, result
from tests.log.planted import TURRET, agree, held, planted, write_csv
from tests.log.writers import Columns, as_candump
from tests.rigs import spelled

DATA = Path(__file__).parents[3] / "shared" / "data"
T = np.arange(0, 10, 0.004)
LOG = planted(T)
V = held(LOG.v)
TAU = held(LOG.tau)
CONSTANTS = np.array([motor.torque_constant for motor in TURRET.motors])


def found_in(columns: Columns, folder: Path) -> Inspected:
    """Return what is found in a file of columns."""
    return inspect(write_csv(columns, folder / "log.csv"), TURRET)


def read_proposed(path: Path, rig: Rig = TURRET, need_tau: bool = True) -> Log:
    """Return the log of a file by the mapping that is proposed."""
    (path.parent / "map.yaml").write_text(inspect(path, rig).yaml, encoding="utf-8")
    return read_log(path, rig, path.parent / "map.yaml", need_tau=need_tau)


def each_joint(names: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return a column of each joint, named after it or numbered from one."""
    return {names.format(j=joint, k=k + 1): values[:, k] for k, joint in enumerate(TURRET.joints)}


@pytest.mark.parametrize(
    ("column", "target", "unit", "factor"),
    [
        ("Iq_{j}_mA", "tau", "mA", 1e-3 * CONSTANTS[0]),
        ("tau_{j} [A]", "tau", "A", CONSTANTS[0]),
        ("current_{j}", "tau", "A", CONSTANTS[0]),
        ("current_{j}", "tau", "mA", 1e-3 * CONSTANTS[0]),
        ("tau_{j}_Ncm", "tau", "N cm", 1e-2),
        ("vel_{j}_mrad/s", "dq", "mrad/s", 1e-3),
        ("rate_{j}_rpm", "dq", "rpm", pi / 30),
        ("vel {j} [Hz]", "dq", "turns/s", 2 * pi),
        ("rate_{j} (°/s)", "dq", "deg/s", pi / 180),
        ("Winkel {j} [°]", "q", "deg", pi / 180),
    ],
)
def test_the_unit_in_a_name_is_read_in_full_and_a_currents_found_by_its_size(
    column: str, target: str, unit: str, factor: float, tmp_path: Path
) -> None:
    values = {"q": LOG.q, "dq": V, "tau": TAU}[target]
    found = found_in({"t": T, **each_joint(column, values / factor)}, tmp_path)
    name, text, _ = found.mapping[f"{target}_pan"]
    assert name == column.format(j="pan")
    assert parse_expression(f"x*{text or 1}", "").factor == pytest.approx(factor)
    assert [channel.unit for channel in found.streams[0].channels[1:]] == [unit, unit]


@pytest.mark.parametrize(("turn", "unit"), [(2 * pi, "rad"), (360.0, "deg")])
def test_a_step_that_parts_a_turn_tells_degrees_from_radians(
    turn: float, unit: str, tmp_path: Path
) -> None:
    angles = turn / 2**14 * np.round(520 * LOG.q)
    found = found_in({"t": T, **each_joint("pos{k}", angles)}, tmp_path)
    assert [channel.unit for channel in found.streams[0].channels[1:]] == [unit, unit]


@pytest.mark.parametrize(
    ("names", "angle", "rate", "clock", "second"),
    [
        (("pos_{j}", "vel_{j}", "tau_{j}"), 1.0, 1.0, "time_ms", 1e3),
        (("Angle{k}", "Speed{k}", "MotorTorque{k}"), pi / 180, pi / 30, "timestamp", 1e9),
        (("q_{j}_turns", "dq_{j}", "tau_{j}"), 2 * pi, 1.0, "stamp_us", 1e6),
        (("{j}_deg", "{j}_deg_s", "{j}_nm"), pi / 180, pi / 180, "t", 1.0),
    ],
)
def test_the_mapping_that_is_proposed_reads_the_log_whatever_the_order_of_its_columns(
    names: tuple[str, str, str],
    angle: float,
    rate: float,
    clock: str,
    second: float,
    tmp_path: Path,
) -> None:
    columns = {clock: second * T, **each_joint(names[0], LOG.q / angle)}
    columns |= {**each_joint(names[1], V / rate), **each_joint(names[2], TAU)}
    found = found_in(columns, tmp_path)
    agree(read_proposed(tmp_path / "log.csv"), LOG)
    turned = found_in(dict(reversed(columns.items())), tmp_path)
    assert dict(turned.mapping) == dict(found.mapping)


def test_a_rate_of_the_other_sign_or_of_an_unknown_unit_is_turned_into_its_angles(
    tmp_path: Path,
) -> None:
    columns = {"t": T, **each_joint("pos{k}", LOG.q), **each_joint("vel{k}", V / [-1.0, 0.0042])}
    found = found_in(columns, tmp_path)
    assert found.mapping["dq_pan"][:2] == ("vel1", "-")
    assert "# tau_pan: COLUMN*FACTOR" in found.yaml
    assert float(found.mapping["dq_tilt"][1]) == pytest.approx(0.0042, rel=1e-3)


@pytest.mark.parametrize(
    ("names", "target", "factor"),
    [
        ("sensor_combined.gyro_rad[{k}]", "gyro_base_{a}", ""),
        ("imu gyro {a} [°/s]", "gyro_base_{a}", "pi/180"),
        ("cam_rate_{a}", "gyro_camera_body_{a}", ""),
        ("acc_head_mount_{a}", "accel_head_mount_{a}", "9.80665"),
    ],
)
def test_an_imus_axes_are_of_the_link_that_is_named_or_of_the_base(
    names: str, target: str, factor: str, tmp_path: Path
) -> None:
    """A gyro that turns with the joints is no rate of theirs."""
    turned = V[:, [0, 1, 0]] * [0.01, 1.0, 1.0]
    if "acc" in names:
        turned = np.random.default_rng(0).normal([0, 0, 1], 0.1, turned.shape)
    own = {names.format(a=axis, k=k): turned[:, k] for k, axis in enumerate("xyz")}
    mapping = found_in({"t": T, **each_joint("angle_{j}", LOG.q), **own}, tmp_path).mapping
    told = {target.format(a=axis): (name, factor) for axis, name in zip("xyz", own)}
    assert {name: mapping[name][:2] for name in told} == told
    assert not any(name.startswith("dq_") for name in mapping)


@pytest.mark.parametrize("end", ["", " R"])
def test_odrives_on_a_bus_are_the_rigs_joints(end: str, tmp_path: Path) -> None:
    """In single precision; requests and other devices are left out."""
    path = tmp_path / "bus.log"
    as_candump({**log_columns(LOG), **each_joint("tau_{j}", TAU / CONSTANTS)}, path)
    lines = path.read_text().splitlines()
    lines[10:10] = ["(0.01) can0 009#R", "(0.01) can0 001#0000000000000000"]
    path.write_text("".join(f"{line}{end}\n" for line in lines))
    agree(read_proposed(path), LOG, 1e-5)


@pytest.mark.parametrize(
    ("form", "start", "units", "within"),
    [("f", 0x2F, (1.0, 1.0, 1.0), 1e-5), ("h", 0x27, (1e-4, 2.5e-4, 0.01), 6e-3)],
)
def test_moteus_on_a_fast_bus_are_the_rigs_joints(
    form: str, start: int, units: tuple[float, float, float], within: float, tmp_path: Path
) -> None:
    """A mode in an int8, then position, velocity and torque, as two controllers answer a host."""
    values = np.stack([LOG.q / (2 * pi), V / (2 * pi), TAU], axis=-1) / units
    lines = []
    for t, row in zip(T, values if form == "f" else np.round(values).astype(int)):
        for node, told in enumerate(row.tolist(), start=1):
            data = struct.pack(f"<5B3{form}", 0x21, 0, 10, start, 1, *told).ljust(32, b"\x50")
            lines.append(f"({t:.6f}) can0 {0x8000 | node:08X}##1140400130D\n")
            lines.append(f"({t:.6f}) can0 {node << 8:03X}##1{data.hex().upper()}\n")
    (tmp_path / "bus.log").write_text("".join(lines))
    agree(read_proposed(tmp_path / "bus.log"), LOG, within)


def test_simplefocs_monitor_is_read_by_its_rows(tmp_path: Path) -> None:
    """No header, no times: what `motor.monitor()` prints of one joint behind its messages."""
    q = LOG.q[:, :1]
    none = np.zeros((len(T), 1))
    rows = np.hstack([none, 3 * q, none, 1e3 * q, none, V[:, :1], q])
    path = tmp_path / "serial.txt"
    np.savetxt(path, rows, "%.4f", "\t", header="MOT: Monitor enabled!\nMOT: Init", comments="")
    rig = spelled(CAMERA)
    agree(read_proposed(path, rig), Log("serial", rig.joints, T, q, V[:, :1], q), 1e-4)


def test_gaps_repeats_and_times_that_go_back_are_counted(tmp_path: Path) -> None:
    t = np.arange(0, 4, 0.01) + np.repeat([0.0, 1.0], 200)
    t[300] = t[299]
    x = np.sin(t)
    x[50:55] = x[50]
    facts = found_in({"t": t, "angle": x}, tmp_path).streams[0].facts
    expected = {"samples": 400, "gaps": 1, "repeated_rows": 5, "times_not_increasing": 1}
    expected["first_time_not_increasing"] = 301
    assert {name: facts[name] for name in expected} == expected
    assert facts["rate_hz"] == pytest.approx(100)


def test_the_verb_writes_a_mapping_and_a_picture(tmp_path: Path, run: Run) -> None:
    """Of a log that has no columns of one joint, which is held."""
    columns = {"time_ms": 1e3 * T, "pos_pan": np.degrees(LOG.q[:, 0]), "tau_pan": TAU[:, 0]}
    log = write_csv(columns, tmp_path / "log.csv")
    call = ("inspect", log, "--yaml", tmp_path / "map.yaml")
    (told,) = result(run, *call, "--rig", "turret", "-o", tmp_path / "x.png")["files"]
    mapping = {"t": "time_ms*1e-3", "q_pan": "pos_pan*pi/180", "tau_pan": "tau_pan"}
    assert told["mapping"] == mapping
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    code, _, err = run("identify", "turret", log, "--map", tmp_path / "map.yaml")
    assert (code, "tilt 0" in err) == (0, True)
    refused(run(*call), 2, "--rig")


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured logs")
def test_every_mapping_written_by_hand_for_a_measured_log_is_proposed(tmp_path: Path) -> None:
    """Columns and factors, but for the torque constants of motors, which no log holds."""
    logs = singles(measured(DATA, tmp_path))
    assert len(logs) == 19
    wrong = [
        (case.name, target)
        for case in logs
        for target, remark in differing(case)
        if not is_unknown(remark)
    ]
    assert wrong == []
