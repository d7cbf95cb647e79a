"""The valid inputs that are damaged: a camera that tilts, its logs, its models and controllers, made by the package."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
from pathlib import Path

import numpy as np
import pandas

from fuzzing import bombs, formats

Seeds = dict[str, bytes]
"""Name → content."""

PAN = """<?xml version="1.0"?>
<robot name="pan">
  <link name="base">
    <visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual>
  </link>
  <link name="arm">
    <inertial>
      <origin xyz="0.05 0.02 0.1" rpy="0 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/>
    </inertial>
    <visual><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></visual>
    <visual><geometry><mesh filename="part.stl"/></geometry></visual>
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <link name="sight"/>
  <joint name="pan" type="revolute">
    <parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="4" effort="10"/><dynamics damping="0.05" friction="0.1"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="arm"/><child link="sight"/><origin xyz="0 0 0.2" rpy="0 0 0"/>
  </joint>
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
MOUNTED = """<?xml version="1.0"?>
<robot name="block">
  <link name="block">
    <inertial><origin xyz="0.01 0 0.02" rpy="0 0 0"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
  </link>
  <link name="camera"/>
  <joint name="block_to_camera" type="fixed">
    <parent link="block"/><child link="camera"/><origin xyz="0 0 0" rpy="0 0 0"/>
  </joint>
</robot>
"""
MAPPING = "t: time\nq_pan: pos*pi/180\ndq_pan: speed\ntau_pan: iq*0.3\nq_ref_pan: want\n"
CAUSES = ("cogging:pan:amplitude=0.05,harmonic=12", "delay:pan:time=0.002", "base-tilt:roll=0.02")
"""A torque, a part of the drive and a change of the rig: the three kinds that an extended model may hold."""


def made(folder: Path) -> None:
    """Write the valid inputs into a folder; RuntimeError if the package refuses what is sound."""
    os.chdir(folder)
    Path("pan.urdf").write_text(PAN, encoding="utf-8")
    Path("pan.yaml").write_text(PAN_YAML, encoding="utf-8")
    Path("block.urdf").write_text(MOUNTED, encoding="utf-8")
    Path("map.yaml").write_text(MAPPING, encoding="utf-8")
    Path("part.stl").write_bytes(stl())
    called("simulate", "pan.yaml", "-o", "full.csv", "--seconds", "8")
    called("simulate", "turret", "-o", "full2.csv", "--seconds", "8")
    called("simulate", "pan.yaml", "-o", "platform.csv", "--platform", "S", "--imus", "--seconds", "2")
    called("excite", "pan.yaml", "-o", "reference.csv", "--seconds", "1", "--starts", "1", "--harmonics", "2")
    thinned("full.csv", "log.csv")
    thinned("full2.csv", "log2.csv")
    renamed("log.csv", "mapped.csv")
    called("identify", "pan.yaml", "log.csv", "-o", "model.yaml")
    called("identify", "turret", "log2.csv", "-o", "model2.yaml")
    called("tune", "pan.yaml", "model.yaml", "-o", "controller.yaml", "--plants", "1")
    called("tune", "pan.yaml", "model.yaml", "-o", "pid.yaml", "--kind", "pid", "--bandwidth-hz", "2", "--plants", "1")
    called("tune", "turret", "model2.yaml", "-o", "controller2.yaml", "--robust", "--plants", "1")
    extended("model.yaml", "extended.yaml")
    packed("log.csv", "log.parquet")
    formatted("log.csv")
    packed("platform.csv", "platform.parquet")
    bombs.made(Path())
    for name in ("full.csv", "full2.csv"):
        Path(name).unlink()


def called(*words: str) -> None:
    """Run a verb that must end well."""
    from gimbal_pin.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main(words)
        except SystemExit as stop:
            if stop.code not in (0, None):
                raise RuntimeError(f"gimbal-pin {' '.join(words)}: {said.getvalue()}") from stop


def read(folder: Path) -> Seeds:
    """Return what `made` wrote."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if not path.name.startswith(".")}


def thinned(source: str, target: str, step: int = 10) -> None:
    """Keep every tenth sample: 100 Hz, which is quick to read."""
    header, *rows = Path(source).read_text(encoding="utf-8").splitlines()
    Path(target).write_text("\n".join([header, *rows[::step]]) + "\n", encoding="utf-8")


def renamed(source: str, target: str) -> None:
    """Write the log with the columns that the mapping speaks of."""
    header, *rows = Path(source).read_text(encoding="utf-8").splitlines()
    names = {"t": "time", "q_pan": "pos", "dq_pan": "speed", "tau_pan": "iq", "q_ref_pan": "want"}
    factors = np.array([{"q_pan": 180 / np.pi, "tau_pan": 1 / 0.3}.get(name, 1.0) for name in header.split(",")])
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows]) * factors
    lines = [",".join(repr(float(value)) for value in row) for row in table]
    Path(target).write_text("\n".join([",".join(names[name] for name in header.split(",")), *lines]) + "\n", "utf-8")


def packed(source: str, target: str) -> None:
    """Write a table as Parquet."""
    import pyarrow

    from fuzzing import damaged_csv, damaged_parquet

    columns = damaged_csv.shown(Path(source).read_bytes())
    Path(target).write_bytes(damaged_parquet.written({name: pyarrow.array(x) for name, x in columns.items()}))


def formatted(source: str, rows: int = 200) -> None:
    """Write the first samples of a log, with an IMU at rest, in every other format, by its own writer."""
    from fuzzing import damaged_csv

    table = {name: np.asarray(x)[:rows] for name, x in damaged_csv.shown(Path(source).read_bytes()).items()}
    rest = {"gyro": (0.0, 0.0, 0.0), "accel": (0.0, 0.0, 9.81), "quat": (1.0, 0.0, 0.0, 0.0)}
    axes = {"gyro": "xyz", "accel": "xyz", "quat": "wxyz"}
    table |= {f"{of}_base_{axis}": np.full(rows, x) for of, x3 in rest.items() for axis, x in zip(axes[of], x3)}
    for name, write in WRITERS.items():
        write(table, Path(name))
        if Path(name).is_dir():  # a bag's folder becomes its file
            (file,) = (path for path in Path(name).iterdir() if path.suffix == Path(name).suffix)
            content = file.read_bytes()
            shutil.rmtree(name)
            Path(name).write_bytes(content)
        called("inspect", name)


WRITERS = {
    "log.npy": formats.as_records,
    "plain.npy": formats.as_npy,
    "log.npz": lambda columns, path: np.savez_compressed(path, **columns),
    "log.mat": formats.as_mat,
    "hdf5.mat": formats.as_hdf5,
    "log.bag": formats.as_bag("ros1"),
    "log.db3": formats.as_bag("sqlite3"),
    "log.mcap": formats.as_bag("mcap"),
    "log.ulg": formats.as_ulog,
    "log.tlog": formats.as_tlog,
    "log.candump": formats.as_candump,
    "log.csv.gz": lambda columns, path: pandas.DataFrame(dict(columns)).to_csv(path, index=False),
}
"""A file's name → what writes a log's columns to it."""


def extended(source: str, target: str) -> None:
    """Write an identified model with causes of every kind, as `diagnose` does."""
    from dataclasses import replace

    from gimbal_pin.dynamics.simulation import plant_with
    from gimbal_pin.effects.parse import parse_effect
    from gimbal_pin.identification.model_file import read_model, write_extended
    from gimbal_pin.rig.rig import Rig

    rig = Rig.load("pan.yaml")
    model = read_model(source, rig)
    plant, drive = plant_with(model, [parse_effect(cause, rig) for cause in CAUSES])
    write_extended(replace(plant, drive=tuple(drive), estimated=model.estimated), target)


def stl() -> bytes:
    """A tetrahedron as a binary STL."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype="<f4")
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
    body = b"".join(np.zeros(3, "<f4").tobytes() + corners[list(face)].tobytes() + b"\0\0" for face in faces)
    return b"\0" * 80 + np.uint32(len(faces)).tobytes() + body
