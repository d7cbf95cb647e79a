"""A rig in another engine: MuJoCo's model of a URDF with nothing in it but rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from lxml import etree

from gimbal_pin.log import Array
from gimbal_pin.rig import GRAVITY


def rigid_bodies(robot: etree._Element) -> mujoco.MjModel:
    """No contact, no limits, no damping, no dry friction, no armature."""
    compiler = {"discardvisual": "true", "fusestatic": "false", "balanceinertia": "false"}
    etree.SubElement(etree.SubElement(robot, "mujoco"), "compiler", compiler)
    model = mujoco.MjModel.from_xml_string(etree.tostring(robot).decode())
    model.opt.gravity[:] = 0, 0, -GRAVITY
    model.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    for passive in (
        model.dof_damping,
        model.dof_frictionloss,
        model.dof_armature,
        model.jnt_stiffness,
    ):
        passive[:] = 0
    return model


def torque(
    model: mujoco.MjModel,
    joints: Sequence[str],
    q: Array,
    v: Array,
    a: Array,
    base: Sequence[Sequence[Array]] = (),
) -> Array:
    """mj_inverse in the order of `joints`, (N, n); `base`: per sample a free joint's pose, rate and acceleration."""
    data = mujoco.MjData(model)
    free = model.nq - model.nv
    at = np.array([int(model.joint(name).dofadr[0]) for name in joints])
    assert model.nv == len(joints) + 6 * free
    out = np.empty_like(q)
    for k, row in enumerate(out):
        for channel, own in zip((data.qpos, data.qvel, data.qacc), base[k] if base else ()):
            channel[: len(own)] = own
        data.qpos[at + free], data.qvel[at], data.qacc[at] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        row[:] = data.qfrc_inverse[at]
    return out
