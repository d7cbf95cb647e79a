"""Whether a URDF describes a rig: names, references, numbers, joints and inertias that can be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from gimbal_pin.errors import RigError

if TYPE_CHECKING:
    import yourdfpy


MOVABLE = ("revolute", "continuous", "prismatic")
ENTRIES = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
"""Attribute, row and column of the entries of a URDF's inertia."""
NUMBERS: Mapping[str, Mapping[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
}
"""Tag → its attributes that hold numbers, and how many."""
REQUIRED = {"axis": {"xyz"}, "limit": {"effort", "velocity"}, "mass": {"value"}, "inertia": set(NUMBERS["inertia"])}
"""Attributes that must be there: readers differ in what they take a missing one for, and some drop the whole tag."""


def names(robot: etree._Element, tag: str) -> list[str]:
    """Return the names of the robot's links, joints or materials, in the file's order."""
    return [element.get("name", "") for element in robot.findall(tag)]


def check_names(robot: etree._Element, place: str) -> None:
    """Raise `RigError` if the robot, a link or a joint has no name, or if two links or two joints share one."""
    for element in (robot, *robot.findall("link"), *robot.findall("joint")):
        if not element.get("name"):
            raise RigError(f"{place}:{element.sourceline}", f"<{element.tag}> has no name", "give it one")
    for tag in ("link", "joint"):
        if twice := sorted({name for name in names(robot, tag) if names(robot, tag).count(name) > 1}):
            raise RigError(place, f"two {tag}s are named '{twice[0]}'", "rename one")


def check_references(robot: etree._Element, place: str) -> None:
    """Raise `RigError` if a joint's parent or child is missing or no link."""
    links = set(names(robot, "link"))
    for joint in robot.findall("joint"):
        for role in ("parent", "child"):
            element = joint.find(role)
            if element is None or element.get("link") not in links:
                missing = "nothing" if element is None else f"'{element.get('link')}'"
                raise RigError(
                    f"{place}:{joint.sourceline}",
                    f"joint '{joint.get('name')}' has {missing} as {role}, which is no link of the file",
                    "name a link that exists",
                )


def check_numbers(robot: etree._Element, place: str) -> None:
    """Raise `RigError` where an attribute of `NUMBERS` is missing, or is not as many finite numbers as it should be."""
    for element in robot.xpath("joint/* | link/inertial/* | link/visual/origin | link/collision/origin"):
        for attribute, count in NUMBERS.get(element.tag, {}).items():
            text = element.get(attribute)
            where = f"{place}:{element.sourceline}"
            if text is None and attribute in REQUIRED.get(element.tag, ()):
                raise RigError(where, f"<{element.tag}> has no {attribute}", "give it")
            if text is not None and not numeric(text, count):
                what = "a finite number" if count == 1 else f"{count} finite numbers"
                raise RigError(where, f"<{element.tag}> has {attribute}='{text}'", f"write {what}")


def numeric(text: str, count: int) -> bool:
    """Tell whether `text` is `count` finite numbers parted by blanks."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == count and bool(np.isfinite(values).all())


def check_joint(joint: yourdfpy.Joint, place: str) -> None:
    """Raise `RigError` unless the joint is fixed, or movable with a usable axis, ordered limits and real friction."""
    where = f"{place}: joint '{joint.name}'"
    if joint.type == "fixed":
        return
    if joint.type not in MOVABLE:
        raise RigError(where, f"is of type {joint.type}", f"use one of {', '.join(MOVABLE)}, or fixed")
    if not np.linalg.norm(joint.axis) > 0:
        raise RigError(where, "has an axis of zero length", "give a direction, e.g. xyz='0 0 1'")
    if joint.mimic is not None:
        raise RigError(where, "mimics another joint", "drive it by a motor of its own, or make it fixed")
    limit, dynamics = joint.limit, joint.dynamics
    if joint.type != "continuous" and limit is None:
        raise RigError(where, "has no <limit>", "give lower, upper, effort and velocity, or make it continuous")
    if joint.type != "continuous" and (limit.lower or 0.0) > (limit.upper or 0.0):
        raise RigError(where, f"has lower limit {limit.lower} above upper {limit.upper}", "swap them")
    if limit is not None and min(limit.effort, limit.velocity) < 0:
        raise RigError(where, "has a negative limit of effort or velocity", "give its size")
    if dynamics is not None and min(float(dynamics.damping or 0.0), float(dynamics.friction or 0.0)) < 0:
        raise RigError(where, "has negative friction or damping", "give its size, or 0")


def check_inertial(link: etree._Element, place: str) -> None:
    """Raise `RigError` unless mass > 0, the inertia at the centre of mass is positive definite and I₁ + I₂ ≥ I₃."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"{place}:{inertial.sourceline}: link '{link.get('name')}'"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or not float(mass.get("value")) > 0:
        stated = "no mass" if mass is None else f"mass {mass.get('value')}"
        raise RigError(where, f"has {stated}", "give a positive mass in kg, or leave <inertial> out")
    if inertia is None:
        raise RigError(where, "has a mass but no inertia", "give <inertia> in kg m²")
    lower_triangle = np.zeros((3, 3))
    for name, row, column in ENTRIES:
        lower_triangle[column, row] = float(inertia.get(name))
    small, middle, large = np.linalg.eigvalsh(lower_triangle, UPLO="L")
    if not small > 0:
        raise RigError(where, f"has an inertia that is not positive definite (principal {small:.3g} kg m²)", "mend it")
    if small + middle < large * (1 - 1e-9):
        what = f"breaks the triangle inequality: principal inertias {small:.4g} + {middle:.4g} < {large:.4g} kg m²"
        raise RigError(where, what, "no body has such an inertia: recompute it")
