"""URDF text: parse it, check it, mount a payload, add elements, write inertial parameters back in place."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import FEW, RigError
from gimbal_pin.rig.urdf_checks import (
    INERTIA_ENTRIES,
    check_joints,
    check_names,
    check_numbers,
    check_references,
    find_repeated,
    list_element_names,
    read_inertia,
)

if TYPE_CHECKING:
    import yourdfpy

_MOST_ATTRIBUTES = 256
"""Most attributes of one element: MJCF's largest has 30, and readers take a time that grows with their square."""
DRAKE_NAMESPACE = "http://drake.mit.edu"
"""Namespace of the tag for a rotor's inertia, of which plain URDF has none."""
LinkInertia = tuple[float, np.ndarray, np.ndarray]
"""Mass, kg, centre of mass, m, (3,), and inertia about it, kg m², (3, 3), in the link's frame."""


def parse_robot(text: str, place: str) -> etree._Element:
    """Return the ``<robot>`` element of a URDF; `RigError` names the line where the XML breaks."""
    robot = parse_xml(text, place)
    if robot.tag != "robot":
        raise RigError(place, f"starts with <{robot.tag}>, not <robot>", "give a URDF")
    return robot


def parse_xml(text: str, place: str) -> etree._Element:
    """Return the root element of a file of XML without a document type; `RigError` names the line where it breaks."""
    try:
        # The text is decoded already, whatever encoding it declares.
        parser = etree.XMLParser(
            encoding="utf-8", resolve_entities=False, load_dtd=False, no_network=True
        )
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise RigError(
            f"{place}:{error.lineno}", f"is not XML: {error.msg}", "mend the file there"
        ) from error
    if (
        crowded := next((one for one in root.iter() if len(one.attrib) > _MOST_ATTRIBUTES), None)
    ) is not None:
        where = f"{place}:{crowded.sourceline}"
        what = f"<{crowded.tag}> has more than {_MOST_ATTRIBUTES} attributes"
        raise RigError(where, what, "take out what describes no rig")
    if root.getroottree().docinfo.doctype:
        raise RigError(
            place,
            "declares a document type, whose entities readers take differently",
            "take it out",
        )
    return root


def parse_checked(text: str, place: str, fixed: Collection[str] = ()) -> etree._Element:
    """Return a file's ``<robot>`` once its names, references, tree and numbers are found to be in order.

    `fixed`: joints that will be held.

    Raises:
        RigError: The first thing that is not, with the line of the file where it has one.
    """
    robot = parse_robot(text, place)
    if robot.xpath("joint/parent[@link='world']") and "world" not in list_element_names(
        robot, "link"
    ):
        robot.insert(
            0, etree.Element("link", name="world")
        )  # simulators know it without being told
    check_names(robot, place, fixed)
    check_references(robot, place)
    find_root_link(robot, place)
    check_numbers(robot, place)
    return robot


def to_text(robot: etree._Element) -> str:
    """Return the element as XML text with its declaration."""
    return etree.tostring(
        robot.getroottree(), xml_declaration=True, encoding="utf-8", pretty_print=True
    ).decode()


def mount(rig: etree._Element, payload: etree._Element, at: str, place: str) -> None:
    """Fix the payload's root link to the rig's link `at`, in place: the payload's tree joins the rig's.

    Raises:
        RigError: The rig has no such link, or both carry a link or joint of the same name.
    """
    if at not in list_element_names(rig, "link"):
        raise RigError(
            place,
            f"has no link '{at}' to mount the payload on",
            "name it with 'mount:' in the rig's YAML",
        )
    for tag in ("link", "joint"):
        if twice := set(list_element_names(rig, tag)) & set(list_element_names(payload, tag)):
            mend = "name the rig without it, as 'identify --urdf' was given it, or rename it in the payload"
            raise RigError(place, f"rig and payload both have a {tag} '{min(twice)}'", mend)
    root = find_root_link(payload, place)
    materials = set(list_element_names(rig, "material"))
    for element in payload:
        if not (element.tag == "material" and element.get("name") in materials):
            rig.append(element)
    add_joint(rig, f"{at}_to_{root}", "fixed", at, root)


def find_root_link(robot: etree._Element, place: str) -> str:
    """Return the one link that is no joint's child; `RigError` on none or several, or if a loop is anywhere."""
    links = list_element_names(robot, "link")
    children = [child.get("link", "") for child in robot.iterfind("joint/child")]
    if twice := find_repeated(children):
        raise RigError(
            place,
            f"link '{twice[0]}' has two parent joints: the rig is a loop, not a tree",
            "cut the loop",
        )
    inner = set(children)
    roots = [link for link in links if link not in inner]
    if len(roots) != 1:
        what = (
            f"{len(roots)} root links: {', '.join(roots[:FEW])}"
            if roots
            else "no root link: its joints form a loop"
        )
        raise RigError(place, f"has {what}", "connect all links to one base by joints")
    if apart := set(links) - find_reached_links(robot, roots[0]):
        raise RigError(
            place,
            f"link '{min(apart)}' hangs in a loop of joints apart from '{roots[0]}'",
            "cut the loop",
        )
    return roots[0]


def find_reached_links(robot: etree._Element, root: str) -> set[str]:
    """Return the links that joints lead to from `root`, itself included."""
    below: dict[str, list[str]] = {}
    for joint in robot.findall("joint"):
        below.setdefault(joint.find("parent").get("link"), []).append(
            joint.find("child").get("link")
        )
    links = {root}
    fresh = [root]
    while fresh:
        fresh = [child for parent in fresh for child in below.get(parent, ()) if child not in links]
        links.update(fresh)
    return links


def find_sensor_links(robot: etree._Element, kind: str) -> list[str]:
    """Return the links on which Gazebo's tags (``<gazebo reference="LINK"><sensor type="KIND">``) put a sensor."""
    found = [
        tag.get("reference", "")
        for tag in robot.findall("gazebo")
        if tag.xpath("sensor[@type=$k]", k=kind)
    ]
    return [link for link in list_element_names(robot, "link") if link in found]


def strip_to_skeleton(robot: etree._Element, *more: str) -> str:
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


def load_checked(text: str, place: str) -> yourdfpy.Robot:
    """Return the URDF as yourdfpy's dataclasses, visuals included, after checking tree, joints and numbers.

    Raises:
        RigError: The first thing that keeps the URDF from being a rig, or its visuals from being drawn.
    """
    import yourdfpy

    check_joints(parse_checked(text, place), place)
    try:
        return yourdfpy.URDF.load(
            io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False
        ).robot
    except (ValueError, TypeError, AttributeError, LookupError) as error:
        raise RigError(
            place, f"is not a URDF that yourdfpy reads ({error})", "mend the attribute it names"
        ) from error


def read_inertials(text: str) -> dict[str, LinkInertia]:
    """Return link → mass, centre of mass and inertia about it, where it has mass."""
    out = {}
    for link in parse_robot(text, "URDF").findall("link"):
        if (inertial := link.find("inertial")) is not None:
            at = read_pose(inertial)
            inertia = at.rotation @ read_inertia(inertial.find("inertia")) @ at.rotation.T
            out[link.get("name")] = (
                float(inertial.find("mass").get("value")),
                np.array(at.translation),
                inertia,
            )
    return out


def replace_inertials(text: str, inertials: Mapping[str, LinkInertia]) -> str:
    """Return the URDF with the named links' ``<inertial>`` values replaced and every other tag kept."""
    robot = parse_robot(text, "URDF")
    for link in robot.findall("link"):
        if link.get("name") in inertials:
            write_inertial(link, *inertials[link.get("name")])
    return to_text(robot)


def replace_friction(text: str, friction: Mapping[str, tuple[float, float]]) -> str:
    """Return the URDF with the named joints' ``<dynamics>`` friction N m and damping N m s/rad replaced.

    A URDF holds no negative friction: a value that noise made negative is written as zero.
    """
    robot = parse_robot(text, "URDF")
    for joint in robot.findall("joint"):
        if joint.get("name") in friction:
            for name, value in zip(("friction", "damping"), friction[joint.get("name")]):
                _get_child(joint, "dynamics").set(name, f"{max(value, 0.0):.17g}")
    return to_text(robot)


def write_inertial(link: etree._Element, mass: float, com: np.ndarray, inertia: np.ndarray) -> None:
    """Set one link's ``<inertial>``, turned to the link's axes (rpy = 0)."""
    origin, heavy, inert = (
        _get_child(_get_child(link, "inertial"), tag) for tag in ("origin", "mass", "inertia")
    )
    origin.set("xyz", format_numbers(com))
    origin.set("rpy", "0 0 0")
    heavy.set("value", f"{mass:.17g}")
    for name, row, column in INERTIA_ENTRIES:
        inert.set(name, f"{inertia[row, column]:.17g}")


def _get_child(parent: etree._Element, tag: str) -> etree._Element:
    """Return the element's first child of a tag, made where there is none."""
    found = parent.find(tag)
    return etree.SubElement(parent, tag) if found is None else found


def format_numbers(values: Sequence[float] | np.ndarray) -> str:
    """Return numbers as an attribute holds them."""
    return " ".join(f"{x:.17g}" for x in values)


def read_numbers(element: etree._Element | None, attribute: str, default: str) -> np.ndarray:
    """Return the numbers of an attribute, or those of `default` where it is not stated."""
    return np.array(
        (default if element is None else element.get(attribute, default)).split(), dtype=float
    )


def read_pose(element: etree._Element) -> pin.SE3:
    """Return the pose that an element's ``<origin>`` states."""
    origin = element.find("origin")
    return pin.SE3(
        pin.rpy.rpyToMatrix(*read_numbers(origin, "rpy", "0 0 0")),
        read_numbers(origin, "xyz", "0 0 0"),
    )


def set_pose(element: etree._Element, at: pin.SE3) -> None:
    """Set the pose of an element."""
    origin = _get_child(element, "origin")
    origin.set("xyz", format_numbers(at.translation))
    origin.set("rpy", format_numbers(pin.rpy.matrixToRpy(at.rotation)))


def add_joint(
    out: etree._Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    at: pin.SE3 | None = None,
    axis: np.ndarray | None = None,
) -> etree._Element:
    """Add a joint at a pose in its parent; its axis is in the child's axes."""
    joint = etree.SubElement(out, "joint", name=name, type=kind)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    if at is not None:
        set_pose(joint, at)
    if axis is not None:
        etree.SubElement(joint, "axis", xyz=format_numbers(axis))
    return joint


def add_sensor(out: etree._Element, name: str, kind: str, link: str, at: pin.SE3) -> None:
    """Add a link without mass where a sensor sits, its x forward, and the tag that says so, as Gazebo writes it."""
    taken = {*list_element_names(out, "link"), *list_element_names(out, "joint")}
    free = next(
        word for word in (name, f"{link}_{name}", f"{link}_{name}_{kind}") if word not in taken
    )
    etree.SubElement(out, "link", name=free)
    add_joint(out, f"{free}_on_{link}", "fixed", link, free, at)
    etree.SubElement(
        etree.SubElement(out, "gazebo", reference=free), "sensor", name=name, type=kind
    )


def add_visual(link: etree._Element, at: pin.SE3, shape: str, **sizes: str) -> etree._Element:
    """Add a shape to what is seen of a link."""
    visual = etree.SubElement(link, "visual")
    set_pose(visual, at)
    etree.SubElement(etree.SubElement(visual, "geometry"), shape, sizes)
    return visual
