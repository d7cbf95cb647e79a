"""What cannot be read is refused in one line that names the file and the place, at once."""

from __future__ import annotations

import gzip
import os
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

from gimbal_pin.errors import DataError, GimbalPinError, LogError, UsageError
from gimbal_pin.log import io, read_imu, read_log, read_motion, write_log
from gimbal_pin.log.io import readers
from gimbal_pin.log.io.csv import unzip
from tests.command_line import Run, refused
from tests.log import bombs
from tests.log.planted import TURRET, planted
from tests.log.test_text import HEADER, PLAIN, ROSTOPIC, ROWS

SOON = 15.0
"""Longest that a damaged file may take, s: a process and a library begin in less than one."""

FILES = [
    ("", ": is empty"),
    ("# nothing\n\n", ": is empty"),
    (f"# x\n{HEADER}\n\n", ":3: .*no rows"),
    ("t,q\0\0", ": is binary"),
    (f"{HEADER}{' ' * 5000}\n{ROWS}" + "\0" * 40, ":4: .*1 values under 5"),
    ("t\n0\n1\n", ":1: .*one column"),
    (ROWS, ": .*no column 't', 'q_pan', .*--map t=column1"),
    ("t,q_pan,tau_pan,tau_tilt\n0,1,2,3\n", ": .*no column 'q_tilt'.*--map q_tilt="),
    ("t,q_pan,q_tilt,iq\n0,1,2,3\n", ": .*no column 'tau_pan', 'tau_tilt'"),
    ("t,q_pan,q_tilt,tau_pan,tau_tilt,dq_tilt\n0,1,2,3,4,5\n", ": .*but not 'dq_pan'"),
    ("gyro_base_x,t,q_pan,q_tilt,tau_pan,tau_tilt\n0,1,2,3,4,5\n", ": .*but not 'gyro_base_y'"),
    ("t,q_pan,q_tilt,tau_pan,tau_tilt,q_pan\n0,1,2,3,4,5\n", ": .*2 columns 'q_pan'"),
    (f"{HEADER}\n0,0,1,1,2,2,3,3,4,4\n", ":2: .*10 values.*decimal commas"),
    (f"{HEADER}\n" + "1," * 2_500_000 + "1\n", ":2: has a line of 5 MB"),
    ("1," * 2_500_000 + "1\n", ":1: has a line of 5 MB"),
    (ROSTOPIC.replace("tilt,pan", "pan,pan"), ":3: names the joints pan, pan"),
]
"""A file's text and how it is refused."""
FLAWS = [
    ("0.2,1,nan,3,4", ":4 column 'q_tilt': is empty or nan"),
    ("0.2,1,,3,4", ":4 column 'q_tilt': is empty or nan"),
    ("0.2,1,2,-inf,4", ":4 column 'tau_pan': is -inf"),
    ("0.2,1,2,1e999,4", ":4 column 'tau_pan': is 1e999"),
    ("# a\n\n0.2,1,2,3,off", ":6 column 'tau_tilt': .*'off'"),
    ("0.2,1,1_0,3,4", ":4 column 'q_tilt': .*'1_0'"),
    ("0.2,1,１,3,4", ":4 column 'q_tilt': .*'１'"),
    ("0.2,1,1.2.3,3,4\r", ":4 column 'q_tilt': .*'1.2.3'"),
    ("0.05,1,2,3,4", ":4 column 't': time goes back from 0.1 to 0.05 s"),
    ("0.1,1,2,3,4", ":4 column 't': .*0.1 s repeats"),
    ("0.2,1,2,3\n0.3,1,2,3,4", ":4: .*4 values under 5"),
    ("0", ":4: .*1 values under 5"),
    ("0.2,1,2,3,4,5", ":4: .*6 values under 5"),
    ('0.2,1,"2,3,4\n2,1,2,3,4', ":4: .*3 values under 5"),
]
"""What stands below two samples, and how it is refused."""


@pytest.mark.parametrize(
    ("text", "said"), [*FILES, *((f"{PLAIN}{flaw}\n", said) for flaw, said in FLAWS)]
)
def test_bad_text_is_refused_by_line_and_column(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LogError, match=f"log.csv{said}") as caught:
        read_log(path, TURRET)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("q_pan", [0.0, np.nan, 1.0], " row 2 column 'q_pan': is empty or nan"),
        ("q_pan", [1, 2, None], " row 3 column 'q_pan': is empty"),
        ("q_pan", ["a", "b", "c"], " column 'q_pan': holds string"),
        ("t", [1.0, 0.5, 2.0], " row 2 column 't': time goes back"),
    ],
)
def test_bad_parquet_is_refused_by_row_and_column(
    column: str, values: list[Any], said: str, tmp_path: Path
) -> None:
    good: dict[str, Any] = {name: [1.0, 2.0, 3.0] for name in HEADER.split(",")}
    parquet.write_table(pyarrow.table({**good, column: values}), tmp_path / "x.parquet")
    with pytest.raises(LogError, match=f"x.parquet{said}"):
        read_log(tmp_path / "x.parquet", TURRET)


@pytest.mark.parametrize(
    ("name", "text", "kind", "said"),
    [
        ("none.csv", None, LogError, "does not exist"),
        ("none.csv@cinema", None, LogError, "none.csv: does not exist"),
        ("log.xyz", PLAIN, UsageError, r"suffix '\.xyz'"),
        ("log", PLAIN, UsageError, "no suffix"),
        ("log.csv@", None, UsageError, "names no payload"),
        ("x.parquet", "PAR1 no", LogError, "is not Parquet"),
        ("x.json", "[" * 100_000, LogError, "nested too deep|is not JSON"),
        ("x.json", '{"t": [0, 1', LogError, "is not JSON"),
        ("x.json", '{"t": 0}\n{"t": 1\n{"t": 2}\n', LogError, "is not JSON"),
        ("x.json", '{"rig": "turret", "notes": ["a", "b"]}', LogError, "no columns of numbers"),
        ("x.json", '[{"t": 1' + "0" * 400 + "}]", LogError, "no columns of numbers"),
        ("x.log", "(1.000000) can0 123#DEADBEEF\n", LogError, "DBC"),
    ],
)
def test_bad_files_are_refused_in_one_line(
    name: str, text: str | None, kind: type[GimbalPinError], said: str, tmp_path: Path
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(kind, match=said) as caught:
        read_log(tmp_path / name, TURRET)
    assert "\n" not in str(caught.value)


def test_what_is_no_motion_or_imu_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("t,q_pan,q_tilt\n0,1,2\n")
    with pytest.raises(LogError, match="one row and no rates"):
        read_motion(path, TURRET)
    with pytest.raises(LogError, match="no column gyro_base_x"):
        read_imu(path, TURRET, "base")
    for text in (path.read_text(), ROSTOPIC.replace("3,4\n", ",\n").replace("8,7\n", ",\n")):
        path.write_text(text)
        with pytest.raises(DataError, match="no torque"):
            read_log(path, TURRET)
    with pytest.raises(UsageError, match=r"suffix '\.xls'"):
        write_log(planted(), tmp_path / "x.xls")
    assert list(tmp_path.iterdir()) == [path]


def test_objects_and_shapes_that_are_not_there_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}, 1], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "objects.npz", t=np.array([[], 1], dtype=object))
    np.save(tmp_path / "line.npy", np.zeros(9))
    huge = (tmp_path / "line.npy").read_bytes().replace(b"(9,), }      ", b"(10000000, 9)")
    (tmp_path / "huge.npy").write_bytes(huge)
    said = {"objects.npy": "objects", "objects.npz": "objects", "line.npy": "1 dimension"}
    for name, word in {**said, "huge.npy": "damaged"}.items():
        with pytest.raises(LogError, match=word):
            read_log(tmp_path / name, TURRET)


# --- What would take all memory or all time -----------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.npz", lambda: bombs.npz(bombs.FULL), "holds more than"),
        ("lying.npz", lambda: bombs.npz(1000), "damaged"),
        ("x.h5", bombs.hdf5, "holds more than"),
    ],
)
def test_what_unfolds_without_measure_is_refused(
    name: str, content: Any, said: str, tmp_path: Path
) -> None:
    """Kilobytes that stand for gigabytes are refused before these are in memory."""
    (tmp_path / name).write_bytes(content())
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogError, match=said):
        (table := io.open_table(tmp_path / name)).read(table.columns)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 2**30 / 1024


def test_gzip_is_unfolded_no_further_than_a_log_may_be_long() -> None:
    with pytest.raises(LogError, match="holds more than"):
        unzip(gzip.compress(bytes(2**20)), "x.csv.gz", most=2**20 - 1)


@pytest.mark.parametrize("name", ["x.mat", "x.bag", "x.csv", "x.parquet", "x.npz"])
def test_a_pipe_that_nobody_fills_and_a_file_without_end_are_refused_at_once(
    name: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / name)
    (tmp_path / f"end{name}").symlink_to("/dev/zero")
    for path in (tmp_path / name, tmp_path / f"end{name}"):
        start = time.perf_counter()
        with pytest.raises(GimbalPinError):
            read_log(path, TURRET)
        assert time.perf_counter() - start < SOON


def test_a_missing_library_is_one_line(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.bag").write_text("")
    monkeypatch.setattr(readers, "find_spec", lambda module: None)
    refused(run("identify", "turret", tmp_path / "x.bag"), 2, "pip install 'gimbal_pin[ros]'")
