"""`inspect`: what is planted in a log's columns is found, and the mapping that is proposed reads the log."""

from __future__ import annotations

import struct
from math import pi
from pathlib import Path

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from real_data.cases import CAMERA, measured
from real_data.proposed import differing, is_unknown, singles

from gimbal_pin.errors import GimbalPinError
from gimbal_pin.log import (
    Log,
    Source,
    format_expression,
    inspect,
    io,
    parse_expression,
    read_mapping,
    to_json,
)
from gimbal_pin.log.io.recognise import recognise
from gimbal_pin.report import show_file
from gimbal_pin.rig import Rig, read_yaml
from tests.command_line import Run, refused, result
from tests.log.test_formats import TURRET, swing

DATA = Path(__file__).parents[3] / "shared" / "data"
UNITS = {
    "rad": (1.0, 1.0),
    "deg": (pi / 180, pi / 180),
    "deg and rpm": (pi / 180, pi / 30),
    "turns": (2 * pi, 1.0),
}
"""How angles and rates are written → radians and radians per second in one unit of them."""
CLOCKS = {"t": 1.0, "time_ms": 1e-3, "stamp_us": 1e-6, "timestamp": 1e-9}


def written(
    folder: Path, unit: str, clock: str, names: tuple[str, str, str], order: int = 1
) -> Path:
    """Write 10 s of motion of the turret, torques that follow from it, in these units and under these names."""
    t = np.arange(0, 10, 0.002)
    q, v = swing(t)
    a = np.gradient(v, t, axis=0)
    tau = 0.3 * a + 0.1 * np.sign(v) + np.column_stack([0 * t, np.sin(q.sum(axis=1))])
    per = UNITS[unit]
    columns = {clock: t / CLOCKS[clock]}
    for name, values in zip(names, (q / per[0], v / per[1], tau)):
        columns |= {
            name.format(j=joint, k=k + 1): values[:, k] for k, joint in enumerate(TURRET.joints)
        }
    if names == NAMES["none"]:
        columns = {f"column{k + 1}": values for k, values in enumerate(columns.values())}
    pandas.DataFrame(dict(list(columns.items())[::order])).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


NAMES = {
    "joints": ("pos_{j}", "vel_{j}", "tau_{j}"),
    "numbers": ("MeasuredAngle{k}", "Speed{k}", "MotorTorque{k}"),
    "the contract": ("q_{j}", "dq_{j}", "tau_{j}"),
    "none": ("x{k}", "y{k}", "z{k}"),
}


@pytest.mark.parametrize(("column", "kind", "unit", "factor"), [
    ("Iq_{j}_mA", "current", "mA", 1e-3), ("iq {j} [mA]", "current", "mA", 1e-3), ("Iq_{j}_A", "current", "A", 1.0),
    ("tau_{j}_mA", "current", "mA", 1e-3), ("torque_{j}_mNm", "torque", "mN m", 1e-3),
    ("tau_{j} [N mm]", "torque", "N mm", 1e-3), ("tau_{j}_Nmm", "torque", "N mm", 1e-3),
    ("{j}_mN_m", "torque", "mN m", 1e-3), ("tau_{j}_Ncm", "torque", "N cm", 1e-2), ("{j} [N m]", "torque", "N m", 1.0),
    ("vel_{j}_mrad/s", "rate", "mrad/s", 1e-3), ("rate_{j}_rpm", "rate", "rpm", pi / 30),
    ("{j} [A]", "current", "A", 1.0), ("tau_{j} [A]", "current", "A", 1.0), ("i_{j} (mA)", "current", "mA", 1e-3),
    ("vel {j} [Hz]", "rate", "turns/s", 2 * pi), ("speed {j} [rad/s]", "rate", "rad/s", 1.0),
    ("rate_{j} (°/s)", "rate", "deg/s", pi / 180), ("Winkel {j} [°]", "position", "deg", pi / 180),
    ("angle {j} (deg)", "position", "deg", pi / 180), ("moment {j} (mNm)", "torque", "mN m", 1e-3),
    ("q_{j}_mrad", "position", "mrad", 1e-3), ("angle_{j}_mdeg", "position", "mdeg", 1e-3 * pi / 180),
])  # fmt: skip
def test_the_unit_in_a_name_is_read_in_full(
    column: str, kind: str, unit: str, factor: float
) -> None:
    t = np.arange(0, 10, 0.002)
    q, v = swing(t)
    values = {"position": q, "rate": v}.get(kind, np.sin(3 * q) + 0.1 * np.sign(v))
    data = {
        "t": t,
        **{column.format(j=joint): values[:, k] / factor for k, joint in enumerate(TURRET.joints)},
    }
    found = recognise("t", data, TURRET)
    prefix = {"position": "q", "rate": "dq"}.get(kind, "tau")
    for channel, joint, motor in zip(found.channels[1:], TURRET.joints, TURRET.motors):
        assert (channel.quantity, channel.unit, channel.joint) == (kind, unit, joint)
        source = parse_expression(format_expression(*found.mapping[f"{prefix}_{joint}"][:2]), "")
        constant = motor.torque_constant if kind == "current" else 1.0
        assert source.column == channel.column and source.factor == pytest.approx(factor * constant)


def test_currents_in_several_units_are_each_of_their_joint() -> None:
    t = np.arange(0, 10, 0.002)
    current = np.sin(3 * swing(t)[0])
    data = {"t": t, "pan_current [A]": current[:, 0], "tilt_current [mA]": 1e3 * current[:, 1]}
    mapping = recognise("t", data, TURRET).mapping
    scales = [
        parse_expression(format_expression(*mapping[f"tau_{j}"][:2]), "").factor
        for j in TURRET.joints
    ]
    pan, tilt = (motor.torque_constant for motor in TURRET.motors)
    assert pan is not None and tilt is not None
    assert scales == pytest.approx([pan, 1e-3 * tilt])


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "A"), (1e-3, "mA")])
def test_a_current_without_a_unit_is_in_milliamperes_where_no_motor_holds_the_amperes(
    factor: float, unit: str
) -> None:
    t = np.arange(0, 10, 0.002)
    current = np.sin(3 * swing(t)[0])
    data = {
        "t": t,
        **{f"current_{joint}": current[:, k] / factor for k, joint in enumerate(TURRET.joints)},
    }
    assert [channel.unit for channel in recognise("t", data, TURRET).channels[1:]] == [unit, unit]


@pytest.mark.parametrize("name", ["imu_gyro_{a} [deg/s]", "gyro_{a} (deg/s)", "imu gyro {a} [°/s]"])
def test_a_unit_behind_the_axis_of_a_gyro_is_read(name: str) -> None:
    t = np.arange(0, 10, 0.004)
    rng = np.random.default_rng(0)
    data = {"t": t, **{name.format(a=a): rng.normal(size=len(t)) for a in "xyz"}}
    mapping = recognise("t", data, TURRET).mapping
    assert [mapping[f"gyro_{TURRET.base}_{a}"][:2] for a in "xyz"] == [
        (name.format(a=a), "pi/180") for a in "xyz"
    ]


@pytest.mark.parametrize(("names", "unit", "clock"), [
    *(("joints", "rad", clock) for clock in CLOCKS), *(("numbers", "deg and rpm", clock) for clock in CLOCKS),
    ("the contract", "turns", "t"), ("none", "rad", "t"), ("none", "deg", "t"),
])  # fmt: skip
def test_the_mapping_that_is_proposed_reads_the_log(
    names: str, unit: str, clock: str, tmp_path: Path
) -> None:
    rig = TURRET
    if unit == "turns":  # nothing in the data says so: the name does
        path = written(tmp_path, unit, clock, ("q_{j}_turns", "dq_{j}", "tau_{j}"))
    else:
        path = written(tmp_path, unit, clock, NAMES[names])
    found = inspect(path, rig)
    assert found.missing == (
        ("tau_pan", "tau_tilt") if names == "none" else ()
    )  # torque has to be stated
    (tmp_path / "map.yaml").write_text(found.yaml, encoding="utf-8")
    log = io.read_log(path, rig, [tmp_path / "map.yaml"], need_tau=False)
    np.testing.assert_allclose(log.t, np.arange(0, 10, 0.002), atol=1e-9)
    q, v = swing(log.t)
    np.testing.assert_allclose(log.q, q, atol=1e-8)
    assert log.v is not None
    np.testing.assert_allclose(log.v, v, atol=1e-8)


def test_the_order_of_the_columns_says_nothing_where_names_do(tmp_path: Path) -> None:
    one, other = (
        inspect(written(tmp_path, "deg", "time_ms", NAMES["numbers"], order), TURRET)
        for order in (1, -1)
    )
    assert dict(one.mapping) == dict(other.mapping)


def test_a_rate_of_the_other_sign_or_of_an_unknown_unit_is_turned_into_its_angles() -> None:
    t = np.arange(0, 10, 0.002)
    q, v = swing(t)
    data = {"t": t, "pos1": q[:, 0], "pos2": q[:, 1], "vel1": -v[:, 0], "vel2": v[:, 1] / 0.0042}
    mapping = recognise("t", data, TURRET).mapping
    assert mapping["dq_pan"][:2] == ("vel1", "-")
    assert float(mapping["dq_tilt"][1]) == pytest.approx(0.0042, rel=1e-3)


@pytest.mark.parametrize(
    "names", [("{j}_deg", "{j}_deg_s", "{j}_nm"), ("{j} [deg]", "{j} [deg/s]", "{j} [N m]")]
)
def test_a_joints_name_and_a_unit_say_what_a_column_is(
    names: tuple[str, str, str], tmp_path: Path
) -> None:
    log = proposed(written(tmp_path, "deg", "t", names))
    q, v = swing(log.t)
    np.testing.assert_allclose(log.q, q, atol=1e-8)
    assert log.v is not None and log.tau is not None
    np.testing.assert_allclose(log.v, v, atol=1e-8)


def test_joints_without_columns_are_held_and_that_is_said(tmp_path: Path, run: Run) -> None:
    path = written(tmp_path, "rad", "t", NAMES["joints"])
    pandas.read_csv(path).drop(columns=["pos_tilt", "vel_tilt", "tau_tilt"]).to_csv(
        path, index=False
    )
    found = result(run, "inspect", path, "--rig", "turret", "--yaml", tmp_path / "m.yaml")["files"][
        0
    ]
    assert set(found["mapping"]) == {"t", "q_pan", "dq_pan", "tau_pan"} and found["missing"] == []
    assert "'tilt'" in found["notes"][-1]
    code, _, error = run(
        "identify", "turret", path, "--map", tmp_path / "m.yaml", "-o", tmp_path / "model.yaml"
    )
    assert code == 0 and "held" in error and "tilt 0" in error
    assert read_yaml(tmp_path / "model.yaml")["joints"] == ["pan"]


def test_a_step_that_parts_a_turn_tells_degrees_from_radians() -> None:
    t = np.arange(0, 10, 0.002)
    for turn, unit in ((2 * pi, "rad"), (360.0, "deg")):
        step = turn / 2**14
        q = 0.2 * swing(t)[0] * turn / (2 * pi)
        data = {"t": t, **{f"pos{k}": step * np.round(q[:, k] / step) for k in (0, 1)}}
        assert [channel.unit for channel in recognise("t", data, TURRET).channels[1:]] == [
            unit,
            unit,
        ]


def test_an_imus_axes_are_of_the_link_that_is_named_or_of_the_base() -> None:
    t = np.arange(0, 10, 0.004)
    rng = np.random.default_rng(0)
    flown = {f"sensor_combined.gyro_rad[{k}]": rng.normal(size=len(t)) for k in range(3)}
    head = {f"acc_head_mount_{a}": rng.normal(scale=0.1, size=len(t)) + (a == "z") for a in "xyz"}
    turned = {f"head_mount.orientation.{a}": np.full(len(t), 0.5) for a in "xyzw"}
    mapping = recognise("timestamp", {"timestamp": t, **flown, **head, **turned}, TURRET).mapping
    assert [mapping[f"quat_head_mount_{a}"][0][-1] for a in "wxyz"] == list("wxyz")
    assert [mapping[f"gyro_{TURRET.base}_{a}"][:2] for a in "xyz"] == [(name, "") for name in flown]
    assert [mapping[f"accel_head_mount_{a}"][:2] for a in "xyz"] == [
        (name, "9.80665") for name in head
    ]


def proposed(path: Path) -> Log:
    """Read a log of the turret by what is proposed for it."""
    found = inspect(path, TURRET)
    assert found.missing == ()
    return io.read_log(
        path,
        TURRET,
        [f"{target}={format_expression(*source[:2])}" for target, source in found.mapping.items()],
    )


FRAME = {
    "candump -L": "({t:.6f}) can0 {id:03X}#{data}",
    "candump -L -x": "({t:.6f}) can0 {id:03X}#{data} R",
    "candump -t a": " ({t:.6f})  can0  {id:03X}   [{size}]  {spaced}",
}


@pytest.mark.parametrize("style", FRAME)
def test_odrives_on_a_bus_are_the_rigs_joints(style: str, tmp_path: Path) -> None:
    """Estimates of two nodes, currents 0.3 ms later, an axis that says nan at first, requests and other devices."""
    t = 1.7e9 + np.arange(0, 4, 0.002)
    (q, v) = swing(t - t[0])
    (later, _) = swing(t + 3e-4 - t[0])
    lines = []
    for k, at in enumerate(t):
        for node in (0, 1):
            first = (q[k, node] / (2 * pi), v[k, node] / (2 * pi)) if k > 3 else (float("nan"), 0.0)
            frames = [(9, struct.pack("<ff", *first), 0.0), (9, b"", 0.0), (1, bytes(8), 0.0)]
            frames += [(0x14, struct.pack("<ff", 0.0, 2 * later[k, node]), 3e-4)]
            for command, data, behind in frames:
                told = {
                    "id": node << 5 | command,
                    "data": data.hex().upper() or "R",
                    "spaced": data.hex(" ").upper(),
                }
                lines.append(FRAME[style].format(t=at + behind, size=len(data), **told))
    (tmp_path / "bus.log").write_text("\n".join(lines) + "\n")
    log = proposed(tmp_path / "bus.log")
    q, v = swing(log.t - t[0])
    constants = np.array([motor.torque_constant for motor in TURRET.motors])
    assert log.v is not None and log.tau is not None and len(log) > len(t) - 8
    for own, true in ((log.q, q), (log.v, v), (log.tau, 2 * q * constants)):
        np.testing.assert_allclose(own, true, atol=1e-4)
    assert any("'001', '021'" in event for event in log.events) and any(
        "no numbers" in event for event in log.events
    )


@pytest.mark.parametrize(
    ("form", "units"),
    [("f", (1.0, 1.0, 1.0)), ("i", (1e-5, 1e-5, 1e-3)), ("h", (1e-4, 2.5e-4, 0.01))],
)
def test_moteus_on_a_fast_bus_are_the_rigs_joints(
    form: str, units: tuple[float, ...], tmp_path: Path
) -> None:
    """A mode in an int8, then position, velocity and torque, as two controllers answer a host that asks."""
    t = 1.7e9 + np.arange(0, 4, 0.002)
    q, v = swing(t - t[0])
    start = {"f": 0x2C, "i": 0x28, "h": 0x24}[form]
    lines = []
    for k, at in enumerate(t):
        for node in (1, 2):
            values = [
                x / unit
                for x, unit in zip(
                    (q[k, node - 1] / 2 / pi, v[k, node - 1] / 2 / pi, 3 * q[k, node - 1]), units
                )
            ]
            told = struct.pack(f"<3{form}", *(values if form == "f" else map(round, values)))
            data = (b"\x21\x00\x0a" + bytes([start | 3, 1]) + told).ljust(32, b"\x50")
            lines += [
                f"({at:.6f}) can0 {0x8000 | node:08X}##1140400130D",
                f"({at:.6f}) can0 {node << 8:03X}##1{data.hex().upper()}",
            ]
    (tmp_path / "bus.log").write_text("\n".join(lines) + "\n")
    log = proposed(tmp_path / "bus.log")
    q, v = swing(log.t - t[0])
    assert log.v is not None and log.tau is not None and len(log) > len(t) - 8
    for own, true, unit in (
        (log.q, q, 2 * pi * units[0]),
        (log.v, v, 2 * pi * units[1]),
        (log.tau, 3 * q, units[2]),
    ):
        np.testing.assert_allclose(own, true, atol=1e-5 + (0.0 if form == "f" else 0.51 * unit))


def test_a_bus_without_odrives_is_refused_with_the_mend(tmp_path: Path, run: Run) -> None:
    (tmp_path / "bus.log").write_text(
        "(1.000000) can0 123#DEADBEEF\n(1.1) can0 00000009#0000000000000000\n"
    )
    refused(run("inspect", tmp_path / "bus.log"), 2, "DBC")


def test_simplefocs_monitor_is_read_by_its_rows(tmp_path: Path, run: Run) -> None:
    """No header, no times: what `motor.monitor()` prints of one joint behind its messages."""
    t = np.arange(0, 10, 0.004)
    q, v = (x[:, 0] for x in swing(t))
    rows = np.column_stack([0 * t, 3 * q, 0 * t, 1e3 * q, 0 * t, v, q])
    with (tmp_path / "serial.txt").open("w") as file:
        file.write("MOT: Monitor enabled!\nMOT: Init\nMOT: Align sensor.\nMOT: Ready.\n")
        np.savetxt(file, rows, fmt="%.4f", delimiter="\t")
    (tmp_path / "arm.urdf").write_text(CAMERA)
    arm = Rig.load(str(tmp_path / "arm.urdf"))
    found = inspect(tmp_path / "serial.txt", arm)
    texts = {target: format_expression(*source[:2]) for target, source in found.mapping.items()}
    assert texts == {
        "t": "row*0.004",
        "q_tilt": "angle",
        "dq_tilt": "velocity",
        "tau_tilt": "current.q_ma*1e-3",
    }
    log = io.read_log(
        tmp_path / "serial.txt", arm, [f"{target}={text}" for target, text in texts.items()]
    )
    np.testing.assert_allclose(log.t, t, atol=1e-12)
    np.testing.assert_allclose(log.q[:, 0], q, atol=1e-4)
    (tmp_path / "map.yaml").write_text(found.yaml)
    call = (
        "identify",
        tmp_path / "arm.urdf",
        tmp_path / "serial.txt",
        "--map",
        tmp_path / "map.yaml",
        "--follow",
    )
    refused(run(*call, "--idle", 0), 2, "write its times")


NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from(
    [0.0, 1.0, -1.0, 1e-300, 1e300, 5e-324]
)
HEADS = st.sampled_from(
    ["t", "time_ms", "pos1", "pos2", "vel1", "vel2", "gyro_x", "acc_x", "counts", "x", "iq"]
)


@given(
    heads=st.lists(HEADS, min_size=2, max_size=8, unique=True),
    rows=st.integers(1, 30),
    data=st.data(),
)
def test_any_numbers_are_described_or_refused(
    heads: list[str], rows: int, data: st.DataObject, tmp_path: Path
) -> None:
    values = data.draw(hnp.arrays(np.float64, (rows, len(heads)), elements=NUMBERS, fill=NUMBERS))
    if data.draw(st.booleans()):
        values[:, 0] = np.arange(rows)
    np.savetxt(
        tmp_path / "log.csv",
        values,
        delimiter=",",
        header=",".join(heads),
        comments="",
        fmt="%.17g",
    )
    try:
        found = inspect(tmp_path / "log.csv", TURRET)
    except GimbalPinError as error:
        assert "\n" not in str(error)
    else:
        read_mapping(
            [
                f"{target}={format_expression(*source[:2])}"
                for target, source in found.mapping.items()
            ]
        )
        assert to_json(found.to_dict()) and show_file(found).to_text()


@given(st.text(min_size=1, max_size=30).filter(lambda name: not ("'" in name and '"' in name)),
       st.sampled_from(["", "pi/180", "-", "-2*pi/8192", "1e-6"]))  # fmt: skip
def test_any_columns_name_reads_back_from_an_expression(name: str, factor: str) -> None:
    plain = parse_expression(f"x*{factor.lstrip('-') or '1'}", "").factor
    expected = Source(name, -plain if factor.startswith("-") else plain, "")
    assert parse_expression(format_expression(name, factor), "") == expected


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured logs in ../shared/data")
def test_every_mapping_written_by_hand_is_proposed(tmp_path: Path) -> None:
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


def test_the_verb_writes_a_mapping_a_picture_and_a_page(tmp_path: Path, run: Run) -> None:
    log = written(tmp_path, "deg", "time_ms", NAMES["joints"])
    found = result(
        run,
        "inspect",
        log,
        "--rig",
        "turret",
        "--yaml",
        tmp_path / "m.yaml",
        "-o",
        tmp_path / "x.png",
    )
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    assert found["files"][0]["mapping"] == {
        target: f"{source.column}"
        + {"t": "*1e-3", "q": "*pi/180", "dq": "*pi/180", "tau": ""}[target.split("_")[0]]
        for target, source in read_mapping([tmp_path / "m.yaml"]).items()
    }
    code, out, _ = run("inspect", log, "--rig", "turret", "-o", tmp_path / "x.html")
    page = (tmp_path / "x.html").read_text()
    assert (
        code == 0
        and "q_pan: pos_pan*pi/180" in out
        and "q_pan: pos_pan*pi/180" in page
        and "<svg" in page
    )


def test_gaps_repeats_and_times_that_go_back_are_counted(tmp_path: Path, run: Run) -> None:
    t = np.arange(0, 4, 0.01)
    t[200:] += 1
    t[300] = t[299]
    x = np.sin(t)
    x[50:55] = x[50]
    pandas.DataFrame({"t": t, "angle": x, "note": "a"}).to_csv(tmp_path / "log.csv", index=False)
    (stream,) = result(run, "inspect", tmp_path / "log.csv")["files"][0]["streams"]
    counted = {
        key: stream[key] for key in ("samples", "gaps", "repeated_rows", "times_not_increasing")
    }
    assert counted == {"samples": 400, "gaps": 1, "repeated_rows": 5, "times_not_increasing": 1}
    assert stream["first_time_not_increasing"] == 301 and stream["rate_hz"] == pytest.approx(100)


def test_what_cannot_be_inspected_is_one_line(tmp_path: Path, run: Run) -> None:
    log = written(tmp_path, "rad", "t", NAMES["joints"])
    refused(run("inspect", log, "--yaml", tmp_path / "m.yaml"), 2, "--rig")
    refused(run("inspect"), 2, "at least one file")
    refused(run("inspect", tmp_path / "none.csv"), 2, "does not exist")
