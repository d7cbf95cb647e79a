"""Logs as loggers, spreadsheets and ROS write them are read rightly, or refused with a correction that works."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
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


def write_rows(path: Path, head: Sequence[str], rows: Sequence[Sequence[object]], separator: str = ",") -> Path:
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
    return [datetime(2026, 1, 31, 23, 59, 59, tzinfo=timezone.utc) + timedelta(seconds=t + offset) for t in T.tolist()]


STAMPS: Mapping[str, tuple[str, Callable[[datetime], str]]] = {
    "ISO with Z": ("timestamp", lambda at: at.strftime("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO without a zone": ("time", lambda at: at.strftime("%Y-%m-%d %H:%M:%S.%f")),
    "ISO with a zone": ("stamp", lambda at: (at + timedelta(hours=2)).strftime("%Y-%m-%dT%H:%M:%S.%f+02:00")),
    "date and clock": ("Date,Time", lambda at: at.strftime("%Y-%m-%d,%H:%M:%S.%f")),
    "date with points": ("Datum,Uhrzeit", lambda at: at.strftime("%d.%m.%Y,%H:%M:%S.%f")),
    "date with slashes": ("datetime", lambda at: at.strftime("%m/%d/%Y %I:%M:%S.%f %p")),
    "clock past midnight": ("clock", lambda at: at.strftime("%H:%M:%S.%f")),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_dates_and_times_of_day_are_read_as_seconds(kind: str, tmp_path: Path, run: Run) -> None:
    planted, (names, spell) = moved(), STAMPS[kind]
    columns = {name: values for name, values in log_columns(planted).items() if name != "t"}
    rows = [[spell(at), *values] for at, values in zip(instants(), np.column_stack(list(columns.values())).tolist())]
    path = write_rows(tmp_path / "log.csv", [",".join([names, *columns])], rows)
    (stream,) = result(run, "inspect", path)["files"][0]["streams"]
    assert stream["rate_hz"] == pytest.approx(200, rel=1e-3) and stream["time"] == names.split(",")[-1]
    agree(io.read_log(path, TURRET, [f"t={names.split(',')[-1]}"]), planted)
    assert (io.read_log(path, TURRET, [f"t={names.split(',')[-1]}"]).t[0] > 1e9) == (kind != "clock past midnight")


def test_a_text_among_dates_is_named_with_its_line(tmp_path: Path) -> None:
    path = write_rows(
        tmp_path / "log.csv", ["time,q_pan,q_tilt"], [["10:00:00", 0, 0], ["10:00:01", 0, 0], ["x", 0, 0]]
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
@pytest.mark.parametrize("tool", ["rostopic echo -p", "ros2 topic echo --csv", "ros2 without efforts"])
def test_printed_joint_states_are_read_by_the_names_in_each_row(tool: str, change: bool, tmp_path: Path) -> None:
    planted, start = moved(), 1_700_000_000
    assert planted.v is not None and planted.tau is not None
    rows, head = [], []
    for k, order in enumerate(orders(len(planted), change)):
        at = round(planted.t[k] * 1e9)
        names = [TURRET.joints[j] for j in order]
        groups = [planted.q[k], planted.v[k], planted.tau[k]][: 2 if tool.endswith("efforts") else 3]
        values = [*names, *(float(group[j]) for group in groups for j in order)]
        if tool.startswith("rostopic"):
            ns = start * 10**9 + at
            rows.append([ns + 300, k, ns, "", *values])
        else:
            rows.append([start + at // 10**9, at % 10**9, "base", *values])
    if tool.startswith("rostopic"):
        fields = [f"field.{kind}{j}" for kind in ("name", "position", "velocity", "effort") for j in (0, 1)]
        head = [",".join(["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *fields])]
    path = write_rows(tmp_path / "joints.csv", head, rows)
    if tool.endswith("efforts"):
        with pytest.raises(DataError, match="no torque"):
            io.read_log(path, TURRET)
        np.testing.assert_allclose(io.read_log(path, TURRET, need_tau=False).q, planted.q)
        return
    agree(io.read_log(path, TURRET), planted, start)


def write_joint_bag(path: Path, topics: Mapping[str, tuple[Log, bool]], effort: str = "there") -> None:
    """Write a bag of JointState topics: the log of each, and whether it states rates and efforts.

    Args:
        path: The bag's folder.
        topics: Topic → log, and whether it holds a command: angles alone.
        effort: "there", "nan", or "empty".
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["sensor_msgs/msg/JointState"]
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for topic, (log, command) in topics.items():
            connection = bag.add_connection(topic, kind.__msgtype__, typestore=store)
            assert log.v is not None and log.tau is not None
            tau = {"there": log.tau, "nan": np.full_like(log.tau, np.nan), "empty": log.tau[:, :0]}[effort]
            for k, order in enumerate(orders(len(log), True)):
                at = round(log.t[k] * 1e9)
                rows = [log.q[k, list(order)], np.zeros(0), np.zeros(0)]
                if not command:
                    rows[1:] = [log.v[k, list(order)], tau[k, list(order)] if tau.shape[1] else np.zeros(0)]
                head = header(stamp(100 + at // 10**9, at % 10**9), "")
                message = kind(head, [TURRET.joints[j] for j in order], *rows)
                bag.write(connection, at, store.serialize_cdr(message, kind.__msgtype__))


def test_a_bags_joint_states_are_read_by_the_names_in_each_message(tmp_path: Path) -> None:
    planted = moved(T[:100])
    write_joint_bag(tmp_path / "bag", {"/joint_states": (planted, False)})
    agree(io.read_log(tmp_path / "bag", TURRET), planted)


@pytest.mark.parametrize("topics", [("/joint_states", "/joint_commands"), ("/a/target_joints", "/joint_states")])
def test_measured_joint_states_come_before_commanded_ones(topics: tuple[str, str], tmp_path: Path) -> None:
    planted, asked = moved(T[:100]), moved(T[:100] + 0.1)
    asked = Log("asked", asked.joints, planted.t, asked.q, asked.v, asked.tau)
    command = {topic: "states" not in topic for topic in topics}
    write_joint_bag(tmp_path / "bag", {t: (asked if is_one else planted, is_one) for t, is_one in command.items()})
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
        np.testing.assert_allclose(io.read_log(tmp_path / "bag", TURRET, need_tau=False).q, planted.q)
