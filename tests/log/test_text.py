"""Text as loggers, spreadsheets, ROS and web tools write it is read as the numbers that it means.

Laws: the same two samples in any dialect are the same log; stamps of few digits and registers
without a sign are the numbers that they stand for; what is left out is said.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest

from gimbal_pin.errors import LogError
from gimbal_pin.log import log_columns, read_log
from tests.log.planted import FEW, TURRET, T, held, planted, same, write_csv

HEADER = "t,q_pan,q_tilt,tau_pan,tau_tilt"
NAMES = "q_pan,q_tilt,tau_pan,tau_tilt"
ROWS = "0.0,1,2,3,4\n0.1,5,6,7,8\n"
PLAIN = f"{HEADER}\n{ROWS}"
ROSTOPIC = (
    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,field.name1,"
    "field.position0,field.position1,field.velocity0,field.velocity1,field.effort0,field.effort1\n"
    "1700000000000000300,0,1700000000000000000,,pan,tilt,1,2,0,0,3,4\n"
    "1700000000100000300,1,1700000000100000000,,tilt,pan,6,5,0,0,8,7\n"
)
ROSBRIDGE = (
    '{"topic": "/joint_states", "msg": {"header": {"stamp": {"sec": 100, "nanosec": 900000000}}, '
    '"name": ["pan", "tilt"], "position": [1, 2], "velocity": [0, 0], "effort": [3, 4]}}\n'
    '{"topic": "/joint_states", "msg": {"header": {"stamp": {"sec": 101, "nanosec": 0}}, '
    '"name": ["tilt", "pan"], "position": [6, 5], "velocity": [0, 0], "effort": [8, 7]}}\n'
)
RECORDS = (
    '[{"t": 0, "q_pan": 1, "q_tilt": 2, "tau_pan": 3, "tau_tilt": 4, "temp_pan": null},\n'
    '{"t": 0.1, "q_pan": 5, "q_tilt": 6, "tau_pan": 7, "tau_tilt": 8}]'
)
LISTS = '{"t": [0, 0.1], "q_pan": [1, 5], "q_tilt": [2, 6], "tau_pan": [3, 7], "tau_tilt": [4, 8]}'

TEXTS = {
    "carriage returns": PLAIN.replace("\n", "\r\n"),
    "lone carriage returns": PLAIN.replace("\n", "\r"),
    "byte order mark": f"\ufeff{PLAIN}",
    "semicolons": PLAIN.replace(",", ";"),
    "tabs": PLAIN.replace(",", "\t"),
    "spaces": PLAIN.replace(",", " , "),
    "quotes": '"t", "q_pan","q_tilt","tau_pan","tau_tilt"\n"0.0",1,2,3,4\n0.1,"5",6,7,8',
    "comments": f"# a log\n\n{HEADER}\n  # start, now\n0.0,1,2,3,4\n\n#,,\n0.1,5,6,7,8\n \n# end",
    "header in a comment": f"# by savetxt\n# {PLAIN}",
    "trailing separators": PLAIN.replace("\n", ",\n"),
    "trailing in rows": f"{HEADER}\n0.0,1,2,3,4,\n0.1,5,6,7,8,\n",
    "other columns": f'state,{HEADER},note\nok,0.0,1,2,3,4,"a, b #1"\nok,0.1,5,6,7,8,"a"\n',
    "other order": "tau_tilt,t,q_tilt,q_pan,tau_pan\n4,0.0,2,1,3\n8,0.1,6,5,7\n",
    "decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "exponents": f"{HEADER}\n0,1e0,+2.,3.0E+0,40e-1\n100e-3,5,6,7,8\n",
    "a line of units": f"{HEADER}\ns,rad,rad,N m,N m\n{ROWS}",
    "units in brackets": f"{HEADER}\n[s],[rad],[rad],[Nm],[Nm]\n{ROWS}",
    "settings": f"Device: Logger v2\nDate: 2026-01-31\nSample rate: 200 Hz\n\n{PLAIN}",
    "settings in columns": f"Device,Logger\nFirmware,1.2\nKp,2.5\nRate,200\n\n{PLAIN}",
    "a title": f"Measurement of the turret\n{PLAIN}",
    "a table of channels": f"Channel;Unit;Gain\nq_pan;rad;1.0\nq_tilt;rad;1.0\n---\n{PLAIN}",
    "rostopic echo -p": ROSTOPIC,
    "ros2 topic echo --csv": (
        "100,900000000,base,pan,tilt,1,2,0,0,3,4\n101,0,base,tilt,pan,6,5,0,0,8,7\n"
    ),
    "records": RECORDS,
    "records in a structure": f'{{"mass": 0.3, "motor": "xl330", "entries": {RECORDS}}}',
    "lists": LISTS,
    "a record a line": RECORDS.strip("[]").replace(",\n", "\n") + '\n{"t": 0.2, "q_p',
}
"""Kind → two samples."""
DATED = {
    "time": [
        f"time,{NAMES}\n2026-01-31T23:59:59.900Z,1,2,3,4\n2026-02-01T00:00:00.000Z,5,6,7,8\n",
        f"time,{NAMES}\n2026-01-31 23:59:59.900,1,2,3,4\n2026-02-01 00:00:00.000,5,6,7,8\n",
        f"time,{NAMES}\n2026-02-01T01:59:59.9+02:00,1,2,3,4\n2026-02-01T02:00:00.0+02:00,5,6,7,8\n",
        f"Date,time,{NAMES}\n2026-01-31,23:59:59.9,1,2,3,4\n2026-02-01,00:00:00.0,5,6,7,8\n",
        f"Datum,time,{NAMES}\n31.01.2026,23:59:59.9,1,2,3,4\n01.02.2026,00:00:00.0,5,6,7,8\n",
        f"time,{NAMES}\n01/31/2026 11:59:59.9 PM,1,2,3,4\n02/01/2026 12:00:00.0 AM,5,6,7,8\n",
        "time;q_pan;q_tilt;tau_pan;tau_tilt\n31.01.2026 23:59:59,9;1,0;2;3;4\n"
        "01.02.2026 00:00:00,0;5,0;6;7;8\n",
        LISTS.replace("[0, 0.1]", '["2026-01-31T23:59:59.9Z", "2026-02-01T00:00:00.0Z"]').replace(
            '"t"', '"time"'
        ),
    ],
    "clock": [f"clock,{NAMES}\n23:59:59.900,1,2,3,4\n00:00:00.000,5,6,7,8\n"],
    "msg.header.stamp": [ROSBRIDGE],
}
"""Column of times → two samples."""
STARTS = {"time": 1769903999.9, "clock": 86399.9, "msg.header.stamp": 100.9}


def check_samples(path: Path, text: str, mapping: object = (), encoding: str = "utf-8") -> float:
    """Assert that a file holds the two samples; return the time of the first one."""
    path = path / ("log.json" if text[0] in "[{" else "log.csv")
    path.write_bytes(text.encode(encoding))
    log = read_log(path, TURRET, mapping)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, [[1, 2], [5, 6]])
    np.testing.assert_array_equal(held(log.tau), [[3, 4], [7, 8]])
    assert np.diff(log.t) == pytest.approx(0.1, abs=1e-6)
    return float(log.t[0])


@pytest.mark.parametrize("kind", TEXTS)
def test_the_same_samples_are_read_from_any_text(kind: str, tmp_path: Path) -> None:
    check_samples(tmp_path, TEXTS[kind])


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_other_encodings_are_read(encoding: str, tmp_path: Path) -> None:
    text = PLAIN.replace("q_pan", "Winkel [°]")
    check_samples(tmp_path, text, "q_pan=Winkel [°]", encoding)


@pytest.mark.parametrize(
    ("time", "text"), [(time, text) for time, texts in DATED.items() for text in texts]
)
def test_dates_and_times_of_day_are_read_as_seconds(time: str, text: str, tmp_path: Path) -> None:
    """Past midnight too; a date without a zone is in UTC."""
    start = check_samples(tmp_path, text, f"t={time}")
    assert start == pytest.approx(STARTS[time], abs=1e-6)


# --- Stamps and registers -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate", "step", "rounding"),
    [(200, 0.01, np.round), (300, 0.01, np.floor), (2500, 0.001, np.round)],
)
def test_stamps_of_few_digits_are_those_of_evenly_spaced_rows(
    rate: float, step: float, rounding: np.ufunc, tmp_path: Path
) -> None:
    log = planted(np.arange(0, 3, 1 / rate))
    columns = {**log_columns(log), "t": step * rounding(log.t / step + 1e-9)}
    read = read_log(write_csv(columns, tmp_path / "log.csv"), TURRET)
    np.testing.assert_allclose(np.diff(read.t), 1 / rate, rtol=1e-3)
    np.testing.assert_allclose(read.t, log.t, atol=step)
    assert "evenly spaced" in read.events[0]


def test_stamps_that_repeat_unevenly_are_refused_with_the_mapping_by_row(tmp_path: Path) -> None:
    stamps = np.where(T < 1.5, np.round(T, 2), 2 * np.round(T, 2))
    path = write_csv({**log_columns(planted()), "t": stamps}, tmp_path / "log.csv")
    with pytest.raises(LogError, match="repeats the row before") as caught:
        read_log(path, TURRET)
    (entry,) = re.findall(r"--map (t=row\S+)", caught.value.mend)
    log = read_log(path, TURRET, entry)
    np.testing.assert_array_equal(log.q, planted().q)
    assert np.ptp(np.diff(log.t)) < 1e-9


def test_rows_that_lack_a_value_or_repeat_or_come_before_time_goes_on_are_left_out(
    tmp_path: Path,
) -> None:
    log = planted(FEW)
    table = pandas.DataFrame(log_columns(log)).assign(temp_pan=np.nan, temp_tilt=20.0)
    table.loc[[0, 40, 59], "tau_tilt"] = np.nan
    rows = [50, 51, 3, *range(20), 19, *range(20, 60)]
    table.loc[rows].to_csv(tmp_path / "log.csv", index=False)
    read = read_log(tmp_path / "log.csv", TURRET)
    same(read, log.part(np.delete(np.arange(60), [0, 40, 59])))
    told = " ".join(read.events)
    for words in ("3 of 64 rows lack", "3 of 64 rows, is", "rows repeat", "'temp_pan'"):
        assert words in told


@pytest.mark.parametrize("bits", [16, 32])
def test_registers_logged_without_their_sign_are_read_with_it(bits: int, tmp_path: Path) -> None:
    """Counts about the middle of a register are none."""
    log = planted()
    columns = log_columns(replace(log, v=None))
    whole = {name: np.round(1000 * x) for name, x in columns.items() if name != "t"}
    middle = {f"temp_{joint}": 2 ** (bits - 1) + whole[f"q_{joint}"] for joint in log.joints}
    registers = {name: x % 2**bits for name, x in (whole | middle).items()}
    scales = [f"{name}={name}*1e-{3 if name in whole else 9}" for name in registers]
    read = read_log(write_csv({"t": T, **registers}, tmp_path / "log.csv"), TURRET, scales)
    for name, x in log_columns(read).items():
        expected = T if name == "t" else 1e-9 * middle[name] if name in middle else columns[name]
        np.testing.assert_allclose(x, expected, atol=0.51e-3)
    assert f"{bits} bits" in read.events[0]
