"""Rigs for tests: the bundled ones, each loaded once, and those that a URDF's text spells."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from gimbal_pin.log import Array
from gimbal_pin.rig import Rig, bundled_payloads, bundled_rigs, to_pinocchio

COMBINATIONS = [(rig, payload) for rig in bundled_rigs() for payload in bundled_payloads()]
"""Every bundled rig with every payload."""
VARIETY = [
    (rig, payload) for rig, payload in COMBINATIONS if rig == "thesis" or payload == "cinema"
]
"""Every bundled rig, and every payload, at least once."""

BODY = (
    '<link name="{0}"><inertial><origin xyz="0.05 -0.12 0.2" rpy="0.3 -0.8 1.1"/><mass value="{1}"/>'
    '<inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.002" ixz="-0.003" iyz="0.004"/></inertial></link>'
)
"""A link of a mass, askew in every way."""


@cache
def bundled(name: str, payload: str | None = None) -> Rig:
    """A bundled rig."""
    return Rig.load(name, payload)


@cache
def spelled(urdf: str) -> Rig:
    """The rig of a URDF's text."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "spelled.urdf"
        path.write_text(urdf, encoding="utf-8")
        return Rig.load(path)


def taken_by_all(urdf: str, joints: int) -> bool:
    """Whether Pinocchio, yourdfpy and MuJoCo read a URDF of so many joints."""
    import mujoco
    import yourdfpy

    robot = yourdfpy.URDF.load(
        io.BytesIO(urdf.encode()), load_meshes=False, build_scene_graph=False
    ).robot
    counts = (to_pinocchio(urdf, "written").nv, mujoco.MjModel.from_xml_string(urdf).nv)
    return counts == (joints, joints) and len(robot.links) > joints


def states(n: int, seed: int, count: int = 20) -> tuple[Array, Array, Array]:
    """Angles, rates and accelerations of a size that rigs know, (count, n) each."""
    draw = np.random.default_rng(seed).uniform(-1, 1, (3, count, n))
    return np.pi * draw[0], 3 * draw[1], 20 * draw[2]


def energy(rig: Rig, q: Array, v: Array) -> float:
    """Kinetic and potential energy of one state, J."""
    data = rig.model.createData()
    kinetic = pin.computeKineticEnergy(rig.model, data, q, v)
    return float(kinetic + pin.computePotentialEnergy(rig.model, data, q))


def chain(n: int) -> Rig:
    """A chain of n revolute joints about z, y and x in turn, every body lighter than the one that carries it."""
    parts = ['<robot name="chain"><link name="base"/>']
    for k in range(n):
        mass = 3.0 * 0.85**k
        parent = f"link{k - 1}" if k else "base"
        Ixx, Iyy, Izz = (mass * x for x in (0.004, 0.005, 0.003))
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="0.02 -0.01 0.05" rpy="0.1 0.2 0.3"/><mass value="{mass}"/>'
            f'<inertia ixx="{Ixx}" iyy="{Iyy}" izz="{Izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>'
            f'<origin xyz="0 0.01 0.1"/><axis xyz="{("0 0 1", "0 1 0", "1 0 0")[k % 3]}"/>'
            '<limit lower="-3" upper="3" effort="200" velocity="8"/><dynamics friction="0.05" damping="0.02"/></joint>'
        )
    return spelled("".join([*parts, "</robot>"]))
