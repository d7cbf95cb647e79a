"""Checks of a URDF: names, references, numbers, joints and inertias."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from lxml import etree

from gimbal_pin.errors import RigError
from gimbal_pin.rig.reading import LONGEST_NUMBER, parse_decimal

MOVABLE = ("revolute", "continuous", "prismatic")
_SHAPES = ("box", "cylinder", "sphere", "mesh")
INERTIA_ENTRIES = (
    ("ixx", 0, 0),
    ("ixy", 0, 1),
    ("ixz", 0, 2),
    ("iyy", 1, 1),
    ("iyz", 1, 2),
    ("izz", 2, 2),
)
"""Attribute, row and column of the entries of a URDF's inertia."""
_MOST_JOINTS = 32
"""Most movable joints: `reduction.compute_kronecker_sequence` has three sequences for each of 33; `check` takes 4 s."""
MOST_LINKS = 1000
"""Most links, fixed ones included: a chain of them loads in 2 s, one of 5000 overflows the stack inside Pinocchio."""
MAX_NAME_CHARACTERS = 64
"""Most characters of a name: twice as many would leave no room for two names in an error of one line."""
_LIGHTEST, _HEAVIEST = 1e-9, 1e7
"""Masses, kg: a microgram, for links that only mark a place, and 10 000 t, beyond any machine on joints."""
_NARROWEST, _WIDEST = 1e-9, 1e3
"""Radii of gyration, m: a nanometre, which is a few atoms, and a kilometre."""
_NUMBERS: Mapping[str, Mapping[str, tuple[int, float]]] = {
    "origin": {"xyz": (3, _WIDEST), "rpy": (3, 1e3)},
    "axis": {"xyz": (3, 1e6)},
    "limit": dict.fromkeys(
        ("lower", "upper", "effort", "velocity"), (1, 1e16)
    ),  # what SDF writes for no limit
    "dynamics": {"damping": (1, 1e6), "friction": (1, 1e6)},
    "mimic": {"multiplier": (1, 1e6), "offset": (1, 1e3)},
    "mass": {"value": (1, _HEAVIEST)},
    "inertia": dict.fromkeys((name for name, _, _ in INERTIA_ENTRIES), (1, _HEAVIEST * _WIDEST**2)),
    "box": {"size": (3, _WIDEST)},
    "cylinder": {"radius": (1, _WIDEST), "length": (1, _WIDEST)},
    "sphere": {"radius": (1, _WIDEST)},
    "mesh": {"scale": (3, 1e6)},
    "color": {"rgba": (4, 255.0)},
}
"""Tag → its attributes that hold numbers: how many, and the largest, in SI units."""
_REQUIRED: Mapping[str, Sequence[str]] = {
    "axis": ["xyz"],
    "limit": ["effort", "velocity"],
    "mesh": ["filename"],
    "mimic": ["joint"],
    **{
        tag: list(_NUMBERS[tag])
        for tag in ("mass", "inertia", "box", "cylinder", "sphere", "color")
    },
}
"""Required attributes: readers differ in their defaults for a missing one, and some drop the whole tag."""


def list_element_names(robot: etree._Element, tag: str) -> list[str]:
    """Return the names of the robot's links, joints or materials, in the file's order."""
    return [element.get("name", "") for element in robot.findall(tag)]


def check_names(robot: etree._Element, place: str, fixed: Collection[str] = ()) -> None:
    """Raise `RigError` if links or joints are too many, two of them share a name, or `check_name` refuses one.

    `fixed`: joints that the YAML fixes; those that mimic others are fixed, too.
    """
    links = robot.findall("link")
    joints = robot.findall("joint")
    for element in (robot, *links, *joints):
        name = element.get("name", "")
        where = f"{place}:{element.sourceline}"
        if not name:
            raise RigError(where, f"<{element.tag}> has no name", "give it one")
        check_name(name, f"<{element.tag}>", where)
    for tag, elements in (("link", links), ("joint", joints)):
        if twice := find_repeated(element.get("name") for element in elements):
            raise RigError(place, f"two {tag}s are named '{twice[0]}'", "rename one")
    free = [
        joint for joint in joints if joint.find("mimic") is None and joint.get("name") not in fixed
    ]
    movable = {joint.get("name") for joint in free if joint.get("type") in MOVABLE}
    if len(links) > MOST_LINKS or len(movable) > _MOST_JOINTS:
        what = f"has {len(links)} links and {len(movable)} movable joints"
        mend = f"give at most {MOST_LINKS} and {_MOST_JOINTS}: name in the YAML ('fixed:') what the log does not hold"
        raise RigError(place, what, mend)
    if both := sorted(joint for joint in movable if f"ref_{joint}" in movable):
        what = f"q_ref_{both[0]} would be the angle of joint 'ref_{both[0]}' and the reference of '{both[0]}'"
        raise RigError(place, what, "rename one")


def check_name(name: str, kind: str, place: str) -> None:
    """Raise `RigError` unless a name has 1 to `MAX_NAME_CHARACTERS` printable characters and no space at either end.

    This is the only restriction: whatever writes a name escapes it for its language.
    """
    if not (name.isprintable() and name == name.strip() and 0 < len(name) <= MAX_NAME_CHARACTERS):
        mend = f"use 1 to {MAX_NAME_CHARACTERS} printable characters without a space at either end"
        raise RigError(place, f"{kind} has the name {name[:20]!r} of {len(name)} characters", mend)


def find_repeated(names: Iterable[str]) -> list[str]:
    """Return the names that are there more than once, in order."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


def check_references(robot: etree._Element, place: str) -> None:
    """Raise `RigError` if a joint's parent or child is missing or no link."""
    links = set(list_element_names(robot, "link"))
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
    """Raise `RigError` where a shape or an attribute is missing, or is not as many numbers of a size as it should be.

    See `_REQUIRED` and `_NUMBERS`. Numbers are rewritten with single blanks between them, as urdfdom wants them.
    """
    for solid in robot.xpath("link/visual | link/collision"):
        shape = solid.find("geometry/*")
        if shape is None or shape.tag not in _SHAPES:
            where = f"{place}:{solid.sourceline}"
            raise RigError(
                where, f"<{solid.tag}> has no shape", f"give its <geometry> a {', '.join(_SHAPES)}"
            )
    solids = "link/visual/origin | link/collision/origin | link/visual/geometry/* | link/collision/geometry/*"
    for element in robot.xpath(
        f"joint/* | link/inertial/* | {solids} | link/visual/material/color | material/color"
    ):
        where = f"{place}:{element.sourceline}"
        for attribute in _REQUIRED.get(element.tag, ()):
            if element.get(attribute) is None:
                raise RigError(where, f"<{element.tag}> has no {attribute}", "give it")
        for attribute, (count, largest) in _NUMBERS.get(element.tag, {}).items():
            text = element.get(attribute)
            if text is None:
                continue
            words = re.split("[ \t\r\n]+", text.strip(" \t\r\n"))
            element.set(attribute, " ".join(words))
            if not _are_numbers(words, count, largest):
                what = "a finite number" if count == 1 else f"{count} finite numbers"
                short = text if len(text) <= LONGEST_NUMBER else f"{text[:LONGEST_NUMBER]}…"
                mend = f"write {what} up to {largest:g}, in digits"
                raise RigError(where, f"<{element.tag}> has {attribute}='{short}'", mend)


def _are_numbers(words: Sequence[str], count: int, largest: float) -> bool:
    """Whether words are `count` decimal numbers of at most a size."""
    values = [parse_decimal(word) for word in words]
    return len(values) == count and all(x is not None and abs(x) <= largest for x in values)


def check_joints(robot: etree._Element, place: str) -> None:
    """Raise `RigError` unless a joint moves, each with a usable axis, ordered limits and real friction."""
    joints = robot.findall("joint")
    for joint in joints:
        where = f"{place}: joint '{joint.get('name')}'"
        kind = joint.get("type")
        if kind == "fixed":
            continue
        if kind not in MOVABLE:
            raise RigError(
                where, f"is of type {kind}", f"use one of {', '.join(MOVABLE)}, or fixed"
            )
        axis, limit, dynamics = (joint.find(tag) for tag in ("axis", "limit", "dynamics"))
        # An exporter's rounding has no direction.
        if (
            axis is not None
            and not np.linalg.norm([float(x) for x in axis.get("xyz").split()]) > 1e-6
        ):
            raise RigError(
                where, "has an axis of zero length", "give a direction, e.g. xyz='0 0 1'"
            )
        if kind != "continuous" and limit is None:
            raise RigError(
                where,
                "has no <limit>",
                "give lower, upper, effort and velocity, or make it continuous",
            )
        if limit is not None:
            lower, upper, effort, velocity = (
                float(limit.get(key, "0")) for key in ("lower", "upper", "effort", "velocity")
            )
            if kind != "continuous" and lower > upper:
                raise RigError(where, f"has lower limit {lower} above upper {upper}", "swap them")
            if min(effort, velocity) < 0:
                raise RigError(where, "has a negative limit of effort or velocity", "give its size")
        if (
            dynamics is not None
            and min(float(dynamics.get(key, "0")) for key in ("damping", "friction")) < 0
        ):
            raise RigError(where, "has negative friction or damping", "give its size, or 0")
    if not any(joint.get("type") in MOVABLE and joint.find("mimic") is None for joint in joints):
        raise RigError(
            place,
            "has no movable joint",
            "give at least one revolute, continuous or prismatic joint",
        )


def is_weightless(inertial: etree._Element, is_fixed: bool) -> bool:
    """Return true if an ``<inertial>`` states no body: its mass and inertia are under `_LIGHTEST`.

    Exporters write such a mass for frames, often with a token inertia. The inertia of a link that is fixed to another
    (`is_fixed`) is therefore not looked at.
    """
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    if mass is None or not 0 <= float(mass.get("value")) < _LIGHTEST:
        return mass is None and inertia is None
    return is_fixed or inertia is None or bool(np.abs(read_inertia(inertia)).max() < _LIGHTEST)


def check_inertial(link: etree._Element, place: str) -> None:
    """Raise `RigError` unless a mass and an inertia are stated, of sizes that can be (`describe_broken_rule`, too)."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"{place}:{inertial.sourceline}: link '{link.get('name')}'"
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    if mass is None or not float(mass.get("value")) > 0:
        stated = "no mass" if mass is None else f"mass {mass.get('value')}"
        raise RigError(
            where, f"has {stated}", "give a positive mass in kg, or leave <inertial> out"
        )
    if inertia is None:
        raise RigError(where, "has a mass but no inertia", "give <inertia> in kg m²")
    if not _LIGHTEST <= float(mass.get("value")) <= _HEAVIEST:
        mend = f"give {_LIGHTEST:g} to {_HEAVIEST:g} kg, or leave <inertial> out"
        raise RigError(where, f"has mass {mass.get('value')}", mend)
    small, _, large = np.linalg.eigvalsh(read_inertia(inertia))
    radii = np.sqrt(np.array([max(small, 0.0), max(large, 0.0)]) / float(mass.get("value")))
    if (0 < radii[0] < _NARROWEST) or radii[1] > _WIDEST:
        what = f"has radii of gyration of {radii[0]:.2g} to {radii[1]:.2g} m"
        raise RigError(where, what, "no body of its mass has such an inertia: give it in kg m²")


def read_inertia(inertia: etree._Element) -> np.ndarray:
    """Return the matrix of an ``<inertia>``, kg m², (3, 3)."""
    out = np.zeros((3, 3))
    for name, row, column in INERTIA_ENTRIES:
        out[row, column] = out[column, row] = float(inertia.get(name))
    return out
