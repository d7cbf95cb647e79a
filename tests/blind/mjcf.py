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


def _numbers(values):
    return " ".join(f"{float(value):.17g}" for value in values)


def _pose(rotation, position):
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).reshape(9))
    return f'pos="{_numbers(position)}" quat="{_numbers(quaternion)}"'


def _inertial(inertia):
    tensor = inertia.tensor
    full = np.array(
        [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    )
    return f'<inertial pos="{_numbers(inertia.com)}" mass="{inertia.mass:.17g}" fullinertia="{_numbers(full)}"/>'


def _joint(name, kind, axis, armature=0.0):
    return (
        f'<joint name="{name}" type="{kind}" axis="{_numbers(axis)}" armature="{armature:.17g}"/>'
    )


def _dangling(appendages, parent):
    parts = []
    for item in (a for a in appendages if a.parent == parent):
        joints = "".join(_joint(hinge.name, hinge.kind, hinge.axis) for hinge in item.hinges)
        parts.append(
            f"<body {_pose(item.rotation, item.position)}>{joints}{_inertial(item.inertia)}</body>"
        )
    return "".join(parts)


def _chain(rig, appendages):
    """The links from the tip inwards, each holding the next; the payload is a body of its own, welded on."""
    payload = rig.payload
    inner = f"<body {_pose(payload.rotation, payload.position)}>{_inertial(payload.inertia)}</body>"
    for i in reversed(range(len(rig.links))):
        link = rig.links[i]
        joint = _joint(link.joint, "hinge", link.axis, rig.armature[i])
        own = joint + _inertial(link.inertia) + _dangling(appendages, i)
        inner = (
            f'<body name="{link.name}" {_pose(link.rotation, link.position)}>{own}{inner}</body>'
        )
    return _dangling(appendages, -1) + inner


def _base_joints(base):
    armature = DRIVEN if base is Base.DRIVEN else 0.0
    axes = dict(zip(BASE_DOFS, np.vstack([EYE, EYE[::-1]]), strict=True))
    kinds = ("slide", "slide", "slide", "hinge", "hinge", "hinge")
    return "".join(_joint(n, k, axes[n], armature) for n, k in zip(BASE_DOFS, kinds, strict=True))


def build(rig, appendages, base, base_inertia):
    """Compile the plant; contacts and limits are off, every other force comes from the loop."""
    body = _chain(rig, appendages)
    if base is not Base.FIXED:
        body = f"<body>{_base_joints(base)}{_inertial(base_inertia)}{body}</body>"
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" autolimits="false"/><option gravity="0 0 -9.81">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )
