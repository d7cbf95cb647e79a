"""Elements of a URDF, from poses and bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.rig import urdf

DRAKE = "http://drake.mit.edu"
"""Namespace of the tag for a rotor's inertia, of which plain URDF has none."""


def spelled(values: Sequence[float] | np.ndarray) -> str:
    """Return numbers as an attribute holds them."""
    return " ".join(f"{x:.17g}" for x in values)


def robot(name: str) -> etree._Element:
    """Return an empty robot."""
    return etree.Element("robot", {"name": name}, nsmap={"drake": DRAKE})


def put_origin(element: etree._Element, pose: pin.SE3) -> None:
    """Set the pose of an element."""
    origin = urdf.child(element, "origin")
    origin.set("xyz", spelled(pose.translation))
    origin.set("rpy", spelled(pin.rpy.matrixToRpy(pose.rotation)))


def add_joint(
    out: etree._Element, name: str, kind: str, parent: str, child: str, origin: pin.SE3, axis: np.ndarray | None = None
) -> etree._Element:
    """Add a joint; its axis is in the child's axes."""
    joint = etree.SubElement(out, "joint", name=name, type=kind)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    put_origin(joint, origin)
    if axis is not None:
        etree.SubElement(joint, "axis", xyz=spelled(axis))
    return joint


def add_sensor(out: etree._Element, name: str, kind: str, link: str, origin: pin.SE3) -> None:
    """Add a link without mass where a sensor sits, its x forward, and the tag that says so, as Gazebo writes it."""
    taken = {*urdf.names(out, "link"), *urdf.names(out, "joint")}
    free = next(word for word in (name, f"{link}_{name}", f"{link}_{name}_{kind}") if word not in taken)
    etree.SubElement(out, "link", name=free)
    add_joint(out, f"{free}_on_{link}", "fixed", link, free, origin)
    etree.SubElement(etree.SubElement(out, "gazebo", reference=free), "sensor", name=name, type=kind)


def add_armature(out: etree._Element, joint: str, inertia: float) -> None:
    """Say what inertia a joint's motor has of its own, kg m² at the joint."""
    transmission = etree.SubElement(out, "transmission", name=f"{joint}_transmission")
    etree.SubElement(transmission, "joint", name=joint)
    actuator = etree.SubElement(transmission, "actuator", name=f"{joint}_motor")
    etree.SubElement(actuator, f"{{{DRAKE}}}gear_ratio", value="1")
    etree.SubElement(actuator, f"{{{DRAKE}}}rotor_inertia", value=spelled([inertia]))


def add_visual(link: etree._Element, pose: pin.SE3, shape: str, **sizes: str) -> etree._Element:
    """Add a shape to what is seen of a link."""
    visual = etree.SubElement(link, "visual")
    put_origin(visual, pose)
    etree.SubElement(etree.SubElement(visual, "geometry"), shape, sizes)
    return visual


def written(out: etree._Element) -> str:
    """Return the text, on one line: its lines are none of the file's that it was made of."""
    return str(etree.tostring(out, encoding="unicode"))
