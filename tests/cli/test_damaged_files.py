"""Laws of every reader: a damaged file is read, or refused in one line that names it, and nothing else changes."""

from __future__ import annotations

import io
import json
import os
import shutil
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from gimbal_pin.cli import main
from gimbal_pin.dynamics import plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.errors import LONGEST_MESSAGE, UNSAFE
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.rig import Rig
from tests import damaged
from tests.log.writers import (
    Columns,
    as_bag,
    as_candump,
    as_hdf5,
    as_mat,
    as_npy,
    as_records,
    as_tlog,
    as_ulog,
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
CAUSES = ("cogging:pan:amplitude=0.05,harmonic=12", "delay:pan:time=0.002", "base-tilt:roll=0.02")
"""A torque, a part of the drive and a change of the rig: the three kinds that an extended model may hold."""
RIG = ("pan.yaml", "pan.urdf", "part.obj")
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


PLACES = {
    "pan.urdf": ("pan.urdf", "pan.yaml"),
    "pan.yaml": ("pan.yaml", "pan.urdf"),
    "block.urdf": ("block.urdf", "with block"),
    "map.yaml": ("map.yaml", "mapped.csv"),
    "extended.yaml": ("extended.yaml", "joint pan: "),
}
"""A file of several → names of which an error has one, as it may be that they contradict each other."""


class Files(dict[str, Any]):
    """Name → a file's bytes or a column, of which a failure prints the name."""

    def __repr__(self) -> str:
        return ", ".join(self)


def thin(path: Path) -> pandas.DataFrame:
    """Keep every tenth sample of a log of 1 kHz."""
    frame = pandas.read_csv(path)[::10]
    frame.to_csv(path, index=False)
    return frame


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
    "log.mcap": as_bag("mcap"),
    "log.ulg": as_ulog,
    "log.tlog": as_tlog,
}
"""The same of formats that are read in a process of their own, which takes a second to begin."""


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """A camera that tilts, and a file of every kind that is read of it, made by its own writer."""
    folder = tmp_path_factory.mktemp("valid")
    before = Path.cwd()
    os.chdir(folder)
    try:
        write_files()
    finally:
        os.chdir(before)
    frame = pandas.read_csv(folder / "log.csv")
    columns = {str(name): frame[name].to_numpy() for name in frame}
    columns |= {f"{of}_base_{axis}": np.full(len(frame), 9.81 * (of == "accel" and axis == "z"))
                for of in ("gyro", "accel") for axis in "xyz"}  # fmt: skip
    columns |= {f"quat_base_{axis}": np.full(len(frame), float(axis == "w")) for axis in "wxyz"}
    for name, write in {**BINARY, **ISOLATED}.items():
        path = folder / name
        write({key: x[: 120 if name in ISOLATED else None] for key, x in columns.items()}, path)
        if path.is_dir():  # a bag's folder: its file
            (file,) = path.glob(f"*{path.suffix}")
            content = file.read_bytes()
            shutil.rmtree(path)
            path.write_bytes(content)
    files = Files({path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()})
    return Files({**files, "columns": {name: columns[name] for name in frame}})


def write_files() -> None:
    """Write the rig, and by the verbs what a user has of it, into the working folder."""
    for name, text in {
        "pan.urdf": PAN,
        "block.urdf": BLOCK,
        "pan.yaml": PAN_YAML,
        "map.yaml": MAPPING,
    }.items():
        Path(name).write_text(text, encoding="utf-8")
    Path("part.obj").write_bytes(OBJ)
    for line in (
        "simulate pan.yaml -o log.csv --seconds 6",
        "identify pan.yaml log.csv -o model.yaml",
        "simulate pan.yaml -o platform.csv --platform S --imus --seconds 1",
        "excite pan.yaml -o reference.csv --seconds 1 --starts 1 --harmonics 2 --rate 100",
    ):
        main(line.split())
    log = thin(Path("log.csv"))
    thin(Path("platform.csv"))
    Path("log.json").write_text(json.dumps(log.to_dict("records")), encoding="utf-8")
    names = {"t": "time", "q_pan": "pos", "dq_pan": "speed", "tau_pan": "iq", "q_ref_pan": "want"}
    scaled = log.assign(q_pan=np.rad2deg(log["q_pan"]), tau_pan=log["tau_pan"] / 0.3)
    scaled.rename(columns=names).to_csv("mapped.csv", index=False)
    for kind in ("computed-torque", "pid"):
        main(
            f"tune pan.yaml model.yaml -o {kind}.yaml --kind {kind} --bandwidth-hz 2 --plants 1".split()
        )
    rig = Rig.load("pan.yaml")
    model = read_model(Path("model.yaml"), rig)
    plant, drive = plant_with(model, [parse_effect(cause, rig) for cause in CAUSES])
    write_extended(
        replace(plant, drive=tuple(drive), estimated=model.estimated), Path("extended.yaml")
    )


def check_call(
    line: str, damage: Mapping[str, bytes], valid: Files, folder: Path, capfd: Any
) -> int:
    """Run a verb in a folder with some files damaged, check what it prints and leaves, and return its exit code."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    words = line.split()
    inputs = {name: valid[name] for name in (*RIG, *words) if name in valid} | dict(damage)
    for name, content in inputs.items():
        (folder / name).write_bytes(content)
    os.chdir(folder)
    code = 0
    with warnings.catch_warnings(record=True) as warned:
        warnings.resetwarnings()
        for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", kind)
        capfd.readouterr()
        try:
            main(words)
        except SystemExit as stop:
            code = int(stop.code or 0)
    out, err = capfd.readouterr()
    assert not warned, [str(each) for each in warned]
    assert code in (0, 2, 3), err
    assert not UNSAFE.search(out) and not UNSAFE.search(err) and "Traceback" not in err
    lines = err.splitlines()
    assert all(line.startswith("gimbal-pin: ") for line in lines) and err.endswith(
        "\n" * bool(lines)
    )
    assert all(len(line) <= LONGEST_MESSAGE + 20 for line in lines)
    errors = [line for line in lines if not line.startswith("gimbal-pin: note: ")]
    assert len(errors) == (code != 0), err
    left = {path.name: path.read_bytes() for path in folder.iterdir()}
    output = {words[words.index("-o") + 1]} if "-o" in words else set()
    assert {name: left.pop(name) for name in inputs} == inputs
    assert left.keys() == (output if code == 0 else set()), err
    assert all(len(content) > 100 for content in left.values())
    assert code == 0 or any(
        place in errors[0] for name in damage for place in PLACES.get(name, (name,))
    ), err
    return code


@pytest.fixture
def check(
    valid: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Any:
    """`check_call` in a folder of this test; the working folder is restored behind it."""
    monkeypatch.chdir(tmp_path)
    return lambda line, damage: check_call(line, damage, valid, tmp_path / "call", capfd)


IDENTIFY = "identify pan.yaml {} -o out.yaml"
INSPECT = "inspect {} --rig pan.yaml"
RUN = "simulate pan.yaml -o out.csv --seconds 0.1 "
READERS: Mapping[str, tuple[Any, tuple[str, ...]]] = {
    "log.csv": (
        damaged.damaged_table,
        (IDENTIFY, INSPECT, "identify pan.yaml {} --follow --idle 0 -o out.yaml"),
    ),
    "log.json": (damaged.damaged_json, (INSPECT, IDENTIFY)),
    "log.candump": (damaged.damaged_bytes, (INSPECT,)),
    "log.npy": (damaged.damaged_bytes, (IDENTIFY, INSPECT)),
    "log.npz": (damaged.damaged_bytes, (IDENTIFY, INSPECT)),
    "log.csv.gz": (damaged.damaged_bytes, (IDENTIFY, INSPECT)),
    "log.parquet": (damaged.damaged_bytes, (IDENTIFY, INSPECT)),
    "pan.urdf": (damaged.damaged_xml, ("check pan.yaml", "base pan.urdf", RUN)),
    "block.urdf": (damaged.damaged_xml, ("check pan.yaml --payload {}",)),
    "pan.yaml": (damaged.damaged_yaml, ("check {}", RUN)),
    "map.yaml": (damaged.damaged_yaml, ("identify pan.yaml mapped.csv --map {} -o out.yaml",)),
    "model.yaml": (
        damaged.damaged_yaml,
        (RUN + "--model {}", "tune pan.yaml {} -o out.yaml --plants 1"),
    ),
    "extended.yaml": (damaged.damaged_yaml, (RUN + "--model {}",)),
    "computed-torque.yaml": (damaged.damaged_yaml, (RUN + "--controller {}",)),
    "pid.yaml": (damaged.damaged_yaml, (RUN + "--controller {}",)),
    "reference.csv": (damaged.damaged_table, ("simulate pan.yaml -o out.csv --reference {}",)),
    "platform.csv": (damaged.damaged_table, (RUN + "--platform-log {}",)),
}
"""A file → the strategy that damages it, and calls that read it."""


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    name: str, data: st.DataObject, valid: Files, check: Any
) -> None:
    strategy, lines = READERS[name]
    line = data.draw(st.sampled_from(lines)).format(name)
    check(line, {name: data.draw(strategy(valid[name]))})


@settings(max_examples=max(2, settings().max_examples // 6))
@pytest.mark.parametrize("name", ISOLATED)
@given(data=st.data())
def test_a_damaged_file_of_a_foreign_library_is_read_or_refused_in_one_line(
    name: str, data: st.DataObject, valid: Files, check: Any
) -> None:
    check(f"inspect {name}", {name: data.draw(damaged.damaged_bytes(valid[name]))})


@settings(max_examples=max(2, settings().max_examples // 6))
@given(data=st.data())
def test_a_damaged_mesh_is_drawn_or_left_out(data: st.DataObject, valid: Files, check: Any) -> None:
    mesh = data.draw(damaged.damaged_bytes(valid["part.obj"]))
    check("animate pan.yaml reference.csv -o out.html", {"part.obj": mesh})


def write_parquet(columns: Mapping[str, Any]) -> bytes:
    """A Parquet file of the arrays that it can hold, some of them as lists, decimals or of few distinct values."""
    sink = io.BytesIO()
    parquet.write_table(
        pyarrow.table({name: pyarrow.array(x) for name, x in columns.items()}), sink
    )
    return sink.getvalue()


def write_npz(columns: Mapping[str, Any]) -> bytes:
    """An archive of the arrays."""
    sink = io.BytesIO()
    np.savez(sink, **columns)
    return sink.getvalue()


@pytest.mark.parametrize("name", ["log.parquet", "log.npz"])
@given(data=st.data())
def test_arrays_of_other_types_and_shapes_are_read_or_refused(
    name: str, data: st.DataObject, valid: Files, check: Any
) -> None:
    is_npz = name == "log.npz"
    changes = damaged.ARRAY_CHANGES + (damaged.SHAPE_CHANGES if is_npz else ())
    columns = data.draw(damaged.damaged_columns(valid["columns"], changes).map(Files))
    line = data.draw(st.sampled_from((IDENTIFY, INSPECT))).format(name)
    check(line, {name: (write_npz if is_npz else write_parquet)(columns)})


FAULTS = {
    "a payload's joint without a type": (
        "check pan.yaml --payload block.urdf", "block.urdf", 2, (' type="fixed"', "")),
    "a payload's joint about no axis": (
        "check pan.yaml --payload block.urdf", "block.urdf", 2,
        ('type="fixed">', 'type="continuous"><axis xyz="0 0 0"/>')),
    "a rig's YAML that names no file": ("check pan.yaml", "pan.yaml", 2, ("pan.urdf", "a/b.urdf")),
    "a target of 200 characters": (
        "identify pan.yaml mapped.csv --map map.yaml", "map.yaml", 2, ("t:", "q" * 200 + ": pos\nt:")),
    "a mapping to a number": (
        "identify pan.yaml mapped.csv --map map.yaml", "map.yaml", 2, ("pos*pi/180", "1")),
    "lags of two joints of one": (RUN + "--model model.yaml", "model.yaml", 2, ("lags:", "lags:\n- 0.1")),
}  # fmt: skip
"""A fault → the call, the damaged file, the exit code, and what stands in place of what."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_file(fault: str, valid: Files, check: Any) -> None:
    line, name, code, (old, new) = FAULTS[fault]
    text = valid[name].decode()
    assert old in text
    assert check(line, {name: text.replace(old, new, 1).encode()}) == code


@pytest.mark.parametrize("name", READERS)
def test_the_valid_file_is_read(name: str, valid: Files, check: Any) -> None:
    for line in READERS[name][1]:
        assert check(line.format(name), {}) == 0
