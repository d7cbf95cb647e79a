"""A rig in another engine: MuJoCo's model of a URDF with nothing in it but rigid bodies."""

from __future__ import annotations

import mujoco
from lxml import etree

from gimbal_pin.rig import GRAVITY


def rigid_bodies(robot: etree._Element) -> mujoco.MjModel:
    """No contact, no limits, no damping, no dry friction, no armature."""
    compiler = {"discardvisual": "true", "fusestatic": "false", "balanceinertia": "false"}
    etree.SubElement(etree.SubElement(robot, "mujoco"), "compiler", compiler)
    model = mujoco.MjModel.from_xml_string(etree.tostring(robot).decode())
    model.opt.gravity[:] = 0, 0, -GRAVITY
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for passive in (model.dof_damping, model.dof_frictionloss, model.dof_armature, model.jnt_stiffness):
        passive[:] = 0
    return model
