"""URDF text: parse it, check it, mount a payload, write inertial parameters back in place."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from gimbal_pin.errors import FEW, RigError
from gimbal_pin.rig.urdf_checks import (
    ENTRIES,
    MOVABLE,
    check_joint,
    check_names,
    check_numbers,
    check_references,
    names,
    repeated,
)

if TYPE_CHECKING:
    import yourdfpy


def parse(text: str, place: str) -> etree._Element:
    """Return the ``<robot>`` element of a URDF; `RigError` names the line where the XML breaks."""
    robot = parse_xml(text, place)
    if robot.tag != "robot":
        raise RigError(place, f"starts with <{robot.tag}>, not <robot>", "give a URDF")
    return robot


def parse_xml(text: str, place: str) -> etree._Element:
    """Return the root element of a file of XML without a document type; `RigError` names the line where it breaks."""
    try:
        # The text is decoded already, whatever encoding it declares.
        parser = etree.XMLParser(encoding="utf-8", resolve_entities=False, load_dtd=False, no_network=True)
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise RigError(f"{place}:{error.lineno}", f"is not XML: {error.msg}", "mend the file there") from error
    if root.getroottree().docinfo.doctype:
        raise RigError(place, "declares a document type, whose entities readers take differently", "take it out")
    return root


def tree(text: str, place: str, fixed: Collection[str] = ()) -> etree._Element:
    """Return a file's ``<robot>`` once its names, references, tree and numbers are found to be in order.

    `fixed`: joints that will be held.

    Raises:
        RigError: The first thing that is not, with the line of the file where it has one.
    """
    robot = parse(text, place)
    if robot.xpath("joint/parent[@link='world']") and "world" not in names(robot, "link"):
        robot.insert(0, etree.Element("link", name="world"))  # simulators know it without being told
    check_names(robot, place, fixed)
    check_references(robot, place)
    root_link(robot, place)
    check_numbers(robot, place)
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


def root_link(robot: etree._Element, place: str) -> str:
    """Return the one link that is no joint's child; `RigError` on none or several, or if a loop is anywhere."""
    links, children = names(robot, "link"), [child.get("link", "") for child in robot.iterfind("joint/child")]
    if twice := repeated(children):
        raise RigError(place, f"link '{twice[0]}' has two parent joints: the rig is a loop, not a tree", "cut the loop")
    inner = set(children)
    roots = [link for link in links if link not in inner]
    if len(roots) != 1:
        what = f"{len(roots)} root links: {', '.join(roots[:FEW])}" if roots else "no root link: its joints form a loop"
        raise RigError(place, f"has {what}", "connect all links to one base by joints")
    if apart := set(links) - reached(robot, roots[0]):
        raise RigError(place, f"link '{min(apart)}' hangs in a loop of joints apart from '{roots[0]}'", "cut the loop")
    return roots[0]


def reached(robot: etree._Element, root: str) -> set[str]:
    """Return the links that joints lead to from `root`, itself included."""
    below: dict[str, list[str]] = {}
    for joint in robot.findall("joint"):
        below.setdefault(joint.find("parent").get("link"), []).append(joint.find("child").get("link"))
    links, fresh = {root}, [root]
    while fresh:
        fresh = [child for parent in fresh for child in below.get(parent, ()) if child not in links]
        links.update(fresh)
    return links


def sensed(robot: etree._Element, kind: str) -> list[str]:
    """Return the links on which Gazebo's tags (``<gazebo reference="LINK"><sensor type="KIND">``) put a sensor."""
    found = [tag.get("reference", "") for tag in robot.findall("gazebo") if tag.xpath("sensor[@type=$k]", k=kind)]
    return [link for link in names(robot, "link") if link in found]


def skeleton(robot: etree._Element, *more: str) -> str:
    """Strip a robot of all but inertials, joints and the parts of links named in `more`, in place; return its text.

    urdfdom prints on standard error what it does not like. It does not see the rest, and this has been checked.
    """
    etree.strip_elements(robot, etree.Comment, etree.ProcessingInstruction, with_tail=False)
    kept = {"link": ("inertial", *more), "joint": ("parent", "child", "origin", "axis", "limit")}
    for key in set(robot.attrib) - {"name"}:
        del robot.attrib[key]
    for element in list(robot):
        for part in list(element):
            if part.tag not in kept.get(element.tag, ()):
                element.remove(part)
        if element.tag not in kept:
            robot.remove(element)
    return etree.tostring(robot, encoding="unicode")


def checked(text: str, place: str) -> yourdfpy.Robot:
    """Return the URDF as yourdfpy's dataclasses after checking tree, joint types, axes and limits.

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
    if not any(joint.type in MOVABLE and joint.mimic is None for joint in rig.joints):
        raise RigError(place, "has no movable joint", "give at least one revolute, continuous or prismatic joint")
    return rig


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

    `inertials`: link → mass, kg, centre of mass, m, (3,), inertia about it, kg m², (3, 3), in the link's frame.
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
