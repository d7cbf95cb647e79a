"""URDF text: parse it, check it, mount a payload, write inertial parameters back in place."""

from __future__ import annotations

import io
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


def parse(text: str, place: str) -> etree._Element:
    """Return the ``<robot>`` element of a URDF; `RigError` names the line where the XML breaks."""
    try:
        robot = etree.fromstring(text.encode(), etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        raise RigError(f"{place}:{error.lineno}", f"is not XML: {error.msg}", "mend the file there") from error
    if robot.tag != "robot":
        raise RigError(place, f"starts with <{robot.tag}>, not <robot>", "give a URDF")
    return robot


def tree(text: str, place: str) -> etree._Element:
    """Return a file's ``<robot>`` once its names, references, tree, numbers and inertias are found to be in order.

    Raises:
        RigError: The first thing that is not, with the line of the file where it has one.
    """
    robot = parse(text, place)
    check_names(robot, place)
    check_references(robot, place)
    root_link(robot, place)
    check_numbers(robot, place)
    for link in robot.findall("link"):
        check_inertial(link, place)
    return robot


def to_text(robot: etree._Element) -> str:
    """Return the element as XML text with its declaration."""
    return etree.tostring(robot.getroottree(), xml_declaration=True, encoding="utf-8", pretty_print=True).decode()


def mount(rig: etree._Element, payload: etree._Element, at: str, place: str) -> None:
    """Fix the payload's root link to the rig's link `at`, in place: the payload's tree joins the rig's.

    Raises:
        RigError: The rig has no such link, or both carry a link or joint of the same name.
    """
    if at not in names(rig, "link"):
        raise RigError(place, f"has no link '{at}' to mount the payload on", "name it with 'mount:' in the rig's YAML")
    for tag in ("link", "joint"):
        if twice := set(names(rig, tag)) & set(names(payload, tag)):
            raise RigError(place, f"rig and payload both have a {tag} '{min(twice)}'", "rename it in the payload")
    root = root_link(payload, place)
    materials = set(names(rig, "material"))
    for element in payload:
        if not (element.tag == "material" and element.get("name") in materials):
            rig.append(element)
    joint = etree.SubElement(rig, "joint", name=f"{at}_to_{root}", type="fixed")
    etree.SubElement(joint, "parent", link=at)
    etree.SubElement(joint, "child", link=root)


def names(robot: etree._Element, tag: str) -> list[str]:
    """Return the names of the robot's links, joints or materials, in the file's order."""
    return [element.get("name", "") for element in robot.findall(tag)]


def root_link(robot: etree._Element, place: str) -> str:
    """Return the one link that is no joint's child; `RigError` on none or several, or if a loop is anywhere."""
    children = [child.get("link", "") for child in robot.iterfind("joint/child")]
    if twice := sorted({link for link in children if children.count(link) > 1}):
        raise RigError(place, f"link '{twice[0]}' has two parent joints: the rig is a loop, not a tree", "cut the loop")
    roots = [link for link in names(robot, "link") if link not in children]
    if len(roots) != 1:
        what = "no root link: its joints form a loop" if not roots else f"{len(roots)} root links: {', '.join(roots)}"
        raise RigError(place, f"has {what}", "connect all links to one base by joints")
    if apart := set(names(robot, "link")) - reached(robot, roots[0]):
        raise RigError(place, f"link '{min(apart)}' hangs in a loop of joints apart from '{roots[0]}'", "cut the loop")
    return roots[0]


def reached(robot: etree._Element, root: str) -> set[str]:
    """Return the links that joints lead to from `root`, itself included."""
    edges = [(joint.find("parent").get("link"), joint.find("child").get("link")) for joint in robot.findall("joint")]
    links, fresh = {root}, {root}
    while fresh:
        fresh = {child for parent, child in edges if parent in fresh} - links
        links |= fresh
    return links


def checked(text: str, place: str) -> yourdfpy.Robot:
    """Return the URDF as yourdfpy's dataclasses after checking tree, joint types, axes, limits and inertias.

    Raises:
        RigError: The first thing that keeps the URDF from being a rig.
    """
    import yourdfpy

    tree(text, place)
    try:
        rig = yourdfpy.URDF.load(io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False).robot
    except (ValueError, TypeError, AttributeError, LookupError) as error:
        raise RigError(place, f"is not a URDF that yourdfpy reads ({error})", "mend the attribute it names") from error
    for joint in rig.joints:
        check_joint(joint, place)
    if not any(joint.type in MOVABLE for joint in rig.joints):
        raise RigError(place, "has no movable joint", "give at least one revolute, continuous or prismatic joint")
    return rig


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


def inertials(text: str) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
    """Return link → (mass, centre of mass (3,), inertia about it (3, 3)), in its own frame, where it has mass."""
    import yourdfpy

    robot = yourdfpy.URDF.load(io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False).robot
    out = {}
    for link in robot.links:
        if link.inertial is not None:
            origin = np.eye(4) if link.inertial.origin is None else link.inertial.origin
            R = origin[:3, :3]
            out[link.name] = (float(link.inertial.mass), origin[:3, 3].copy(), R @ link.inertial.inertia @ R.T)
    return out


def with_inertials(text: str, inertials: Mapping[str, tuple[float, np.ndarray, np.ndarray]]) -> str:
    """Return the URDF with the named links' ``<inertial>`` values replaced and every other tag kept.

    Args:
        text: URDF.
        inertials: Link → (mass kg, centre of mass m (3,), inertia about it kg m² (3, 3)), in the link's frame.
    """
    robot = parse(text, "URDF")
    for link in robot.findall("link"):
        if link.get("name") in inertials:
            write_inertial(link, *inertials[link.get("name")])
    return to_text(robot)


def with_friction(text: str, friction: Mapping[str, tuple[float, float]]) -> str:
    """Return the URDF with the named joints' ``<dynamics>`` friction N m and damping N m s/rad replaced.

    A URDF holds no negative friction: a value that noise made negative is written as zero.
    """
    robot = parse(text, "URDF")
    for joint in robot.findall("joint"):
        if joint.get("name") in friction:
            for name, value in zip(("friction", "damping"), friction[joint.get("name")]):
                child(joint, "dynamics").set(name, f"{max(value, 0.0):.17g}")
    return to_text(robot)


def write_inertial(link: etree._Element, mass: float, com: np.ndarray, inertia: np.ndarray) -> None:
    """Set one link's ``<inertial>``, turned to the link's axes (rpy = 0)."""
    origin, heavy, inert = (child(child(link, "inertial"), tag) for tag in ("origin", "mass", "inertia"))
    origin.set("xyz", " ".join(f"{x:.17g}" for x in com))
    origin.set("rpy", "0 0 0")
    heavy.set("value", f"{mass:.17g}")
    for name, row, column in ENTRIES:
        inert.set(name, f"{inertia[row, column]:.17g}")


def child(parent: etree._Element, tag: str) -> etree._Element:
    """Return the element's first child of a tag, made where there is none."""
    found = parent.find(tag)
    return etree.SubElement(parent, tag) if found is None else found
