"""URDFs that are XML, and wrong."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import deepcopy
from itertools import pairwise

import numpy as np

from fuzzing.junk import ABSURD, number, one, text

TOKEN = "RAWXML"
"""Stands in the tree for what no tree may hold; it is put into the text."""

RAW = (
    "&bomb;",
    "&file;",
    "&param;",
    "&#27;[31m",
    "&#0;",
    "&nothing;",
    "&lt;",
    "<",
    "\x1b[31m",
    "]]>",
    "&#x1F600;",
    "&#10;",
)
ENTITIES = ["a", "b", "c", "d", "e", "f", "bomb"]
DTD = (
    '<!DOCTYPE robot [<!ENTITY file SYSTEM "file:///etc/hostname"><!ENTITY nothing "2"><!ENTITY a "lol">'
    + "".join(f'<!ENTITY {name} "{f"&{of};" * 8}">' for of, name in pairwise(ENTITIES))
    + "]>"
)
"""Eight times eight times … eight: 262 144 from half a kilobyte."""

VECTORS = (
    "0 0 0",
    "0 0",
    "0 0 0 0",
    "nan nan nan",
    "1e300 0 0",
    "inf 0 0",
    "a b c",
    "",
    "1,2,3",
    "1e-320 0 0",
    "5e-324 0 0",
)
TAGS = (
    "link",
    "joint",
    "inertial",
    "mass",
    "origin",
    "axis",
    "limit",
    "mimic",
    "transmission",
    "gazebo",
    "dynamics",
    "safety_controller",
)
TYPES = ("prismatic", "floating", "planar", "continuous", "revolute", "fixed", "spherical", "", "REVOLUTE", "\x1b[31m")


def elements(root: ET.Element) -> list[ET.Element]:
    """Return every element."""
    return list(root.iter())


def attributes(rng: np.random.Generator, root: ET.Element) -> None:
    """An attribute is removed, renamed, added or holds something else."""
    able = [element for element in elements(root) if element.attrib]
    element = one(rng, able or [root])
    if not element.attrib:
        return
    name, kind = one(rng, list(element.attrib)), rng.random()
    if kind < 0.15:
        del element.attrib[name]
    elif kind < 0.25:
        element.attrib[text(rng) if rng.random() < 0.1 else "other"] = element.attrib.pop(name)
    elif kind < 0.3:
        element.attrib[one(rng, ("name", "value", "xyz", "type", "link", "xml:base"))] = number(rng)
    elif kind < 0.4:
        element.attrib[name] = TOKEN
    elif name in ("name", "link", "filename", "joint"):
        element.attrib[name] = text(rng)
    elif name == "type":
        element.attrib[name] = one(rng, TYPES)
    elif " " in element.attrib[name]:
        parts = element.attrib[name].split(" ")
        parts[int(rng.integers(len(parts)))] = number(rng)
        element.attrib[name] = " ".join(parts) if rng.random() < 0.6 else one(rng, VECTORS)
    else:
        element.attrib[name] = number(rng)


def masses(rng: np.random.Generator, root: ET.Element) -> None:
    """A number of a mass, an inertia, a place or a limit is absurd."""
    able = [
        element
        for element in elements(root)
        if element.tag in ("mass", "inertia", "origin", "axis", "limit", "dynamics")
    ]
    for _ in range(int(rng.integers(1, 4)) if able else 0):
        element = one(rng, able)
        name = one(rng, list(element.attrib) or ["value"])
        element.attrib[name] = " ".join(one(rng, ABSURD) for _ in element.attrib.get(name, "1").split())


def removed(rng: np.random.Generator, root: ET.Element) -> None:
    """An element is gone, stands twice, stands elsewhere, or has another name."""
    parent = one(rng, [element for element in elements(root) if len(element)] or [root])
    if not len(parent):
        return
    child, kind = one(rng, list(parent)), rng.random()
    if kind < 0.35:
        parent.remove(child)
    elif kind < 0.6:
        parent.append(deepcopy(child))
    elif kind < 0.8:
        parent.remove(child)
        one(rng, elements(root)).append(child)
    else:
        child.tag = one(rng, TAGS)


def chained(rng: np.random.Generator, root: ET.Element) -> None:
    """Many links and joints behind one another, or in a circle, or side by side."""
    links = [element.attrib.get("name", "") for element in root.findall("link")] or ["base"]
    count, parent = int(rng.choice([1, 3, 30, 200, 2000])), one(rng, links)
    kind, side = one(rng, ("revolute", "fixed", "continuous", "prismatic", "floating")), rng.random() < 0.3
    for k in range(count):
        name = f"more{k}"
        link = ET.SubElement(root, "link", name=name)
        if rng.random() < 0.5:
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "mass", value="1")
            ET.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
        joint = ET.SubElement(root, "joint", name=f"j{name}", type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=name)
        ET.SubElement(joint, "axis", xyz="0 0 1")
        ET.SubElement(joint, "limit", lower="-1", upper="1", velocity="1", effort="1")
        parent = parent if side else name
    if rng.random() < 0.1:
        joint = ET.SubElement(root, "joint", name="circle", type="fixed")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=links[0])


def nested(rng: np.random.Generator, root: ET.Element) -> None:
    """Elements in elements in elements."""
    place = one(rng, elements(root))
    for _ in range(int(rng.choice([10, 200, 300]))):
        place = ET.SubElement(place, one(rng, ("a", "link", "visual")))


def drawn(rng: np.random.Generator, root: ET.Element) -> None:
    """Solids of no size, or of none that there are, and meshes that are not there."""
    link = one(rng, root.findall("link") or [root])
    solid = one(rng, ("box", "sphere", "cylinder", "mesh", "capsule", "torus"))
    names = (
        "no.stl",
        "../../etc/hostname",
        "package://no/mesh.stl",
        "/dev/zero",
        "/dev/stdin",
        "pan.urdf",
        "x" * 5000,
        "",
        "http://x/y.stl",
        ".",
        "a.\x1b[31m",
    )
    place = ET.SubElement(ET.SubElement(link, one(rng, ("visual", "collision"))), "geometry")
    given = {"size": " ".join(number(rng) for _ in range(3)), "radius": number(rng), "length": number(rng)}
    ET.SubElement(place, solid, {**given, "filename": one(rng, names), "scale": one(rng, VECTORS)})


MUTATIONS = (attributes, attributes, masses, removed, removed, chained, nested, drawn)


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """Return a URDF with one to three things wrong."""
    root = ET.fromstring(data)
    for _ in range(int(rng.integers(1, 4))):
        one(rng, MUTATIONS)(rng, root)
    for element in elements(root):  # what the writer cannot write
        element.attrib = {key.translate(NO_KEY) or "x": value for key, value in element.attrib.items()}
    written = ET.tostring(root, encoding="unicode", short_empty_elements=True)
    raw = one(rng, RAW)
    written = written.replace(TOKEN, raw)
    if rng.random() < 0.1 or (raw.startswith("&") and TOKEN not in written and rng.random() < 0.5 and raw in written):
        written = DTD + written
    if rng.random() < 0.05:
        written = (
            f'<?xml version="1.0" encoding="{one(rng, ("latin-1", "utf-16", "no", "ascii", "utf-7"))}"?>' + written
        )
    return written.encode("utf-8", errors="surrogatepass")


NO_KEY = {ord(mark): "_" for mark in " \t\n\r\"'<>&=,;/\x1b\x07\x9b"}
