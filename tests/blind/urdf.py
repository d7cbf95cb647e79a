"""The rig as text: URDF and the YAML beside it, which is all that a diagnoser may read of it."""

from math import atan2, hypot

import numpy as np


def _numbers(values):
    return " ".join(f"{value:.12g}" for value in values)


def roll_pitch_yaw(rotation):
    """Fixed-axis angles of URDF: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = atan2(-rotation[2, 0], hypot(rotation[0, 0], rotation[1, 0]))
    if abs(rotation[2, 0]) > 1.0 - 1e-12:
        return 0.0, pitch, atan2(-rotation[0, 1], rotation[1, 1])
    return atan2(rotation[2, 1], rotation[2, 2]), pitch, atan2(rotation[1, 0], rotation[0, 0])


def _origin(rotation, position):
    return f'<origin xyz="{_numbers(position)}" rpy="{_numbers(roll_pitch_yaw(rotation))}"/>'


def _link(name, inertia):
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments = inertia.tensor[np.triu_indices(3)]
    entries = " ".join(f'{name}="{value:.12g}"' for name, value in zip(names, moments))
    return (
        f'  <link name="{name}">\n    <inertial>\n      <origin xyz="{_numbers(inertia.com)}" rpy="0 0 0"/>\n'
        f'      <mass value="{inertia.mass:.12g}"/>\n      <inertia {entries}/>\n    </inertial>\n  </link>\n'
    )


def _joint(link, parent, motor, speed):
    kind = "fixed" if link.fixed else "continuous" if link.continuous else "revolute"
    travel = "" if link.continuous else f'lower="{link.lower:.6g}" upper="{link.upper:.6g}" '
    return (
        f'  <joint name="{link.joint}" type="{kind}">\n    <parent link="{parent}"/>\n    <child link="{link.name}"/>\n'
        f'    {_origin(link.rotation, link.position)}\n    <axis xyz="{_numbers(link.axis)}"/>\n'
        f'    <limit {travel}effort="{motor.tau_max:.6g}" velocity="{speed:.6g}"/>\n  </joint>\n'
    )


def urdf_text(rig):
    """The rig as URDF."""
    parts = [f'<?xml version="1.0"?>\n<robot name="{rig.name}">\n  <link name="{rig.base}"/>\n']
    parent = rig.base
    for link, motor in zip(rig.links, rig.motors):
        parts += [_link(link.name, link.inertia), _joint(link, parent, motor, rig.velocity_limit)]
        parent = link.name
    payload = rig.payload
    parts.append(_link(payload.name, payload.inertia))
    parts.append(
        f'  <joint name="{payload.joint}" type="fixed">\n    <parent link="{parent}"/>\n'
        f'    <child link="{payload.name}"/>\n    {_origin(payload.rotation, payload.position)}\n  </joint>\n</robot>\n'
    )
    return "".join(parts)


def yaml_text(rig, encoder_bits, trusted):
    """The YAML beside the URDF: motors and limits, and whether the URDF's inertias are to be trusted."""
    heads = ["urdf: rig.urdf", *(["inertia: trusted"] if trusted else [])]
    motors = ["motors:"]
    limits = ["limits:"]
    for link, motor in zip(rig.links, rig.motors):
        if link.fixed:
            continue
        motors.append(
            f"  {link.joint}: {{torque_constant: {motor.torque_constant:.6g}, tau_max: {motor.tau_max:.6g}, "
            f"slots: {motor.slots}, poles: {motor.poles}, encoder_bits: {encoder_bits}}}"
        )
        travel = "" if link.continuous else f"lower: {link.lower:.6g}, upper: {link.upper:.6g}, "
        limits.append(
            f"  {link.joint}: {{{travel}velocity: {rig.velocity_limit:.6g}, effort: {motor.tau_max:.6g}}}"
        )
    return "\n".join([*heads, *motors, *limits, ""])
