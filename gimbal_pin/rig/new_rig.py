"""A YAML for a rig: what a URDF cannot state, guessed from names and tags, the rest as comments to fill in."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from gimbal_pin.rig import urdf
from gimbal_pin.rig.config import Motor
from gimbal_pin.rig.files import bundled
from gimbal_pin.rig.reading import split_words
from gimbal_pin.rig.rig import Rig

_CAMERA_WORDS = {"camera", "cam", "lens", "eye", "gopro", "rgb"}
_OPTICAL_WORDS = {"optical"}
"""Words of frames that look along z, as ROS has it (REP 103)."""
_IMU_WORDS = {"imu", "gyro", "imus"}
_MOUNT_WORDS = {"mount", "flange", "tool", "plate", "tool0"}

_MOTOR_EXAMPLE = "tau_max: 2.0, torque_constant: 0.5, slots: 24, poles: 28, encoder_bits: 14"
_TEMPLATE = """\
# The rig {name}, as 'gimbal-pin new-rig' found it. SI units and radians. What was guessed says so; an entry behind a #
# states nothing yet. 'gimbal-pin check' of this file says what comes of it.
urdf: {urdf}
#description: one sentence
{xacro}
# The link that carries the camera, and which of its axes looks: x, -x, y, -y, z or -z. ROS's optical frames look along
# z; of many a gimbal the camera looks along -x. {why}
camera_frame: {camera}
optical_axis: {axis}

# The link that a payload (--payload) is fixed to, by the payload's root link. Guessed.
mount: {mount}
#payload: mirrorless

# Links that carry an IMU. A log holds gyro_LINK_x/y/z and accel_LINK_x/y/z in that link's axes; on the base link, here
# {base}, they tell how the rig is carried. 'simulate --imus' records them. {found}
{hash_imus}imus: [{imus}]
# Densities of their noise: gyro rad/s/√Hz, accelerometer m/s²/√Hz; a data sheet's °/s/√Hz are 0.01745 of the first, its
# µg/√Hz 9.81e-6 of the second. Here those of the bundled rigs' sensors.
#noise: {{gyro: 8.7e-5, accelerometer: 9.8e-4}}

# Motors, all at the joint: tau_max N m, torque_constant N m/A, slots and poles (cogging), encoder_bits of one turn,
# encoder_zero rad, the mapped reading at the URDF's zero;
# gear_ratio turns of the rotor per turn of the joint and rotor_inertia kg m² at the rotor make up its armature.
{motors}

# Limits that replace or complete the URDF's: lower, upper rad, velocity rad/s, acceleration rad/s², effort N m. No
# URDF states an acceleration; 'excite' then has only the torque to go by.
limits:
{limits}

# Joints that the log does not hold: each is held at that angle, rad, or place, m, and is no joint of the rig any more.
{fixed}

# 'trusted' makes what differs from the URDF's masses and inertias a finding of 'diagnose'.
#inertia: trusted
"""


def propose_config(rig: Rig, folder: Path) -> str:
    """Return a YAML for a rig, to stand in a folder: what the rig's own files state, and what may be added."""
    links = urdf.list_element_names(element := urdf.parse_robot(rig.urdf, str(rig.path)), "link")
    camera, axis, why = _find_camera(rig, links, urdf.find_sensor_links(element, "camera"))
    tagged = urdf.find_sensor_links(element, "imu")
    imus = tuple(dict.fromkeys((*rig.config.imus, *tagged, *_select_by_words(links, _IMU_WORDS))))
    arguments = ", ".join(
        f"{_format_scalar(key)}: {_format_scalar(value)}" for key, value in rig.config.xacro.items()
    )
    empty = "# Arguments of the xacro file.\n" + (
        f"xacro: {{{arguments}}}\n" if arguments else "#xacro: {}\n"
    )
    idle = [joint for joint, limit in zip(rig.joints, rig.tau_max) if np.isinf(limit)]
    held = ", ".join(f"{_format_scalar(joint)}: 0.0" for joint in idle if len(idle) < rig.n)
    kept = ", ".join(f"{_format_scalar(joint)}: {at!r}" for joint, at in rig.config.fixed.items())
    mount = rig.config.mount
    if mount is None:  # named so and moved by as many joints as the camera, or else the last link
        high = _count_joints_above(rig, camera)
        mount = next(
            (
                link
                for link in _select_by_words(links, _MOUNT_WORDS)
                if _count_joints_above(rig, link) >= high
            ),
            rig.links[-1],
        )
    motors = []
    limits = []
    for joint, motor, limit in zip(rig.joints, rig.motors, rig.limits):
        stated = {
            key: repr(value) for key, value in vars(motor).items() if value != getattr(Motor(), key)
        }
        motors.append(_format_joint(joint, stated, _MOTOR_EXAMPLE))
        finite = (
            {"acceleration": repr(limit.acceleration)} if np.isfinite(limit.acceleration) else {}
        )
        limits.append(_format_joint(joint, finite, "acceleration: 20.0"))
    return _TEMPLATE.format(
        name=rig.name,
        urdf=_format_scalar(
            rig.name
            if rig.path.parent == bundled()
            else os.path.relpath(rig.path.resolve(), folder.resolve())
        ),
        xacro=empty if rig.path.suffix == ".xacro" or arguments else "",
        camera=_format_scalar(camera),
        axis=axis,
        why=why,
        mount=_format_scalar(mount),
        base=rig.base,
        found=f"Found: {', '.join(imus)}." if imus else "None was found by its name or its tag.",
        hash_imus="" if imus else "#",
        imus=", ".join(map(_format_scalar, imus or (rig.base, rig.links[-1]))),
        motors="motors:\n" + "\n".join(motors),
        limits="\n".join(limits),
        fixed=f"fixed: {{{kept}}}" if kept else f"#fixed: {{{held}}}",
    )


def _find_camera(rig: Rig, links: list[str], sensed: list[str]) -> tuple[str, str, str]:
    """Return the link that carries the camera, its axis that looks, and why.

    Of several the one that most joints move.
    """
    if rig.config.camera_frame is not None:
        return rig.config.camera_frame, rig.config.optical_axis, "As the rig's own YAML has it."
    optical = [
        link
        for link in _select_by_words(links, _OPTICAL_WORDS)
        if set(split_words(link)) & _CAMERA_WORDS or not sensed
    ]
    for found, axis, why in (
        ([link for link in links if link == "camera"], "x", "Guessed by its name."),
        (sensed, "x", "Guessed by Gazebo's tag for a camera, which looks along x."),
        (optical, "z", "Guessed: ROS's names for frames that look along z."),
        (
            _select_by_words(links, _CAMERA_WORDS),
            "x",
            "Guessed by its name; the axis is a guess without reason.",
        ),
    ):
        if found:
            return max(found, key=lambda link: _count_joints_above(rig, link)), axis, why
    return rig.camera_frame, "x", "Guessed: the last link, and no reason for the axis."


def _select_by_words(links: Iterable[str], wanted: set[str]) -> list[str]:
    """Return the links whose names contain one of the words."""
    return [link for link in links if set(split_words(link)) & wanted]


def _count_joints_above(rig: Rig, link: str) -> int:
    """Return how many joints move a link."""
    frame = rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)]
    return len(rig.model.supports[frame.parentJoint])


def _format_joint(joint: str, stated: dict[str, str], example: str) -> str:
    """Return the line of a joint: what is stated of it, or else an example in a comment."""
    line = f"  {_format_scalar(joint)}: {{{', '.join(f'{key}: {value}' for key, value in stated.items())}}}"
    return line if stated else f"{line}  # {example}"


def _format_scalar(value: Any) -> str:
    """Return a text as YAML holds it inside braces."""
    return str(
        yaml.safe_dump([value], default_flow_style=True, width=10**6, allow_unicode=True)
    ).strip()[1:-1]
