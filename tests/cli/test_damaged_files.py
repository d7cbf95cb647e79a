"""A damaged file is read, or refused in one line that names it, and nothing else changes."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.cli import main
from gimbal_pin.dynamics import plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.errors import LONGEST_MESSAGE, UNSAFE
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.rig import Rig
from tests.log.writers import (
    Columns,
    as_candump,
    as_hdf5,
    as_mat,
    as_npy,
    as_records,
    as_tlog,
    as_ulog,
)

pytestmark = pytest.mark.filterwarnings(
    "error::UserWarning",
    "error::RuntimeWarning",
    # Of a followed log whose last piece is one sample.
    "ignore:Mean of empty slice:RuntimeWarning",
    "ignore:invalid value encountered in scalar divide:RuntimeWarning",
)

PAN = """<?xml version="1.0"?>
<robot name="pan">
  <link name="base"><visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual></link>
  <link name="arm">
    <inertial>
      <origin xyz="0.05 0.02 0.1" rpy="0 0 0"/><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/>
    </inertial>
    <visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></visual>
    <visual><geometry><mesh filename="part.obj"/></geometry></visual>
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <link name="sight"/>
  <joint name="pan" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="4" effort="10"/>
    <dynamics damping="0.05" friction="0.1"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="arm"/><child link="sight"/><origin xyz="0 0 0.2" rpy="0 0 0"/>
  </joint>
</robot>
"""
BLOCK = """<?xml version="1.0"?>
<robot name="block">
  <link name="block">
    <inertial><origin xyz="0.01 0 0.02" rpy="0 0 0"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
  </link>
  <link name="camera"/>
  <joint name="block_to_camera" type="fixed"><parent link="block"/><child link="camera"/></joint>
</robot>
"""
PAN_YAML = """urdf: pan.urdf
description: one joint that tilts
mount: arm
camera_frame: sight
inertia: nominal
motors:
  pan: {tau_max: 10, torque_constant: 0.3, slots: 12, poles: 14, encoder_bits: 16}
limits:
  pan: {lower: -1.5, upper: 1.5, velocity: 4, acceleration: 40, effort: 10}
imus: [base, arm]
noise: {gyro: 0.0001, accelerometer: 0.001}
"""
MAPPING = "t: time\nq_pan: pos*pi/180\ndq_pan: speed\ntau_pan: iq*0.3\nq_ref_pan: want\n"
NAMES = {"t": "time", "q_pan": "pos", "dq_pan": "speed", "tau_pan": "iq", "q_ref_pan": "want"}
CAUSES = ("cogging:pan:amplitude=0.05,harmonic=12", "delay:pan:time=0.002", "base-tilt:roll=0.02")
"""A torque, a part of the drive and a change of the rig: what an extended model may hold."""
RIG = {
    "pan.yaml": PAN_YAML,
    "pan.urdf": PAN,
    "part.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}
PLACES = {
    "pan.urdf": "pan.yaml",
    "pan.yaml": "pan.urdf",
    "block.urdf": "with block",
    "map.yaml": "mapped.csv",
    "extended.yaml": "joint pan: ",
}
"""A file → what an error may name in its place, as the two may contradict each other."""

BINARY: Mapping[str, Callable[[Columns, Path], None]] = {
    "log.npy": as_records,
    "plain.npy": as_npy,
    "log.npz": lambda columns, path: np.savez_compressed(path, **columns),
    "log.csv.gz": lambda columns, path: pandas.DataFrame(dict(columns)).to_csv(path, index=False),
    "log.parquet": lambda columns, path: pandas.DataFrame(dict(columns)).to_parquet(path),
    "log.candump": as_candump,
}
"""A file's name → its format's own writer; read in this process."""
ISOLATED: Mapping[str, Callable[[Columns, Path], None]] = {
    "log.mat": as_mat,
    "hdf5.mat": as_hdf5,
    "log.ulg": as_ulog,
    "log.tlog": as_tlog,
}
"""The same of formats that are read in a process of their own, which takes a second to begin."""

CALLS = """simulate pan.yaml -o log.csv --seconds 6
identify pan.yaml log.csv -o model.yaml --mcap log.mcap
simulate pan.yaml -o platform.csv --platform S --imus --seconds 1
excite pan.yaml -o reference.csv --seconds 1 --starts 1 --harmonics 2 --rate 100
tune pan.yaml model.yaml -o computed-torque.yaml --bandwidth-hz 2 --plants 1
tune pan.yaml model.yaml -o pid.yaml --kind pid --bandwidth-hz 2 --plants 1"""
IDENTIFY = "identify pan.yaml {} -o out.yaml"
INSPECT = "inspect {} --rig pan.yaml"
RUN = "simulate pan.yaml -o out.csv --seconds 0.1 "
READERS = {
    "log.csv": (IDENTIFY, INSPECT, "identify pan.yaml {} --follow --idle 0 -o out.yaml"),
    "log.json": (INSPECT, IDENTIFY),
    **dict.fromkeys(BINARY, (INSPECT,)),
    "pan.urdf": ("check pan.yaml", "base pan.urdf", RUN),
    "block.urdf": ("check pan.yaml --payload {}",),
    "pan.yaml": ("check {}", RUN),
    "map.yaml": ("identify pan.yaml mapped.csv --map {} -o out.yaml",),
    "model.yaml": (RUN + "--model {}", "tune pan.yaml {} -o out.yaml --plants 1"),
    "extended.yaml": (RUN + "--model {}",),
    "computed-torque.yaml": (RUN + "--controller {}",),
    "pid.yaml": (RUN + "--controller {}",),
    "reference.csv": ("simulate pan.yaml -o out.csv --reference {}",),
    "platform.csv": (RUN + "--platform-log {}",),
}
"""A file → calls that read it."""


Check = Callable[..., int]


class Files(dict[str, bytes]):
    """Files by name, of which a failure prints the names alone."""

    def __repr__(self) -> str:
        return ", ".join(self)


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """A camera that tilts, and a file of every kind that is read of it, made by its own writer."""
    folder = tmp_path_factory.mktemp("valid")
    for name, text in {**RIG, "block.urdf": BLOCK, "map.yaml": MAPPING}.items():
        (folder / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for call in CALLS.splitlines():
            main(call.split())
        rig = Rig.load("pan.yaml")
        model = read_model(Path("model.yaml"), rig)
    plant, drive = plant_with(model, [parse_effect(cause, rig) for cause in CAUSES])
    extended = replace(plant, drive=tuple(drive), estimated=model.estimated)
    write_extended(extended, folder / "extended.yaml")
    for name in ("log.csv", "platform.csv"):
        frame = pandas.read_csv(folder / name)[::10]
        frame.to_csv(folder / name, index=False)
        if name == "log.csv":
            (folder / "log.json").write_text(json.dumps(frame.to_dict("records")))
            mapped = frame.assign(q_pan=np.rad2deg(frame["q_pan"]), tau_pan=frame["tau_pan"] / 0.3)
            mapped.rename(columns=NAMES).to_csv(folder / "mapped.csv", index=False)
    columns = {str(key): frame[key].to_numpy() for key in frame}
    for name, write in {**BINARY, **ISOLATED}.items():
        write(columns, folder / name)
    return Files({path.name: path.read_bytes() for path in folder.iterdir()})


@pytest.fixture
def check(
    valid: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Check:
    """A verb in a folder with some files damaged: what it prints and leaves is checked, its exit code returned."""
    folder = tmp_path / "call"

    def call(line: str, damage: Mapping[str, bytes]) -> int:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        monkeypatch.chdir(folder)
        words = line.split()
        inputs = {name: valid[name] for name in (*RIG, *words) if name in valid} | dict(damage)
        for name, content in inputs.items():
            Path(name).write_bytes(content)
        capfd.readouterr()
        code = 0
        try:
            main(words)
        except SystemExit as stop:
            code = int(stop.code or 0)
        out, err = capfd.readouterr()
        assert code in (0, 2, 3), err
        assert not UNSAFE.search(out + err)
        lines = err.splitlines()
        assert all(line.startswith("gimbal-pin: ") for line in lines), err
        assert max(map(len, lines), default=0) <= LONGEST_MESSAGE + 20
        assert sum("gimbal-pin: note: " not in line for line in lines) == (code != 0), err
        left = {path.name: path.read_bytes() for path in folder.iterdir()}
        assert {name: left.pop(name) for name in inputs} == inputs
        assert left.keys() == (
            {*words} & {"out.yaml", "out.csv", "out.html"} if code == 0 else set()
        )
        assert all(len(content) > 100 for content in left.values())
        for name in damage if code else ():
            assert name in err or PLACES.get(name, name) in err
        return code

    return call


# --- Damage -------------------------------------------------------------------------------------

UNITS = (b"", b"(?<=[\\s,:\"'<>=\\[\\]{}])|(?=[\\s,:\"'<>=\\[\\]{}])", b"(?<=\n)")
"""Where a file is divided into bytes, words and lines."""
HOSTILE = [
    *(b"nan", b"-inf", b"1e400", b"1e300", b"1e-320", b"-0", b"0", b"-1", b"9" * 400, b"1_0"),
    *(b"", b"text", b"null", b"~", b"[]", b"[[1]]", b"{}", b"{[1]: 2}", b"*nothing", b"&a [*a]"),
    *(b"!!bool x", b"!!python/object/apply:os.system [id]", b"2001-99-99", b"[" * 20_000),
    *(b'"\\e[31m"', b'"\\ud800"', b"&nothing;", b"&#27;[31m", b"]]>", b"prismatic", b"no.stl"),
    *(b"\x1b[31mred", b"a\rb", "\u202egnp".encode(), "\u0661".encode(), b"x" * 5000, b"../../x"),
    *(b"a=b*2", b"a@b", b"%s%n{0}", b"-o", b"base", b"\0", b"\xff", b"\xed\xa0\x80", b"\x1f\x8b"),
    *(b"\xef\xbb\xbf", b"PK\x03\x04", b"PAR1", b"\x89HDF\r\n\x1a\n"),
]
"""Numbers and names that none can be, marks of several formats, and bytes that text has none of."""


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """A file with one to three faults, of its bytes, its words or its lines."""
    for _ in range(draw(st.integers(1, 3))):
        parts = re.split(draw(st.sampled_from(UNITS)), data)
        start = draw(st.integers(0, len(parts) - 1))
        end = start + draw(st.sampled_from((1, 1, 8, 64, len(parts))))
        block = parts[start:end]
        inverted = bytes(255 - x for x in b"".join(block))
        hostile = draw(st.sampled_from(HOSTILE))
        changes = ([hostile], [hostile], [], block * 2, block[::-1], [inverted])
        parts[start:end] = draw(st.sampled_from(changes))
        data = b"".join(parts)
    return data


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    name: str, data: st.DataObject, valid: Files, check: Check
) -> None:
    line = data.draw(st.sampled_from(READERS[name])).format(name)
    check(line, data.draw(damaged(valid[name]).map(lambda content: Files({name: content}))))


@settings(max_examples=max(2, settings().max_examples // 6))
@pytest.mark.parametrize(
    ("name", "line"),
    [
        *((name, "inspect {}") for name in (*ISOLATED, "log.mcap")),
        ("part.obj", "animate pan.yaml reference.csv -o out.html"),
    ],
)
@given(data=st.data())
def test_a_damaged_file_of_a_foreign_library_is_read_or_refused_in_one_line(
    name: str, line: str, data: st.DataObject, valid: Files, check: Check
) -> None:
    damage = damaged(valid[name]).map(lambda content: Files({name: content}))
    check(line.format(name), data.draw(damage))


@pytest.mark.parametrize(
    "change",
    [
        lambda x: x.astype(np.float16),
        lambda x: np.full(len(x), 2**62),
        lambda x: x > 0,
        lambda x: np.full(len(x), np.datetime64("NaT", "ns")),
        lambda x: np.where(x > 0, np.nan, x),
        lambda x: x + 1j,
        lambda x: np.float64(1.0),
        lambda x: np.zeros((len(x), 2, 2)),
        lambda x: x[:-1],
    ],
)
def test_arrays_of_other_types_and_shapes_are_read_or_refused(
    change: Callable[[Any], Any], valid: Files, check: Check
) -> None:
    columns = dict(np.load(io.BytesIO(valid["log.npz"])))
    for name in ("t", "q_pan"):
        sink = io.BytesIO()
        np.savez(sink, **{**columns, name: change(columns[name])})
        check(INSPECT.format("log.npz"), {"log.npz": sink.getvalue()})


@pytest.mark.parametrize(
    ("line", "name", "old", "new"),
    [
        ("check pan.yaml --payload block.urdf", "block.urdf", ' type="fixed"', ""),
        ("check pan.yaml", "pan.yaml", "pan.urdf", "a/b.urdf"),
        ("identify pan.yaml mapped.csv --map map.yaml", "map.yaml", "pos*pi/180", "1"),
        (RUN + "--model model.yaml", "model.yaml", "lags:", "lags:\n- 0.1"),
    ],
)
def test_a_fault_is_named_with_its_file(
    line: str, name: str, old: str, new: str, valid: Files, check: Check
) -> None:
    text = valid[name].decode()
    assert old in text
    assert check(line, {name: text.replace(old, new, 1).encode()}) == 2


@pytest.mark.parametrize("name", READERS)
def test_the_valid_file_is_read(name: str, check: Check) -> None:
    for line in READERS[name]:
        assert check(line.format(name), {}) == 0
