"""A controller as a package for ros2_control: a plugin over the C99 sources, its YAML, and the identified URDF."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from lxml import etree

from gimbal_pin.control.tuning import StoredController
from gimbal_pin.effects.resistance import Resistance
from gimbal_pin.errors import UsageError
from gimbal_pin.export.sources import C_SOURCES, rendered
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.sight import gyros_between, unable
from gimbal_pin.rig.inertia import to_urdf
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.urdf import replace_friction

TEMPLATES = (
    "gimbal_ros2_controller.hpp",
    "gimbal_ros2_controller.cpp",
    "package.xml",
    "gimbal_plugin.xml",
    "CMakeLists.txt",
    "controllers.yaml",
)
PACKAGE_FILES = (*C_SOURCES, *TEMPLATES, "gimbal.urdf")
"""All files of such a package."""


def package(stored: StoredController, c: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a package whose plugin runs the controller `c`.

    Raises:
        UsageError: The rig cannot hold its camera on a base that moves.
    """
    rig = stored.model.rig
    if why := unable(rig, WANTED):
        raise UsageError(
            "--ros2",
            f"holds a camera, which {rig.name} cannot: {why}",
            "use --c and gimbal_tracking_step",
        )
    links = gyros_between(rig)
    context = {
        "package": f"gimbal_{re.sub(r'[^a-z0-9]+', '_', rig.name.lower()).strip('_') or 'rig'}",
        "rig": rig,
        "rate": round(1 / stored.wish.dt),
        "camera_imu": imu(rig.camera_frame),
        "base_imu": imu(rig.base),
        "link_imus": [imu(link) for link in links],
        "links": len(links),
    }
    made = rendered(context, [f"ros2/{name}" for name in TEMPLATES])
    sources = {name: c[name] for name in C_SOURCES}
    return {
        **sources,
        **{name.removeprefix("ros2/"): text for name, text in made.items()},
        "gimbal.urdf": urdf(stored),
    }


def imu(link: str) -> str:
    """Name of a link's IMU as a sensor of ros2_control."""
    return f"{link}_imu"


def urdf(stored: StoredController) -> str:
    """Return the URDF of the model inside the controller, with a ``<ros2_control>`` of its joints and IMUs."""
    rig = stored.model.rig
    friction = Resistance(stored.model.by_joint)
    rows = {
        joint: (friction.per_slide[j], friction.per_rate[j]) for j, joint in enumerate(rig.joints)
    }
    robot = etree.fromstring(replace_friction(to_urdf(rig, rig.phi), rows).encode())
    for old in robot.findall("ros2_control"):
        robot.remove(old)
    robot.append(tags(rig))
    etree.indent(robot[-1], level=1)
    return etree.tostring(robot, encoding="unicode") + "\n"


def tags(rig: Rig) -> Any:
    """Return the ``<ros2_control>`` of a rig; its hardware is ros2_control's own loop-back until one is named."""
    system = etree.Element("ros2_control", name=rig.name, type="system")
    hardware = etree.SubElement(system, "hardware")
    etree.SubElement(hardware, "plugin").text = "mock_components/GenericSystem"
    for name, limit in zip(rig.joints, rig.tau_max.tolist()):
        joint = etree.SubElement(system, "joint", name=name)
        command = etree.SubElement(joint, "command_interface", name="effort")
        etree.SubElement(command, "param", name="min").text = f"{-limit:g}"
        etree.SubElement(command, "param", name="max").text = f"{limit:g}"
        for state in ("position", "velocity", "effort"):
            etree.SubElement(joint, "state_interface", name=state)
    for link in (rig.camera_frame, rig.base, *gyros_between(rig)):
        sensor = etree.SubElement(system, "sensor", name=imu(link))
        for quantity in (
            "angular_velocity",
            *(["linear_acceleration"] if link == rig.base else []),
        ):
            for axis in "xyz":
                etree.SubElement(sensor, "state_interface", name=f"{quantity}.{axis}")
        etree.SubElement(sensor, "param", name="frame_id").text = link
    return system
