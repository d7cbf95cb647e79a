"""Logs as loggers, spreadsheets and ROS write them are read rightly, or refused with a correction that works."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pandas
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from gimbal_pin.errors import DataError, LogError
from gimbal_pin.log import Log, inspect, io, log_columns
from tests.command_line import Run, refused, result
from tests.log.test_formats import TURRET, swing

PAN, TILT = TURRET.joints
T = np.arange(0, 3, 0.005)
"""Times of the logs, s."""


def moved(t: np.ndarray = T) -> Log:
    """A log of the turret: motion that never repeats, torques that follow from it."""
    q, v = swing(t)
    return Log("planted", TURRET.joints, t, q, v, np.column_stack([0.3 * v[:, 0], np.sin(q[:, 1])]))


def write_rows(
    path: Path, head: Sequence[str], rows: Sequence[Sequence[object]], separator: str = ","
) -> Path:
    """Write lines of text, the head first."""
    lines = [*head, *(separator.join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def agree(log: Log, planted: Log, start: float | None = None) -> None:
    """Compare a log with what was written, its times from the first sample on."""
    origin = log.t[0] if start is None else start
    np.testing.assert_allclose(log.t - origin, planted.t - planted.t[0], atol=1e-6)
    np.testing.assert_allclose(log.q, planted.q, atol=1e-9)
    assert log.tau is not None and planted.tau is not None
    np.testing.assert_allclose(log.tau, planted.tau, atol=1e-9)


# --- Times as dates and times of day --------------------------------------------------------------------------------


def instants(offset: float = 0.0) -> list[datetime]:
    """The times of a log that begins a second before midnight."""
    return [
        datetime(2026, 1, 31, 23, 59, 59, tzinfo=timezone.utc) + timedelta(seconds=t + offset)
        for t in T.tolist()
    ]


STAMPS: Mapping[str, tuple[str, Callable[[datetime], str]]] = {
    "ISO with Z": ("timestamp", lambda at: at.strftime("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO without a zone": ("time", lambda at: at.strftime("%Y-%m-%d %H:%M:%S.%f")),
    "ISO with a zone": (
        "stamp",
        lambda at: (at + timedelta(hours=2)).strftime("%Y-%m-%dT%H:%M:%S.%f+02:00"),
    ),
    "date and clock": ("Date,Time", lambda at: at.strftime("%Y-%m-%d,%H:%M:%S.%f")),
    "date with points": ("Datum,Uhrzeit", lambda at: at.strftime("%d.%m.%Y,%H:%M:%S.%f")),
    "date with slashes": ("datetime", lambda at: at.strftime("%m/%d/%Y %I:%M:%S.%f %p")),
    "clock past midnight": ("clock", lambda at: at.strftime("%H:%M:%S.%f")),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_dates_and_times_of_day_are_read_as_seconds(kind: str, tmp_path: Path, run: Run) -> None:
    planted = moved()
    (names, spell) = STAMPS[kind]
    columns = {name: values for name, values in log_columns(planted).items() if name != "t"}
    rows = [
        [spell(at), *values]
        for at, values in zip(instants(), np.column_stack(list(columns.values())).tolist())
    ]
    path = write_rows(tmp_path / "log.csv", [",".join([names, *columns])], rows)
    (stream,) = result(run, "inspect", path)["files"][0]["streams"]
    assert (
        stream["rate_hz"] == pytest.approx(200, rel=1e-3) and stream["time"] == names.split(",")[-1]
    )
    agree(io.read_log(path, TURRET, [f"t={names.split(',')[-1]}"]), planted)
    assert (io.read_log(path, TURRET, [f"t={names.split(',')[-1]}"]).t[0] > 1e9) == (
        kind != "clock past midnight"
    )


def test_a_text_among_dates_is_named_with_its_line(tmp_path: Path) -> None:
    path = write_rows(
        tmp_path / "log.csv",
        ["time,q_pan,q_tilt"],
        [["10:00:00", 0, 0], ["10:00:01", 0, 0], ["x", 0, 0]],
    )
    with pytest.raises(LogError, match=r"log\.csv:4 column 'time'"):
        io.read_log(path, TURRET, ["t=time"], need_tau=False)


def test_decimal_commas_and_a_clock_between_semicolons_are_read(tmp_path: Path) -> None:
    planted = moved()
    columns = {name: values for name, values in log_columns(planted).items() if name != "t"}
    rows = [
        [at.strftime("%d.%m.%Y %H:%M:%S,%f"), *(str(value).replace(".", ",") for value in values)]
        for at, values in zip(instants(), np.column_stack(list(columns.values())).tolist())
    ]
    path = write_rows(tmp_path / "log.csv", [";".join(["Zeit", *columns])], rows, ";")
    agree(io.read_log(path, TURRET, ["t=Zeit"]), planted)


# --- Headers --------------------------------------------------------------------------------------------------------

PREAMBLES = {
    "settings": ["Device: GimbalLogger v2", "Date: 2026-01-31", "Sample rate: 200 Hz", ""],
    "settings in columns": ["Device,Logger", "Firmware,1.2", "Kp,2.5", "Rate,200", ""],
    "one title": ["Measurement of the turret"],
    "a table of channels": ["Channel;Unit;Gain", "q_pan;rad;1.0", "q_tilt;rad;1.0", "---"],
}


@pytest.mark.parametrize("units", [False, True])
@pytest.mark.parametrize("preamble", PREAMBLES)
def test_a_header_below_other_lines_is_found_and_these_are_mentioned(
    preamble: str, units: bool, tmp_path: Path
) -> None:
    planted = moved()
    columns = log_columns(planted)
    unit = {"t": "s", "q": "rad", "dq": "rad/s", "tau": "N m"}
    head = [*PREAMBLES[preamble], ",".join(columns)]
    if units:
        head.append(",".join(unit[name.split("_")[0]] for name in columns))
    path = write_rows(tmp_path / "log.csv", head, np.column_stack(list(columns.values())).tolist())
    log = io.read_log(path, TURRET)
    agree(log, planted)
    assert any(f"lines 1 to {len(PREAMBLES[preamble])}" in event for event in log.events)


def test_rows_of_another_width_than_the_header_stay_an_error(tmp_path: Path) -> None:
    """The header is no preamble of a table without names."""
    rows = [[0.01 * k, 1, 2, 3, 4, 5] for k in range(9)]
    path = write_rows(tmp_path / "log.csv", ["t,q_pan,q_tilt,tau_pan,tau_tilt"], rows)
    with pytest.raises(LogError, match="6 values under 5 column names"):
        io.read_log(path, TURRET)


# --- Joint states of ROS --------------------------------------------------------------------------------------------


def orders(count: int, change: bool) -> list[tuple[int, int]]:
    """The order of the joints in each message: the other way, and changing where that is asked for."""
    return [(0, 1) if change and k % 3 else (1, 0) for k in range(count)]


@pytest.mark.parametrize("change", [False, True])
@pytest.mark.parametrize(
    "tool", ["rostopic echo -p", "ros2 topic echo --csv", "ros2 without efforts"]
)
def test_printed_joint_states_are_read_by_the_names_in_each_row(
    tool: str, change: bool, tmp_path: Path
) -> None:
    planted = moved()
    start = 1_700_000_000
    assert planted.v is not None and planted.tau is not None
    rows = []
    head = []
    for k, order in enumerate(orders(len(planted), change)):
        at = round(planted.t[k] * 1e9)
        names = [TURRET.joints[j] for j in order]
        groups = [planted.q[k], planted.v[k], planted.tau[k]][
            : 2 if tool.endswith("efforts") else 3
        ]
        values = [*names, *(float(group[j]) for group in groups for j in order)]
        if tool.startswith("rostopic"):
            ns = start * 10**9 + at
            rows.append([ns + 300, k, ns, "", *values])
        else:
            rows.append([start + at // 10**9, at % 10**9, "base", *values])
    if tool.startswith("rostopic"):
        fields = [
            f"field.{kind}{j}"
            for kind in ("name", "position", "velocity", "effort")
            for j in (0, 1)
        ]
        head = [
            ",".join(
                [
                    "%time",
                    "field.header.seq",
                    "field.header.stamp",
                    "field.header.frame_id",
                    *fields,
                ]
            )
        ]
    path = write_rows(tmp_path / "joints.csv", head, rows)
    if tool.endswith("efforts"):
        with pytest.raises(DataError, match="no torque"):
            io.read_log(path, TURRET)
        np.testing.assert_allclose(io.read_log(path, TURRET, need_tau=False).q, planted.q)
        return
    agree(io.read_log(path, TURRET), planted, start)


def write_joint_bag(
    path: Path, topics: Mapping[str, tuple[Log, bool]], effort: str = "there"
) -> None:
    """Write a bag of JointState topics: the log of each, and whether it states rates and efforts.

    Args:
        path: The bag's folder.
        topics: Topic → log, and whether it holds a command: angles alone.
        effort: "there", "nan", or "empty".
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["sensor_msgs/msg/JointState"]
    header = store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for topic, (log, command) in topics.items():
            connection = bag.add_connection(topic, kind.__msgtype__, typestore=store)
            assert log.v is not None and log.tau is not None
            tau = {"there": log.tau, "nan": np.full_like(log.tau, np.nan), "empty": log.tau[:, :0]}[
                effort
            ]
            for k, order in enumerate(orders(len(log), True)):
                at = round(log.t[k] * 1e9)
                rows = [log.q[k, list(order)], np.zeros(0), np.zeros(0)]
                if not command:
                    rows[1:] = [
                        log.v[k, list(order)],
                        tau[k, list(order)] if tau.shape[1] else np.zeros(0),
                    ]
                head = header(stamp(100 + at // 10**9, at % 10**9), "")
                message = kind(head, [TURRET.joints[j] for j in order], *rows)
                bag.write(connection, at, store.serialize_cdr(message, kind.__msgtype__))


def test_a_bags_joint_states_are_read_by_the_names_in_each_message(tmp_path: Path) -> None:
    planted = moved(T[:100])
    write_joint_bag(tmp_path / "bag", {"/joint_states": (planted, False)})
    agree(io.read_log(tmp_path / "bag", TURRET), planted)


@pytest.mark.parametrize(
    "topics", [("/joint_states", "/joint_commands"), ("/a/target_joints", "/joint_states")]
)
def test_measured_joint_states_come_before_commanded_ones(
    topics: tuple[str, str], tmp_path: Path
) -> None:
    planted = moved(T[:100])
    asked = moved(T[:100] + 0.1)
    asked = Log("asked", asked.joints, planted.t, asked.q, asked.v, asked.tau)
    command = {topic: "states" not in topic for topic in topics}
    write_joint_bag(
        tmp_path / "bag",
        {t: (asked if is_one else planted, is_one) for t, is_one in command.items()},
    )
    log = io.read_log(tmp_path / "bag", TURRET)
    agree(log, planted)
    found = inspect(tmp_path / "bag", TURRET).mapping
    assert [found[f"q_ref_{joint}"][0] for joint in TURRET.joints] == [
        f"{next(topic for topic in topics if command[topic])}.q_{joint}" for joint in TURRET.joints
    ]


@pytest.mark.parametrize("effort", ["nan", "empty"])
def test_joint_states_without_efforts_hold_no_torque(effort: str, tmp_path: Path, run: Run) -> None:
    planted = moved(T[:100])
    write_joint_bag(tmp_path / "bag", {"/joint_states": (planted, False)}, effort)
    if effort == "nan":
        refused(run("identify", "turret", tmp_path / "bag"), 3, "no torque")
    else:
        np.testing.assert_allclose(
            io.read_log(tmp_path / "bag", TURRET, need_tau=False).q, planted.q
        )


# --- Columns of other names: the correction that is proposed, completed, reads the log -------------------------------

CONSTANTS = np.array([motor.torque_constant for motor in TURRET.motors])
"""Torque constants of the turret's motors, N m/A."""
FOREIGN: Mapping[str, tuple[Mapping[str, Callable[[Log], np.ndarray]], Mapping[str, str]]] = {
    "seconds and other names": (
        {"time": lambda x: x.t, "pos_{}": lambda x: x.q, "effort_{}": lambda x: x.tau}, {}
    ),
    "counts of an encoder": (
        {"time_ms": lambda x: 1e3 * x.t, "present_position_{}": lambda x: np.round(x.q * 4096 / (2 * np.pi)),
         "tau_{}": lambda x: x.tau},
        {"COUNTS_PER_TURN": "4096"},
    ),
    "counts by their unit": (
        {"t": lambda x: x.t, "{} [cnt]": lambda x: np.round(x.q * 65536 / (2 * np.pi)), "tau_{}": lambda x: x.tau},
        {"COUNTS_PER_TURN": "65536"},
    ),
    "a share of the range": (
        {"t": lambda x: x.t, "{}.pos": lambda x: x.q / 0.02, "tau_{}": lambda x: x.tau}, {"RAD_PER_UNIT": "0.02"}
    ),
    "a share of the range under another name": (
        {"t": lambda x: x.t, "angle_{}": lambda x: x.q / 0.002, "tau_{}": lambda x: x.tau}, {"RAD_PER_UNIT": "0.002"}
    ),
    "currents as signed registers": (
        {"t": lambda x: x.t, "q_{}": lambda x: x.q,
         "current_{}": lambda x: np.round(x.tau / CONSTANTS / 0.0027) % 65536},
        {"AMPERES_PER_UNIT": "0.0027"},
    ),
}  # fmt: skip
"""Kind → columns, one of each joint where the name has a place for it, and what completes the correction."""


def complete(text: str, values: Mapping[str, str]) -> list[str]:
    """Return the entries of the ``--map`` options in a text, each part in capitals replaced by its value."""
    for name, value in values.items():
        text = text.replace(name, value)
    words = shlex.split(text)
    return [words[k + 1] for k, word in enumerate(words) if word == "--map"]


@pytest.mark.parametrize("kind", FOREIGN)
def test_the_correction_of_an_error_reads_the_log_once_completed(kind: str, tmp_path: Path) -> None:
    planted = moved()
    (columns, values) = FOREIGN[kind]
    written = {
        name.format(joint): np.broadcast_to(made.T, (2, len(T)))[k]
        for name, of in columns.items()
        for made in [of(planted)]
        for k, joint in enumerate(TURRET.joints if "{}" in name else TURRET.joints[:1])
    }
    path = write_rows(
        tmp_path / "log.csv", [",".join(written)], np.column_stack(list(written.values())).tolist()
    )
    with pytest.raises(LogError) as caught:
        io.read_log(path, TURRET)
    assert all(name in str(caught.value) for name in values)
    entries = complete(caught.value.mend, values)
    log = io.read_log(path, TURRET, entries)
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    step = 2 * np.pi / 4096 if "counts" in kind else 1e-9
    np.testing.assert_allclose(log.q - log.q[0], planted.q - planted.q[0], atol=1.01 * step)
    assert log.tau is not None and planted.tau is not None
    np.testing.assert_allclose(
        log.tau, planted.tau, atol=0.0014 * CONSTANTS.max() if "registers" in kind else 1e-9
    )


def test_a_file_without_headers_asks_for_the_torque_alone(tmp_path: Path, run: Run) -> None:
    planted = moved(np.arange(0, 10, 0.005))
    assert planted.v is not None and planted.tau is not None
    rows = np.column_stack([planted.t, planted.q, planted.v, planted.tau])
    path = write_rows(tmp_path / "log.csv", [], rows.tolist())
    said = run("identify", "turret", path, "-o", tmp_path / "model.yaml")
    refused(
        said, 2, "--map t=column1 --map q_pan=column2 --map q_tilt=column3", "tau_pan=COLUMN*FACTOR"
    )
    entries = complete(said[2].partition("add ")[2], {"tau_pan=COLUMN*FACTOR": "tau_pan=column6"})
    entries[-1] = "tau_tilt=column7"
    agree(io.read_log(path, TURRET, entries), planted)


# --- Signed registers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("quantity", ["tau", "q"])
def test_registers_logged_without_their_sign_are_read_with_it(
    quantity: str, bits: int, tmp_path: Path
) -> None:
    planted = moved()
    columns = log_columns(planted)
    for name in [name for name in columns if name.startswith(f"{quantity}_")]:
        columns[name] = np.round(columns[name] * 1000) % 2**bits
    path = write_rows(
        tmp_path / "log.csv", [",".join(columns)], np.column_stack(list(columns.values())).tolist()
    )
    log = io.read_log(
        path, TURRET, [f"{quantity}_{joint}={quantity}_{joint}*1e-3" for joint in TURRET.joints]
    )
    read, true = (log.q, planted.q) if quantity == "q" else (log.tau, planted.tau)
    np.testing.assert_allclose(np.asarray(read), np.asarray(true), atol=0.51e-3)
    assert any(f"{bits} bits" in event for event in log.events)


def test_counts_about_the_middle_of_a_register_stay(tmp_path: Path) -> None:
    planted = moved()
    columns = {**log_columns(planted), "tau_pan": 32768 + np.round(planted.q[:, 0] * 1e4)}
    path = write_rows(
        tmp_path / "log.csv", [",".join(columns)], np.column_stack(list(columns.values())).tolist()
    )
    log = io.read_log(path, TURRET)
    assert log.tau is not None and np.ptp(log.tau[:, 0]) == np.ptp(columns["tau_pan"])


# --- Stamps ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate", "rounding"), [(200, "round 0.01"), (300, "floor 0.01"), (2500, "round 0.001")]
)
def test_stamps_of_few_digits_are_read_as_evenly_spaced_rows(
    rate: float, rounding: str, tmp_path: Path, run: Run
) -> None:
    planted = moved(np.arange(0, 3, 1 / rate))
    step = float(rounding.split()[1])
    whole = (np.floor if rounding.startswith("floor") else np.round)(planted.t / step + 1e-9)
    columns = {**log_columns(planted), "t": whole * step}
    path = write_rows(
        tmp_path / "log.csv", [",".join(columns)], np.column_stack(list(columns.values())).tolist()
    )
    log = io.read_log(path, TURRET)
    np.testing.assert_allclose(np.diff(log.t), 1 / rate, rtol=1e-3)
    np.testing.assert_allclose(log.t, planted.t, atol=step)
    assert any("evenly spaced" in event for event in log.events)
    (stream,) = result(run, "inspect", path)["files"][0]["streams"]
    assert stream["rate_hz"] == pytest.approx(rate, rel=1e-3)


def test_rows_that_repeat_stamps_unevenly_are_refused_with_the_mapping_by_row(
    tmp_path: Path,
) -> None:
    planted = moved()
    columns = {**log_columns(planted), "t": np.repeat(planted.t[::6], 6)}
    path = write_rows(
        tmp_path / "log.csv", [",".join(columns)], np.column_stack(list(columns.values())).tolist()
    )
    columns["t"] = np.where(T < 1.5, np.round(T, 2), 2 * np.round(T, 2))  # it slows down halfway
    write_rows(path, [",".join(columns)], np.column_stack(list(columns.values())).tolist())
    with pytest.raises(LogError, match="repeats the row before") as caught:
        io.read_log(path, TURRET)
    log = io.read_log(path, TURRET, complete(caught.value.mend, {}))
    assert len(log) == len(T) and np.ptp(np.diff(log.t)) < 1e-9


def test_rows_that_were_written_twice_are_left_out(tmp_path: Path) -> None:
    planted = moved()
    rows = np.column_stack(list(log_columns(planted).values()))
    path = write_rows(
        tmp_path / "log.csv",
        [",".join(log_columns(planted))],
        np.insert(rows, 40, rows[40], 0).tolist(),
    )
    log = io.read_log(path, TURRET)
    agree(log, planted)
    assert any("1 of 601 rows repeat" in event for event in log.events)


# --- Sensors beside the joints --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cam_rate_{}", "camera omega {}", "g{}"])
def test_the_axes_of_a_gyro_are_no_rates_of_joints(name: str, tmp_path: Path) -> None:
    """The camera's gyro turns with the joints, so its axes add up to their angles."""
    planted = moved(np.arange(0, 10, 0.005))
    assert planted.v is not None
    columns = {
        key: values for key, values in log_columns(planted).items() if not key.startswith("dq")
    }
    gyro = {"x": 0.01 * planted.v[:, 0], "y": planted.v[:, 1], "z": planted.v[:, 0]}
    columns = {key.replace("q_", "angle_", 1): values for key, values in columns.items()}
    columns |= {name.format(axis): values for axis, values in gyro.items()}
    path = write_rows(
        tmp_path / "log.csv", [",".join(columns)], np.column_stack(list(columns.values())).tolist()
    )
    found = inspect(path, TURRET).mapping
    assert not any(target.startswith("dq_") for target in found)
    links = {target.split("_", 1)[1][:-2] for target in found if target.startswith("gyro_")}
    assert len(links) == 1 and (links == {TURRET.base}) == (name == "g{}")
    assert [found[f"gyro_{link}_{axis}"][0] for link in links for axis in "xyz"] == [
        *map(name.format, "xyz")
    ]


# --- JSON -----------------------------------------------------------------------------------------------------------


def as_records(log: Log) -> list[dict[str, float]]:
    """A log as a list of records."""
    columns = log_columns(log)
    return [dict(zip(columns, row)) for row in np.column_stack(list(columns.values())).tolist()]


def as_joint_state(row: Mapping[str, float], order: Sequence[str]) -> dict[str, object]:
    """A record as a bridge to ROS writes a JointState."""
    values = {
        kind: [row[f"{prefix}_{joint}"] for joint in order] for kind, prefix in FIELDS.items()
    }
    whole = int(row["t"])
    stamp = {"sec": 100 + whole, "nanosec": round((row["t"] - whole) * 1e9)}
    return {
        "topic": "/joint_states",
        "msg": {"header": {"stamp": stamp}, "name": [*order], **values},
    }


FIELDS = {"position": "q", "velocity": "dq", "effort": "tau"}
JSON: Mapping[str, Callable[[Log], str]] = {
    "records": lambda x: json.dumps(as_records(x)),
    "records in a structure, as servo tools write": lambda x: json.dumps(
        {"mass": 0.3, "motor": "xl330", "entries": as_records(x)}, indent=1
    ),
    "lists by column": lambda x: json.dumps(
        {name: values.tolist() for name, values in log_columns(x).items()}
    ),
    "records of pandas": lambda x: pandas.DataFrame(log_columns(x)).to_json(
        orient="records", double_precision=15
    ),
    "records with nulls": lambda x: json.dumps(
        [{**row, "temp_pan": None} for row in as_records(x)]
    ),
    "a record a line": lambda x: "\n".join(map(json.dumps, as_records(x))) + '\n{"t": 3.0, "q_p',
    "joint states": lambda x: "\n".join(
        json.dumps(as_joint_state(row, TURRET.joints[:: 1 if k % 3 else -1]))
        for k, row in enumerate(as_records(x))
    ),
    "dates": lambda x: json.dumps(
        [{**row, "t": at.isoformat()} for row, at in zip(as_records(x), instants())]
    ),
}


@pytest.mark.parametrize("kind", JSON)
def test_json_of_any_shape_is_the_same_log(kind: str, tmp_path: Path) -> None:
    planted = moved()
    suffix = "jsonl" if kind == "a record a line" else "json"
    path = tmp_path / f"log.{suffix}"
    path.write_text(JSON[kind](planted))
    entries = ["t=msg.header.stamp"] if kind == "joint states" else []
    agree(io.read_log(path, TURRET, entries), planted)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100000, "nested too deep|is not JSON"),
        ('{"t": [0, 1', "is not JSON"),
        ('{"t": 0}\n{"t": 1\n{"t": 2}\n', "is not JSON"),
        ('{"rig": "turret", "notes": ["a", "b"]}', "no columns of numbers"),
        ('[{"t": 1' + "0" * 400 + "}]", "no columns of numbers"),
    ],
)
def test_json_that_holds_no_log_is_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(LogError, match=said) as caught:
        io.read_log(tmp_path / "log.json", TURRET)
    assert "\n" not in str(caught.value)
