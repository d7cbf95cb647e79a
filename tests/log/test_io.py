"""Files: what is written reads back exactly, and what cannot be read says where and how to mend it."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gimbal_pin.errors import DataError, GimbalPinError, LogError, UsageError
from gimbal_pin.log import (
    PLAUSIBLE_RANGES,
    Imu,
    Log,
    Motion,
    Source,
    io,
    parse_expression,
    read_mapping,
)
from gimbal_pin.log.io import columns, csv, files, units
from gimbal_pin.log.log import find_untimely
from gimbal_pin.log.mapping import parse_entry
from gimbal_pin.rig import Rig, reading
from tests.rigs import spelled

DATA = Path(__file__).parents[3] / "shared" / "data"

LINK = (
    '<link name="{0}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1.5" upper="1.5" effort="10" velocity="1"/></joint>'
)
URDF = (
    '<robot name="two"><link name="base"/>'
    + LINK.format("arm")
    + LINK.format("head")
    + JOINT.format("yaw", "base", "arm")
    + JOINT.format("tilt", "arm", "head")
    + "</robot>"
)
PARQUET = pytest.param(
    ".parquet",
    marks=pytest.mark.skipif(
        find_spec("pyarrow") is None, reason="needs pyarrow: gimbal_pin[parquet]"
    ),
)
HEADER = "t,q_yaw,q_tilt,tau_yaw,tau_tilt"
ROWS = "0.0,1,2,3,4\n0.1,5,6,7,8\n"


@pytest.fixture
def rig() -> Rig:
    """Two joints, three links."""
    return spelled(URDF)


def same(a: Log, b: Log) -> None:
    """Assert that two logs hold the same numbers, bit by bit."""
    assert a.joints == b.joints
    for name in ("t", "q", "v", "tau", "q_ref", "temperature"):
        identical(getattr(a, name), getattr(b, name))
    assert a.imus.keys() == b.imus.keys()
    for link in a.imus:
        for name in ("gyro", "accel", "quat"):
            identical(getattr(a.imus[link], name), getattr(b.imus[link], name))


def identical(a: np.ndarray | None, b: np.ndarray | None) -> None:
    """Assert bit-wise equality, signs of zeros included."""
    assert (a is None) == (b is None)
    if a is not None and b is not None:
        assert a.shape == b.shape and a.tobytes() == b.tobytes()


def held(values: np.ndarray | None) -> np.ndarray:
    """Return an array that must be there."""
    assert values is not None
    return values


TIMES = (
    st.lists(st.floats(-5e5, 5e5), min_size=1, max_size=5)
    .map(sorted)
    .filter(lambda t: find_untimely(np.array(t)) is None)
)


def maybe(strategy: st.SearchStrategy) -> st.SearchStrategy:
    """Return a strategy for a value or None."""
    return st.none() | strategy


def block(channel: str, rows: int, width: int) -> st.SearchStrategy:
    """Return a strategy for any values that a channel can have."""
    lower, upper, _ = PLAUSIBLE_RANGES[channel]
    return hnp.arrays(
        np.float64,
        (rows, width),
        elements=st.floats(lower, upper).filter(lambda x: x == 0.0 or abs(x) >= 1e-40),
    )


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Draw a log of the rig with any subset of channels and any numbers that a machine may have."""
    t = np.array(draw(TIMES))

    imus = {}
    for link in draw(st.sets(st.sampled_from(["base", "arm", "head"]))):
        imu = Imu(
            *(
                draw(maybe(block(name, len(t), width)))
                for name, width in (("gyro", 3), ("accel", 3), ("quat", 4))
            )
        )
        if any(part is not None for part in (imu.gyro, imu.accel, imu.quat)):
            imus[link] = imu
    joint = [draw(maybe(block(name, len(t), 2))) for name in ("v", "tau", "q_ref", "temperature")]
    return Log("drawn", ("yaw", "tilt"), t, draw(block("q", len(t), 2)), *joint, imus)


@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".txt", PARQUET])
@given(log=logs())
def test_log_reads_back_exactly(suffix: str, log: Log, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / f"log{suffix}"
    io.write_log(log, path)
    same(io.read_log(path, rig, need_tau=False), log)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".csv", PARQUET])
@given(log=logs(), data=st.data())
def test_motion_reads_back_exactly(
    suffix: str, log: Log, data: st.DataObject, rig: Rig, tmp_path: Path
) -> None:
    v, a = (data.draw(block(name, *log.q.shape)) for name in ("v", "a"))
    motion = Motion(log.t, log.q, v, a)
    io.write_motion(motion, rig.joints, tmp_path / f"m{suffix}")
    back = io.read_motion(tmp_path / f"m{suffix}", rig)
    for name in ("t", "q", "v", "a"):
        identical(getattr(back, name), getattr(motion, name))


@pytest.mark.parametrize(
    ("before", "line"), [("", 1), (f"{HEADER}\n", 2), (f"{HEADER}\n{ROWS}", 4)]
)
def test_a_line_that_is_longer_than_any_row_is_named_at_once(
    before: str, line: int, rig: Rig, tmp_path: Path
) -> None:
    """Fields are not counted in it, nor names: of 50 MB that takes a minute."""
    (tmp_path / "x.csv").write_text(before + "1," * 2_500_000 + "1\n")
    with pytest.raises(LogError, match=rf"x.csv:{line}: has a line of 5 MB"):
        io.read_log(tmp_path / "x.csv", rig)


def test_columns_are_the_contracts(tmp_path: Path) -> None:
    n = np.zeros((2, 2))
    imu = Imu(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 4)))
    io.write_log(
        Log("x", ("yaw", "tilt"), np.arange(2.0), n, n, n, n, n, {"head": imu}), tmp_path / "x.csv"
    )
    assert (tmp_path / "x.csv").read_text().splitlines()[0] == (
        "t,q_yaw,q_tilt,dq_yaw,dq_tilt,tau_yaw,tau_tilt,q_ref_yaw,q_ref_tilt,temp_yaw,temp_tilt,"
        "gyro_head_x,gyro_head_y,gyro_head_z,accel_head_x,accel_head_y,accel_head_z,"
        "quat_head_w,quat_head_x,quat_head_y,quat_head_z"
    )


# Ways to write the same two samples.
DIALECTS = {
    "plain": f"{HEADER}\n{ROWS}",
    "crlf": f"{HEADER}\n{ROWS}".replace("\n", "\r\n"),
    "lone cr": f"{HEADER}\n{ROWS}".replace("\n", "\r"),
    "bom": f"\ufeff{HEADER}\n{ROWS}",
    "semicolon": f"{HEADER}\n{ROWS}".replace(",", ";"),
    "tab": f"{HEADER}\n{ROWS}".replace(",", "\t"),
    "spaces": f"{HEADER}\n{ROWS}".replace(",", " , "),
    "quoted": '"t", "q_yaw","q_tilt","tau_yaw","tau_tilt"\n' + '"0.0",1,2,3,4\n0.1,"5",6,7,8',
    "comments": f"# a drive's log\n\n{HEADER}\n  # start, now\n0.0,1,2,3,4\n\n#,,\n{ROWS.splitlines()[1]}\n \n# end",
    "savetxt": f"# by savetxt\n# {HEADER}\n{ROWS}",
    "trailing": f"{HEADER}\n{ROWS}".replace("\n", ",\n"),
    "trailing rows only": HEADER + "\n" + ROWS.replace("\n", ",\n"),
    "other columns": f"state,{HEADER},note\n"
    + "".join(f'ok,{row},"a, b #1"\n' for row in ROWS.splitlines()),
    "other order": "tau_tilt,t,q_tilt,q_yaw,tau_yaw\n4,0.0,2,1,3\n8,0.1,6,5,7\n",
    "decimal commas": f"{HEADER}\n{ROWS}".replace(",", ";").replace(".", ","),
    "decimal commas and tabs": f"{HEADER}\n{ROWS}".replace(",", "\t").replace(".", ","),
    "exponents": f"{HEADER}\n0,1e0,+2.,3.0E+0,40e-1\n100e-3,5,6,7,8\n",
}


@pytest.mark.parametrize("block", [1, csv.BLOCK])
@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS.keys())
def test_dialects_mean_the_same(
    text: str, block: int, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv, "BLOCK", block)
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    log = io.read_log(path, rig)
    np.testing.assert_array_equal(log.t, [0.0, 0.1])
    np.testing.assert_array_equal(log.q, [[1, 2], [5, 6]])
    np.testing.assert_array_equal(log.tau, [[3, 4], [7, 8]])
    assert log.v is None and not log.imus and log.events == () and log.joints == ("yaw", "tilt")


def test_utf16_and_latin1_headers(rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(
        f"{HEADER},Winkel [°]\n".encode("latin-1") + ROWS.replace("\n", ",1\n").encode()
    )
    latin = io.read_log(path, rig, ["q_yaw=Winkel [°]"])
    np.testing.assert_array_equal(latin.q[:, 0], [1, 1])
    path.write_bytes(f"{HEADER}\n{ROWS}".encode("utf-16"))
    np.testing.assert_array_equal(io.read_log(path, rig).q, [[1, 2], [5, 6]])


# content, place behind the file's name, what, mend. The place's line is the one that an editor shows.
BAD = {
    "empty": ("", "", "is empty", "give a file with a header"),
    "comments only": ("# nothing\n\n", "", "is empty", "header"),
    "no rows": (f"# x\n{HEADER}\n\n", ":3", "no rows", "samples"),
    "binary": ("t,q\0\0", "", "is binary", "suffix"),
    "one column": ("t\n0\n1\n", ":1", "one column", "commas, semicolons or tabs"),
    "no header": (
        ROWS,
        "",
        "no column 't', 'q_yaw', 'q_tilt', 'tau_yaw', 'tau_tilt' (its columns: 'column1', 'column2'",
        "--map",
    ),
    "no q": (
        "t,q_yaw,tau_yaw,tau_tilt\n0,1,2,3\n",
        "",
        "no column 'q_tilt' (its columns: 't', 'q_yaw', 'tau",
        "--map q_tilt=",
    ),
    "no t": (
        "time,q_yaw,q_tilt,tau_yaw,tau_tilt\n0,1,2,3,4\n",
        "",
        "no column 't' (its columns: 'time'",
        "--map t=",
    ),
    "no tau": (
        "t,q_yaw,q_tilt,iq\n0,1,2,3\n",
        "",
        "no column 'tau_yaw', 'tau_tilt'",
        "--map tau_yaw=",
    ),
    "one dq": (
        f"{HEADER},dq_tilt\n0,1,2,3,4,5\n",
        "",
        "has column 'dq_tilt' but not 'dq_yaw'",
        "whole group",
    ),
    "part of imu": (
        f"{HEADER},gyro_arm_x,gyro_arm_z\n0,1,2,3,4,5,6\n",
        "",
        "but not 'gyro_arm_y'",
        "whole group",
    ),
    "twice": (f"{HEADER},q_yaw\n0,1,2,3,4,5\n", "", "has 2 columns 'q_yaw'", "rename"),
    "nan": (
        f"{HEADER}\n{ROWS}0.2,1,nan,3,4\n",
        ":4 column 'q_tilt'",
        "is empty or nan",
        "delete the row",
    ),
    "inf": (
        f"{HEADER}\n{ROWS}0.2,1,2,-inf,4\n",
        ":4 column 'tau_yaw'",
        "is -inf",
        "delete the row",
    ),
    "overflow": (
        f"{HEADER}\n{ROWS}0.2,1,2,1e999,4\n",
        ":4 column 'tau_yaw'",
        "is 1e999",
        "delete the row",
    ),
    "empty field": (
        f"{HEADER}\n{ROWS}0.2,1,,3,4\n",
        ":4 column 'q_tilt'",
        "is empty or nan",
        "fill it in",
    ),
    "text": (
        f"{HEADER}\n# a\n\n0.0,1,2,3,4\n0.2,1,2,3,off\n",
        ":5 column 'tau_tilt'",
        "text 'off'",
        "write a number",
    ),
    "NA": (f"{HEADER}\n0.0,1,NA,3,4\n", ":2 column 'q_tilt'", "text 'NA'", "write a number"),
    "groups": (f"{HEADER}\n0.0,1,1_0,3,4\n", ":2 column 'q_tilt'", "text '1_0'", "write a number"),
    "other digits": (
        f"{HEADER}\n0.0,1,１,3,4\n",
        ":2 column 'q_tilt'",
        "text '１'",
        "write a number",
    ),
    "zeros at the end": (
        f"{HEADER}{' ' * 5000}\n{ROWS}" + "\0" * 40,
        ":4",
        "1 values under 5 column names",
        "cut off",
    ),
    "two dots": (
        f"{HEADER}\n0.0,1,2,3,4\r\n0.1,1,1.2.3,3,4\r\n",
        ":3 column 'q_tilt'",
        "text '1.2.3'",
        "write a number",
    ),
    "back": (
        f"{HEADER}\n\n{ROWS}0.05,1,2,3,4\n",
        ":5 column 't'",
        "goes back from 0.1 to 0.05 s",
        "sort the rows",
    ),
    "repeated": (
        f"{HEADER}\n{ROWS}0.1,1,2,3,4\n",
        ":4 column 't'",
        "0.1 s repeats",
        "--map t=row*0.05",
    ),
    "short": (
        f"{HEADER}\n{ROWS}0.2,1,2,3\n0.3,1,2,3,4\n",
        ":4",
        "4 values under 5 column names",
        "complete the row",
    ),
    "cut off": (f"{HEADER}\n{ROWS}0", ":4", "1 values under 5 column names", "complete the row"),
    "long": (f"{HEADER}\n{ROWS}0.2,1,2,3,4,5\n", ":4", "6 values under 5 column names", "surplus"),
    "short and long": (
        f"{HEADER}\n0,1,2,3\n1,1,2,3,4,5\n",
        ":2",
        "4 values under 5",
        "complete the row",
    ),
    "commas": (
        f"{HEADER}\n0,0,1,1,2,2,3,3,4,4\n",
        ":2",
        "10 values under 5 column names",
        "decimal commas must be points",
    ),
    "mixed decimals": (
        f"{HEADER}\n".replace(",", ";") + "0;1;2;3,5;4\n0,1;1;2;3.5;4\n",
        ":3 column 'tau_yaw'",
        "text '3.5'",
        "write a number",
    ),
    "endless field": (f'{HEADER}\n{ROWS}0.2,"{"x" * 200000}\n', ":4", "is not CSV", "quotes"),
    "quotes": (
        f'{HEADER}\n0,1,2,3,4\n1,1,"2,3,4\n2,1,2,3,4\n',
        ":3",
        "3 values under 5",
        "complete the row",
    ),
}


@pytest.mark.parametrize(("content", "place", "what", "mend"), BAD.values(), ids=BAD.keys())
def test_bad_csv_says_where_and_how(
    content: str, place: str, what: str, mend: str, rig: Rig, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content.encode())
    with pytest.raises(LogError) as caught:
        io.read_log(path, rig)
    assert caught.value.place == f"{path}{place}"
    assert what in caught.value.what and mend in caught.value.mend
    assert caught.value.exit_code == 2 and "\n" not in str(caught.value)


def test_a_log_that_records_no_torque_cannot_answer(rig: Rig, tmp_path: Path) -> None:
    """Every column is something else, so that no mapping mends it."""
    (tmp_path / "log.csv").write_text("t,q_yaw,q_tilt\n0,1,2\n")
    with pytest.raises(DataError, match="no torque"):
        io.read_log(tmp_path / "log.csv", rig)
    assert io.read_log(tmp_path / "log.csv", rig, need_tau=False).tau is None


@given(
    row=st.integers(0, 30),
    place=st.integers(0, 4),
    junk=st.sampled_from(["", "nan", "x", "1,0", '"1,5"', "1;2"]),
    block=st.sampled_from([1, 30, 200, csv.BLOCK]),
    blanks=st.sets(st.integers(0, 30)),
)
def test_the_line_is_the_editors(
    row: int, place: int, junk: str, block: int, blanks: set[int], rig: Rig, tmp_path: Path
) -> None:
    rows = [[f"{i / 10}", "1", "2", "3", "4"] for i in range(31)]
    rows[row][place] = junk
    lines = ["# log", HEADER]
    for i, fields in enumerate(rows):
        lines += ["", "# pause"] if i in blanks else []
        lines.append(",".join(fields))
    expected = lines.index(",".join(rows[row])) + 1
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv, "BLOCK", block)
        if junk in ("", "nan"):  # one value of so many rows is left out, and told
            told = io.read_log(path, rig).events[0].partition(": ")[0]
        else:
            with pytest.raises(LogError) as caught:
                io.read_log(path, rig)
            told = caught.value.place
    assert told.startswith(f"{path}:{expected}")
    assert re.fullmatch(r":\d+( column '\w+')?", told.removeprefix(str(path)))


BAD_CALLS = {
    "missing file": ("none.csv", [], LogError, "none.csv", "does not exist", "path of a file"),
    "missing with tag": ("none.csv@cinema", [], LogError, "none.csv", "does not exist", "path"),
    "folder": ("folder.csv", [], LogError, "folder.csv", "cannot be read", "file"),
    "suffix": ("log.xyz", [], UsageError, "log.xyz", "suffix '.xyz'", ".csv, .tsv, .txt, .parquet"),
    "no suffix": ("log", [], UsageError, "log", "no suffix", ".csv"),
    "empty tag": ("log.csv@", [], UsageError, "log.csv@", "names no payload", "PAYLOAD"),
    "no such source": (
        "log.csv",
        ["q_yaw=pos9"],
        LogError,
        "log.csv",
        "no column 'pos9', which mapping 'q_yaw=pos9' names",
        "there",
    ),
    "unknown joint": (
        "log.csv",
        ["q_pan=q_yaw"],
        UsageError,
        "mapping 'q_pan=q_yaw'",
        "'q_pan' is no column",
        "joints yaw, tilt",
    ),
    "unknown link": (
        "log.csv",
        ["gyro_nose_x=q_yaw"],
        UsageError,
        "mapping 'gyro_nose_x=q_yaw'",
        "no column of this rig",
        "links",
    ),
    "no equals": (
        "log.csv",
        ["q_yaw"],
        UsageError,
        "mapping 'q_yaw'",
        "not of the form",
        "q_yaw=pos1*pi/180",
    ),
    "no target": ("log.csv", ["=pos"], UsageError, "mapping '=pos'", "not of the form", "pos1"),
    "no source": (
        "log.csv",
        ["q_yaw="],
        UsageError,
        "mapping 'q_yaw='",
        "is not one column",
        "pos*2*pi/4096",
    ),
    "exchanged with no joint": (
        "log.csv",
        ["nose,tilt=tilt,nose"],
        UsageError,
        "mapping",
        "'q_nose' is no column",
        "joints yaw, tilt",
    ),
    "one column for two joints": (
        "log.csv",
        ["q_yaw=q_tilt*-1"],
        UsageError,
        "mapping 'q_yaw=q_tilt*-1'",
        "column 'q_tilt' is both q_yaw and q_tilt",
        "of its own",
    ),
    "no yaml": ("log.csv", ["no.yaml"], UsageError, "no.yaml", "does not exist", "path"),
    "broken yaml": (
        "log.csv",
        ["broken.yaml"],
        UsageError,
        "broken.yaml:2",
        "is not YAML",
        "mend that line",
    ),
    "twice in yaml": (
        "log.csv",
        ["twice.yaml"],
        UsageError,
        "twice.yaml:3",
        "'t' stands twice",
        "mend that line",
    ),
    "list in yaml": ("log.csv", ["list.yaml"], UsageError, "list.yaml", "no table", "q_yaw: pos1"),
    "number in yaml": (
        "log.csv",
        ["number.yaml"],
        UsageError,
        "number.yaml: t",
        "maps to 5",
        "quote it",
    ),
    "bad yaml entry": (
        "log.csv",
        ["entry.yaml"],
        UsageError,
        "entry.yaml: t",
        "has the factor 0",
        "finite",
    ),
    "unreadable parquet": ("bad.parquet", [], LogError, "bad.parquet", "is not Parquet", "suffix"),
    "nan parquet": (
        "nan.parquet",
        [],
        LogError,
        "nan.parquet row 2 column 'q_yaw'",
        "or nan",
        "fill it in",
    ),
    "null parquet": (
        "null.parquet",
        [],
        LogError,
        "null.parquet row 3 column 'q_yaw'",
        "is empty",
        "fill it in",
    ),
    "text parquet": (
        "text.parquet",
        [],
        LogError,
        "text.parquet column 'q_yaw'",
        "holds string",
        "float64",
    ),
    "time parquet": (
        "time.parquet",
        [],
        LogError,
        "time.parquet row 2 column 't'",
        "goes back",
        "sort",
    ),
    "empty parquet": ("empty.parquet", [], LogError, "empty.parquet", "has no rows", "samples"),
    "missing in parquet": (
        "part.parquet",
        [],
        LogError,
        "part.parquet",
        "no column 'q_tilt'",
        "--map q_tilt=",
    ),
}


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of files good and bad."""
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    folder = tmp_path_factory.mktemp("corpus")
    (folder / "folder.csv").mkdir()
    texts = {
        "log.csv": f"{HEADER}\n{ROWS}",
        "log.xyz": HEADER,
        "log": HEADER,
        "bad.parquet": "PAR1 no",
        "list.yaml": "- t=x\n",
        "broken.yaml": "t: x\nq: [}\n",
        "twice.yaml": "t: x\nq_yaw: a\nt: y\n",
        "number.yaml": "t: 5\n",
        "entry.yaml": "t: x*0\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    good: dict[str, object] = {
        "t": [0.0, 1.0, 2.0],
        **{name: [1, 2, 3] for name in HEADER.split(",")[1:]},
    }
    tables: dict[str, dict[str, object]] = {
        "nan": {"q_yaw": [0.0, math.nan, 1.0]},
        "null": {"q_yaw": [1, 2, None]},
        "text": {"q_yaw": ["a", "b", "c"]},
        "time": {"t": [1.0, 0.5, 2.0]},
        "empty": {name: pyarrow.array([], pyarrow.float64()) for name in good},
        "good": {},
    }
    for name, change in tables.items():
        parquet.write_table(pyarrow.table({**good, **change}), folder / f"{name}.parquet")
    parquet.write_table(
        pyarrow.table({name: good[name] for name in ("t", "q_yaw", "tau_yaw", "tau_tilt")}),
        folder / "part.parquet",
    )
    return folder


@pytest.mark.parametrize(
    ("name", "mapping", "kind", "place", "what", "mend"), BAD_CALLS.values(), ids=BAD_CALLS.keys()
)
def test_bad_files_and_mappings(
    name: str,
    mapping: list[str],
    kind: type[GimbalPinError],
    place: str,
    what: str,
    mend: str,
    rig: Rig,
    corpus: Path,
) -> None:
    entries = [str(corpus / entry) if entry.endswith(".yaml") else entry for entry in mapping]
    with pytest.raises(kind) as caught:
        io.read_log(corpus / name, rig, entries)
    assert caught.value.place.removeprefix(f"{corpus}{os.sep}") == place
    assert what in caught.value.what and mend in caught.value.mend
    assert caught.value.exit_code == 2 and "\n" not in str(caught.value)


def test_parquet_without_pyarrow_says_what_to_install(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.delitem(sys.modules, "pyarrow.parquet", raising=False)
    with pytest.raises(
        UsageError,
        match=r"needs the package pyarrow; install it \(pip install 'gimbal_pin\[parquet\]'\)",
    ):
        io.read_log(tmp_path / "x.parquet", rig)


def test_parquet_of_other_number_types(rig: Rig, corpus: Path) -> None:
    log = io.read_log(corpus / "good.parquet", rig)
    np.testing.assert_array_equal(log.q, [[1, 1], [2, 2], [3, 3]])
    assert log.q.dtype == np.float64


EXPRESSIONS = {
    "pos": ("pos", 1.0),
    " pos [rad] ": ("pos [rad]", 1.0),
    "iq_a*0.0276": ("iq_a", 0.0276),
    "0.0276*iq_a": ("iq_a", 0.0276),
    "time_us*1e-6": ("time_us", 1e-6),
    "deg*pi/180": ("deg", math.pi / 180),
    "pi/180*deg": ("deg", math.pi / 180),
    "deg / 180 * pi": ("deg", math.pi / 180),
    "2*pi*turns/8192": ("turns", 2 * math.pi / 8192),
    "-pos": ("pos", -1.0),
    "-2*-pos*+.5": ("pos", 1.0),
    "-pi*pos": ("pos", -math.pi),
    "pitch*2": ("pitch", 2.0),
    "2x*3": ("2x", 3.0),
    "/joint_states/velocity/0.5": ("/joint_states/velocity", 2.0),
    '"a*b"*2': ("a*b", 2.0),
    "'-1'": ("-1", 1.0),
    '"rate deg/2"/2': ("rate deg/2", 0.5),
    "Gyr (x)*pi/180": ("Gyr (x)", math.pi / 180),
    "left-arm/2": ("left-arm", 0.5),
    "pos-1": ("pos-1", 1.0),
}
OFFSETS = {
    "pos*2*pi/4096-pi": ("pos", 2 * math.pi / 4096, -math.pi),
    "pos-pi/2": ("pos", 1.0, -math.pi / 2),
    "pos - 2048": ("pos", 1.0, -2048.0),
    "(pos-2048)*2*pi/4096": ("pos", 2 * math.pi / 4096, -math.pi),
    "-2*(pos*0.5 + 1e-3)": ("pos", -1.0, -2e-3),
    '"a - b"-1+0.5': ("a - b", 1.0, -0.5),
}


@pytest.mark.parametrize(("text", "expected"), OFFSETS.items(), ids=OFFSETS.keys())
def test_expressions_with_an_offset(text: str, expected: tuple[str, float, float]) -> None:
    source = parse_expression(text, "here")
    assert source.column == expected[0]
    assert (source.factor, source.offset) == pytest.approx(expected[1:], rel=1e-15)
    assert source.convert(np.array([3.0])) == pytest.approx([3 * expected[1] + expected[2]])
    again = parse_expression(source.times(-2.0), "here")
    assert (again.factor, again.offset) == pytest.approx([-2 * x for x in expected[1:]], rel=1e-11)


@pytest.mark.parametrize(("text", "expected"), EXPRESSIONS.items(), ids=EXPRESSIONS.keys())
def test_expressions(text: str, expected: tuple[str, float]) -> None:
    source = parse_expression(text, "here")
    assert source.column == expected[0]
    assert source.factor == pytest.approx(expected[1], rel=1e-15, abs=0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "3",
        "2*3",
        "pi",
        "a*b",
        "pos*(pi/180)",
        "pos**2",
        "*2",
        "pos*",
        "a*2+3*b",
        "pos*0",
        "0*pos",
        "pos/0",
        "pos*1e999",
        "pos/1e-320/1e-10",
        '"pos',
        '""',
        "__import__('os')*2*x",
    ],
)
def test_expressions_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match=r"^here: "):
        parse_expression(text, "here")


factors = st.floats(1e-6, 1e6) | st.integers(1, 10**6).map(float)
names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_ .\[\]()]{0,8}[A-Za-z0-9_\])]", fullmatch=True).filter(
    lambda name: name != "pi"
)


@given(
    name=names,
    terms=st.lists(st.tuples(st.sampled_from("*/"), factors | st.just(math.pi)), max_size=4),
    quoted=st.booleans(),
)
def test_product_law(name: str, terms: list[tuple[str, float]], quoted: bool) -> None:
    text = (f'"{name}"' if quoted else name) + "".join(
        f" {op} {'pi' if factor == math.pi else factor}" for op, factor in terms
    )
    logarithm = sum((1 if op == "*" else -1) * math.log(factor) for op, factor in terms)
    source = parse_expression(text, "")
    assert source.column == name
    assert math.log(source.factor) == pytest.approx(logarithm, abs=1e-12)


@given(st.text(max_size=30))
def test_any_entry_parses_or_is_refused(entry: str) -> None:
    try:
        target, source = parse_entry(entry)
    except UsageError as error:
        assert "\n" not in str(error)
    else:
        assert target and source.column and math.isfinite(source.factor) and source.factor != 0


def test_a_mapping_of_any_length_is_answered_at_once() -> None:
    with pytest.raises(UsageError, match="has 300004 characters"):
        read_mapping([f"q_pan=pos*{'9' * 300_000}"])


def test_yaml_maps_like_entries(tmp_path: Path) -> None:
    entries = {"t": "time_us*1e-6", "q_yaw": '"pos [deg]"*pi/180', "tau_yaw": "-iq/2"}
    files.write_yaml(entries, tmp_path / "map.yaml")
    stated = read_mapping([f"{target}={text}" for target, text in entries.items()])
    stored = read_mapping([tmp_path / "map.yaml"])
    assert [(k, s.column, s.factor) for k, s in stored.items()] == [
        (k, s.column, s.factor) for k, s in stated.items()
    ]
    over = read_mapping(["t=ticks", str(tmp_path / "map.yaml"), "t=clock"])
    assert over["t"] == Source("clock", 1.0, "mapping 't=clock'") and over["tau_yaw"].factor == -0.5


@given(
    scale=st.floats(1e-3, 1e3),
    data=hnp.arrays(np.float64, (4, 4), elements=st.floats(-100, 100).map(lambda x: round(x, 12))),
)
def test_mapping_scales_columns(scale: float, data: np.ndarray, rig: Rig, tmp_path: Path) -> None:
    columns = dict(zip(("us", "a", "b", "c", "d"), np.vstack([np.arange(4) * 2000.0, data.T])))
    csv.write_csv(columns, tmp_path / "x.csv")
    mapping = ["t=us*1e-6", "q_yaw=a", f"q_tilt=d*{scale!r}", f"tau_yaw=b/{scale!r}", "tau_tilt=-c"]
    log = io.read_log(tmp_path / "x.csv", rig, mapping)
    np.testing.assert_array_equal(log.t, columns["us"] * 1e-6)
    np.testing.assert_array_equal(log.q, np.column_stack([columns["a"], columns["d"] * scale]))
    np.testing.assert_allclose(
        held(log.tau), np.column_stack([columns["b"] / scale, -columns["c"]]), rtol=1e-14, atol=0
    )


def test_mapping_stands_above_a_column_of_that_name(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(f"{HEADER}\n{ROWS}")
    log = io.read_log(tmp_path / "x.csv", rig, ["q_yaw=q_tilt", "q_tilt=q_yaw"])
    np.testing.assert_array_equal(log.q, [[2, 1], [6, 5]])


def test_payload_tag(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"{HEADER}\n{ROWS}")
    tagged = io.read_log(f"{tmp_path / 'log.csv'}@cinema", rig)
    assert tagged.payload == "cinema" and tagged.name == str(tmp_path / "log.csv")
    assert io.split_payload("a.csv@parts/cam.urdf") == (Path("a.csv"), "parts/cam.urdf")
    assert io.split_payload("me@home/a.csv") == (Path("me@home/a.csv"), None)
    real = tmp_path / "log.csv@cinema.csv"
    real.write_text(f"{HEADER}\n{ROWS}")
    assert io.read_log(real, rig).payload is None
    assert io.read_log(real, rig).name == str(real)


def test_only_links_of_the_rig(rig: Rig, tmp_path: Path) -> None:
    gyro = ",".join(f"gyro_{link}_{axis}" for link in ("arm", "nose") for axis in "xyz")
    (tmp_path / "x.csv").write_text(f"{HEADER},{gyro}\n0,1,2,3,4,5,6,7,8,9,10\n")
    log = io.read_log(tmp_path / "x.csv", rig)
    assert list(log.imus) == ["arm"]
    np.testing.assert_array_equal(log.imus["arm"].gyro, [[5, 6, 7]])
    assert log.imus["arm"].accel is None


def test_torque_far_beyond_the_motor_is_mentioned(rig: Rig, tmp_path: Path) -> None:
    limit = float(rig.tau_max[0])
    for size, count in ((1.2 * limit, 0), (1e3 * limit, 1)):
        (tmp_path / "x.csv").write_text(f"{HEADER}\n0,1,2,{size},0\n1,1,2,{-size},0\n")
        assert len(io.read_log(tmp_path / "x.csv", rig).events) == count


def test_degrees_are_refused_only_where_sure(rig: Rig, tmp_path: Path) -> None:
    """Ten degrees of travel are more than any joint has radians; a turn counted twice or a few spikes are none."""
    path = tmp_path / "x.csv"
    path.write_text(f"{HEADER}\n" + "".join(f"{k},{80 - 3 * k},1.4,0.3,0.4\n" for k in range(55)))
    with pytest.raises(
        LogError, match=r"x\.csv: q_yaw travels .* degrees.* --map 'q_yaw=q_yaw\*pi/180'$"
    ):
        io.read_log(path, rig)
    assert io.read_log(path, rig, ["q_yaw=q_yaw*pi/180"]).events == ()
    t = np.linspace(0, 10, 1001)
    q = np.stack([np.sin(t) + 2 * np.pi * (t > 5), 0.3 * np.sin(2 * t)], axis=1)
    q[[100, 500]] = 900.0
    units.check_units("x", rig, t, q, None)
    with pytest.raises(LogError, match="counts or another unit"):
        units.check_units("x", rig, t, 1e4 * q, None)


def test_a_joint_that_its_loop_has_lost_is_no_matter_of_units(rig: Rig) -> None:
    """Where the reference stays within the limits and the angle leaves them, it goes along in another unit, or not."""
    t = np.linspace(0, 10, 1001)
    asked = np.stack([np.sin(t), 0.3 * np.sin(2 * t)], axis=1)
    with pytest.raises(LogError, match="degrees"):
        units.check_units("x", rig, t, np.degrees(asked), None, asked)
    with pytest.raises(
        LogError, match=r"q_yaw travels .*, and not as q_ref_yaw; the loop lost the joint"
    ):
        units.check_units("x", rig, t, asked + np.outer(t**2, [1.0, 0.0]), None, asked)
    units.check_units("x", rig, t, asked + 0.1, None, asked)


def test_a_motor_that_is_at_its_limit_most_of_the_time_is_mentioned(
    rig: Rig, tmp_path: Path
) -> None:
    limit = float(rig.tau_max[0])
    for often, count in ((4, 0), (7, 1)):
        rows = (f"{k},1,2,{limit * (-1) ** k if k < often else 0.1 * limit},0\n" for k in range(10))
        (tmp_path / "x.csv").write_text(f"{HEADER}\n" + "".join(rows))
        events = io.read_log(tmp_path / "x.csv", rig).events
        assert len(events) == count and all(f"{10 * often} %" in event for event in events)


@given(st.integers(0, 10**6), st.sampled_from([1e-3, 1e-2, 0.1]))
def test_angles_and_rates_of_one_unit_are_let_pass(rig: Rig, seed: int, step: float) -> None:
    """However coarse or noisy; in two units, or with t in ms, they are refused, standing joints never."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 20, 4001)
    w = rng.uniform(0.5, 6, rig.n)
    q = 0.5 * np.sin(np.outer(t, w))
    v = 0.5 * w * np.cos(np.outer(t, w))
    seen = step * np.round(q / step)
    noisy = v + 0.1 * rng.standard_normal(v.shape)
    units.check_units("x", rig, t, seen, noisy)
    units.check_units(
        "x", rig, t, 1e-4 * rng.standard_normal(q.shape), 0.1 * rng.standard_normal(v.shape)
    )
    with pytest.raises(LogError, match=r"moves 0\.01.* times as far as dq_yaw says"):
        units.check_units("x", rig, t, q, np.degrees(noisy))
    with pytest.raises(LogError, match=r"t is in ms, not s: map it: --map 't=t\*0.001'"):
        units.check_units("x", rig, 1e3 * t, q, noisy)
    with pytest.raises(
        LogError, match=r"dq_yaw is negative where q_yaw rises.*--map dq_yaw=-dq_yaw"
    ):
        units.check_units("x", rig, t, q, -noisy)


def test_two_channels_of_one_name_are_refused(rig: Rig) -> None:
    groups = columns.make_log_groups(("a", "ref_a"), (), need_tau=False)
    with pytest.raises(LogError, match="'q_ref_a'"):
        columns.resolve_mapping(rig, groups, ())


@given(
    coefficients=hnp.arrays(np.float64, (4, 2), elements=st.floats(-2, 2)),
    drop=st.sampled_from([("a",), ("v", "a"), ("v",)]),
)
def test_motion_differentiates_cubics_exactly(
    coefficients: np.ndarray, drop: tuple[str, ...], rig: Rig, tmp_path: Path
) -> None:
    t = np.linspace(0, 2, 21) ** 1.2
    powers = [np.polynomial.polynomial.polyder(coefficients, k) for k in range(3)]
    q, v, a = (np.polynomial.polynomial.polyval(t, c).T for c in powers)
    columns = {"t": t}
    for key, prefix, values in (("q", "q", q), ("v", "dq", v), ("a", "ddq", a)):
        if key not in drop:
            columns |= {f"{prefix}_{joint}": values[:, i] for i, joint in enumerate(rig.joints)}
    csv.write_csv(columns, tmp_path / "m.csv")
    motion = io.read_motion(tmp_path / "m.csv", rig)
    np.testing.assert_allclose(motion.v, v, atol=1e-10)
    np.testing.assert_allclose(motion.a, a, atol=1e-8)


def test_one_row_has_no_derivative(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("t,q_yaw,q_tilt\n0,1,2\n")
    with pytest.raises(LogError, match="one row and no rates"):
        io.read_motion(tmp_path / "m.csv", rig)


def test_write_only_known_formats(tmp_path: Path) -> None:
    motion = Motion(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    with pytest.raises(UsageError, match=r"suffix '\.xls'"):
        io.write_motion(motion, ("a",), tmp_path / "x.xls")
    assert not list(tmp_path.iterdir())


# Files


def test_replacing_leaves_the_old_file_when_the_block_fails(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), files.open_replacement(path) as temporary:
        temporary.write_text("half")
        assert temporary.name == path.name and path.read_text() == "old"
        _ = 1 / 0
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


@given(content=st.binary() | st.text(st.characters(exclude_categories=["Cs"])))
def test_atomic_write_writes_every_byte(content: str | bytes, tmp_path: Path) -> None:
    files.atomic_write(tmp_path / "x", content)
    assert (tmp_path / "x").read_bytes() == (
        content.encode() if isinstance(content, str) else content
    )
    assert list(tmp_path.iterdir()) == [tmp_path / "x"]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX access rights and links")
def test_rights_and_links_stay(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    files.atomic_write(tmp_path / "new", "x")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    (tmp_path / "link").symlink_to("new")
    files.atomic_write(tmp_path / "link", "y")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "new").read_text() == "y"
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(not Path(os.devnull).is_char_device(), reason="needs a device to write to")
def test_a_device_is_written_not_replaced() -> None:
    files.atomic_write(os.devnull, "x" * 1000)
    assert Path(os.devnull).is_char_device()


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="folder that does not exist"):
        files.atomic_write(tmp_path / "no" / "x.csv", "x")
    with pytest.raises(UsageError, match="is a folder"):
        files.atomic_write(tmp_path, "x")
    assert files.make_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "x"):
        with pytest.raises(UsageError, match="would be a folder where file is a file"):
            files.make_folder(place)


def test_a_name_that_is_no_text_is_written_so_that_it_can_be_read(tmp_path: Path) -> None:
    """Linux's file names are bytes; a log's stands in the model that was identified from it."""
    files.write_yaml({"logs": ["a\udcff.csv"]}, tmp_path / "x.yaml")
    assert reading.read_yaml(tmp_path / "x.yaml") == {"logs": ["a\\udcff.csv"]}


trees = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["C"])),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text("abcxyz_0.:", max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(tree=trees)
def test_yaml_and_json_round_trip(tree: object, tmp_path: Path) -> None:
    files.write_yaml(tree, tmp_path / "x.yaml")
    assert reading.read_yaml(tmp_path / "x.yaml") == tree
    files.write_json(tree, tmp_path / "x.json")
    assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8")) == files.to_plain(
        tree, finite=True
    )


def test_json_of_numpy_and_nan() -> None:
    value = {
        "b": np.float64(0.1),
        "a": np.array([[1.0, math.nan]]),
        "n": np.int64(3),
        "t": np.bool_(True),
        "l": (math.inf, -math.inf),
        "s": np.str_("rad"),
        "p": Path("x"),
    }
    text = files.to_json(value)
    assert json.loads(text) == {
        "b": 0.1,
        "a": [[1.0, None]],
        "n": 3,
        "t": True,
        "l": [None, None],
        "s": "rad",
        "p": "x",
    }
    assert list(json.loads(text)) == list(value)
    with pytest.raises(TypeError):
        files.to_json({"x": object()})


# Measured data, read through mappings


def measured(folder: str) -> Path:
    """Return a folder of measured data; skip where it is not there."""
    path = DATA / folder
    if not path.is_dir():
        pytest.skip(f"needs ../shared/data/{folder}, which is not beside this checkout")
    return path


def test_double_pendulum() -> None:
    folder = measured("dfki_double_pendulum")
    names = {"q": "pos", "dq": "vel", "tau": "tau"}
    mapping = [
        "t=time",
        *(
            f"{to}_{joint}={source}{i}"
            for to, source in names.items()
            for i, joint in ((1, "shoulder"), (2, "elbow"))
        ),
    ]
    log = io.read_log(
        folder / "20220812-061157-PM_measured.csv",
        Rig.load(folder / "double_pendulum.urdf"),
        mapping,
    )
    assert log.q.shape == held(log.v).shape == held(log.tau).shape == (21969, 2)
    assert 70 < log.t[-1] < 80 and 1 / 500 < log.dt < 1 / 250
    raw = np.loadtxt(folder / "20220812-061157-PM_measured.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(np.column_stack([log.t, log.q, held(log.v), held(log.tau)]), raw)
    # The drive's rate is the derivative of its angle, in the same unit.
    difference = np.diff(log.q, axis=0) / np.diff(log.t)[:, None]
    slope = (difference * held(log.v)[1:]).sum(axis=0) / (held(log.v)[1:] ** 2).sum(axis=0)
    np.testing.assert_allclose(slope, 1, atol=0.1)


def test_simple_pendulum() -> None:
    folder = measured("dfki_simple_pendulum")
    mapping = ["t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque"]
    log = io.read_log(
        folder / "system_identification.csv", Rig.load(folder / "pendulum.urdf"), mapping
    )
    assert log.q.shape == held(log.v).shape == held(log.tau).shape == (
        1170,
        1,
    ) and log.dt == pytest.approx(1 / 300, rel=0.2)
    travelled = np.sum(held(log.v)[:-1, 0] * np.diff(log.t))
    assert travelled == pytest.approx(log.q[-1, 0] - log.q[0, 0], abs=0.1)


def test_odrive_counts_and_current() -> None:
    folder = measured("odrive_cogging")
    mapping = ["t=time_s", "q_motor=pos_counts*0.00076699", "tau_motor=iq_a*0.0276"]
    rig = Rig.load(folder / "rotor.urdf")
    log = io.read_log(folder / "slow_a.csv", rig, mapping)
    assert log.q.shape == held(log.tau).shape == (4306, 1) and log.v is None and log.events == ()
    assert np.sqrt((held(log.tau) ** 2).mean()) / 0.0276 == pytest.approx(0.64, rel=0.1)
    turns = io.read_log(
        folder / "slow_a.csv", rig, [*mapping[:1], "q_motor=2*pi*pos_counts/8192", mapping[2]]
    )
    np.testing.assert_allclose(log.q, turns.q, rtol=1e-5)


def test_file_without_a_header() -> None:
    path = measured("rub_gimbal") / "open_loop_steps.txt"
    one = f'<robot name="one"><link name="base"/>{LINK.format("cam")}{JOINT.format("tilt", "base", "cam")}</robot>'
    mapping = ["t=column1*1e-6", "q_tilt=column2*pi/180", "dq_tilt=column3*pi/180"]
    log = io.read_log(path, spelled(one), mapping, need_tau=False)
    assert log.dt == pytest.approx(1 / 200) and log.q.shape == held(log.v).shape == (
        len(path.read_text().splitlines()),
        1,
    )
    assert np.abs(log.q).max() < math.radians(15)


def test_platform_imu(rig: Rig) -> None:
    path = measured("phantom4_motion") / "path_1.csv"
    mapping = [
        "t=time",
        *(f"gyro_base_{axis.lower()}=Gyr_{axis}*pi/180" for axis in "XYZ"),
        *(f"accel_base_{axis.lower()}=Acc_{axis}" for axis in "XYZ"),
    ]
    t, imu = io.read_imu(path, rig, "base", mapping)
    assert imu.quat is None and held(imu.gyro).shape == held(imu.accel).shape == (len(t), 3)
    assert np.median(np.diff(t)) == pytest.approx(1 / 120, rel=0.01)
    raw = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(held(imu.accel), raw[:, 4:7])
    np.testing.assert_allclose(np.rad2deg(held(imu.gyro)), raw[:, 7:10], rtol=1e-14, atol=0)
    with pytest.raises(LogError, match="no column gyro_base_x"):
        io.read_imu(path, rig, "base", ["t=time"])
