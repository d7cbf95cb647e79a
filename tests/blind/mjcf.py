"""The plant as MuJoCo sees it: the rig, what dangles or rattles on it, and a base that stands, moves or gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import mujoco
import numpy as np

from .rigs import EYE, Array, Inertia

BASE_DOFS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
DRIVEN = 1e8
"""Armature (kg, kg m²) that makes a driven base follow its motion whatever the gimbal does."""
KINDS = {"hinge": mujoco.mjtJoint.mjJNT_HINGE, "slide": mujoco.mjtJoint.mjJNT_SLIDE}
TENSOR_ENTRIES = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])


class Base(Enum):
    """How the base is held: bolted down, moved along a given path, or free on springs."""

    FIXED = "fixed"
    DRIVEN = "driven"
    SPRUNG = "sprung"


@dataclass(frozen=True)
class Hinge:
    """One degree of freedom of an appendage: "hinge" or "slide" along `axis`."""

    name: str
    kind: str
    axis: Array


@dataclass(frozen=True)
class Appendage:
    """A further body on link `parent` (-1: the base), at `position` and `rotation` in that link's frame."""

    name: str
    parent: int
    position: Array
    hinges: tuple[Hinge, ...]
    inertia: Inertia
    rotation: Array = field(default_factory=lambda: EYE)


def _add_body(parent, part, joints, armature=0.0, **named):
    """Return a new body at the part's place, with its inertia and these joints."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, part.rotation.ravel())
    inertia = part.inertia
    body = parent.add_body(
        pos=part.position,
        quat=quaternion,
        mass=inertia.mass,
        ipos=inertia.com,
        fullinertia=inertia.tensor[TENSOR_ENTRIES],
        explicitinertial=True,
        **named,
    )
    for joint in joints:
        body.add_joint(name=joint.name, type=KINDS[joint.kind], axis=joint.axis, armature=armature)
    return body


def _hang(body, appendages, parent):
    """Add what dangles on one link."""
    for item in appendages:
        if item.parent == parent:
            _add_body(body, item, item.hinges)


def build(rig, appendages, base, base_inertia):
    """Compile the plant; contacts and limits are off, every other force comes from the loop."""
    spec = mujoco.MjSpec()
    spec.option.disableflags = (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )
    body = spec.worldbody
    if base is not Base.FIXED:
        axes = zip(BASE_DOFS, 3 * ["slide"] + 3 * ["hinge"], np.vstack([EYE, EYE[::-1]]))
        floor = Appendage("base", -1, np.zeros(3), tuple(Hinge(*one) for one in axes), base_inertia)
        armature = DRIVEN if base is Base.DRIVEN else 0.0
        body = _add_body(body, floor, floor.hinges, armature)
    _hang(body, appendages, -1)
    for i, link in enumerate(rig.links):
        joint = Hinge(link.joint, "hinge", link.axis)
        body = _add_body(body, link, [joint], rig.armature[i], name=link.name)
        _hang(body, appendages, i)
    _add_body(body, rig.payload, ())
    return spec.compile()
