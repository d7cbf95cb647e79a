"""SDF, Gazebo's format: what a rig needs of one model (sdformat.org, versions 1.4 to 1.11).

SDF places links in the model and joints in links; a URDF has one frame for both. So a link's frame moves to its joint,
without turning: what is measured in the link's axes stays as it is. Cameras and IMUs become links where they sit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isfinite, pi

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.reading import LONGEST_NUMBER, parse_decimal
from gimbal_pin.rig.records import LARGEST_NUMBER
from gimbal_pin.rig.urdf_checks import INERTIA_ENTRIES, MOST_LINKS, find_repeated

_JOINT_TYPES = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
_CAMERA_SENSORS = (
    "camera",
    "depth",
    "depth_camera",
    "rgbd_camera",
    "thermal",
    "thermal_camera",
    "wideanglecamera",
)
_MODEL, _WORLD = "__model__", "world"
_JOINT_AXES_VERSION = (1, 5)
"""Version from which on an axis is stated in its joint's axes, not in the model's."""


def convert_sdf(root: etree._Element, place: str) -> tuple[str, list[str]]:
    """Return the model of an SDF as a URDF, and a sentence on what that does not hold.

    Raises:
        RigError: There is not one model, or it has something that a URDF cannot hold.
    """
    models = root.xpath("model | world/model")
    if len(models) != 1:
        raise RigError(
            place, f"is an SDF of {len(models)} models", "give a file with the rig's alone"
        )
    (model,) = models
    for tag in ("include", "model"):
        if (nested := model.find(tag)) is not None:
            mend = "put the links and joints of the nested model into this one: 'gz sdf -p' flattens a file"
            raise RigError(f"{place}:{nested.sourceline}", f"nests another model (<{tag}>)", mend)
    if len(model.findall("*")) + len(model.findall("link/sensor")) > 3 * MOST_LINKS:
        what = f"has over {3 * MOST_LINKS} links, joints, frames and sensors"
        raise RigError(place, what, f"give at most {MOST_LINKS} links")
    version = tuple(map(int, re.findall("[0-9]{1,4}", root.get("version", ""))[:2]))
    return _Converter(model, bool(version) and version < _JOINT_AXES_VERSION, place).converted()


class _Converter:
    """One model on its way to a URDF."""

    def __init__(self, model: etree._Element, old: bool, place: str) -> None:
        """Look up what has a name; `RigError` where two things share one. `old`: axes are in the model's."""
        self.model, self.old, self.place = model, old, place
        named = [e for e in model if e.tag in ("link", "joint", "frame")]
        if twice := find_repeated(e.get("name", "") for e in named):
            raise RigError(
                place, f"two links, joints or frames are named '{twice[0]}'", "rename one"
            )
        self.named = {e.get("name", ""): e for e in named}
        self.poses: dict[str, pin.SE3 | None] = {
            _MODEL: pin.SE3.Identity(),
            _WORLD: pin.SE3.Identity(),
        }
        self.notes: list[str] = []

    def converted(self) -> tuple[str, list[str]]:
        """Return the URDF's text and what was left out."""
        joints = self.model.findall("joint")
        links = self.model.findall("link")
        moved = {
            self.text(joint, "child"): joint for joint in joints if self.kind(joint) != "fixed"
        }
        frames: dict[str, pin.SE3] = {_WORLD: pin.SE3.Identity()}
        for link in links:
            name = link.get("name", "")
            pose = self.pose_of(link.get("name", ""), link)
            own = moved.get(name)
            at = pose if own is None else self.pose_of(own.get("name", ""), own)
            frames[name] = pin.SE3(pose.rotation, at.translation)
        out = etree.Element("robot", name=self.model.get("name", "model"))
        for link in links:
            self.add_link(out, link, frames[link.get("name", "")])
        for joint in joints:
            self.add_joint(out, joint, frames)
        for link in links:
            name = link.get("name", "")
            for sensor in link.findall("sensor"):
                kind = sensor.get("type", "")
                kind = "camera" if kind in _CAMERA_SENSORS else kind
                if kind in ("camera", "imu"):
                    origin = frames[name].actInv(self.pose_of(name, link) * self.stated(sensor))
                    urdf.add_sensor(out, sensor.get("name", kind), kind, name, origin)
        return str(etree.tostring(out, encoding="unicode")), self.notes

    def kind(self, joint: etree._Element) -> str:
        """Return the type of a joint."""
        if joint.get("type") not in _JOINT_TYPES:
            what = f"joint '{joint.get('name')}' is of type {joint.get('type')}"
            raise RigError(self.at(joint), what, f"use one of {', '.join(_JOINT_TYPES)}")
        return _JOINT_TYPES[joint.get("type")]

    def add_link(self, out: etree._Element, link: etree._Element, frame: pin.SE3) -> None:
        """Add a link: its inertia and what is seen of it."""
        name = link.get("name", "")
        shift = frame.actInv(self.pose_of(name, link))
        new = etree.SubElement(out, "link", name=name)
        inertial = link.find("inertial")
        if inertial is None:
            # The specification's defaults, with which Gazebo moves it.
            self.notes.append(
                f"{name} has no <inertial>: SDF takes 1 kg and 1 kg m² for it, and so it is here"
            )
            inertial = etree.SubElement(link, "inertial")
        if inertial.get("auto", "false").strip().lower() in ("true", "1"):
            mend = "state its mass and inertia: 'gz sdf --print --inertial-stats' shows them"
            raise RigError(
                self.at(inertial), f"link '{name}' leaves its inertia to Gazebo (auto)", mend
            )
        origin = shift * self.stated(inertial)
        inertia = np.zeros((3, 3))
        for entry, row, column in INERTIA_ENTRIES:
            value = self.number(inertial, f"inertia/{entry}", float(row == column))
            inertia[row, column] = inertia[column, row] = value
        turned = origin.rotation @ inertia @ origin.rotation.T
        urdf.write_inertial(new, self.number(inertial, "mass", 1.0), origin.translation, turned)
        for visual in link.findall("visual"):
            self.add_visual(new, visual, shift * self.stated(visual))

    def add_visual(self, link: etree._Element, visual: etree._Element, pose: pin.SE3) -> None:
        """Add a shape, in its colour."""
        for shape in visual.findall("geometry/*"):
            sizes = {size.tag: (size.text or "").strip() for size in shape}
            if shape.tag == "mesh" and sizes.get("uri"):
                file = re.sub("^model://", "package://", sizes["uri"])
                scale = {"scale": sizes["scale"]} if "scale" in sizes else {}
                new = urdf.add_visual(link, pose, "mesh", filename=file, **scale)
            elif shape.tag in ("box", "sphere", "cylinder", "capsule"):
                kept = {key: sizes[key] for key in ("size", "radius", "length") if key in sizes}
                new = urdf.add_visual(
                    link, pose, "cylinder" if shape.tag == "capsule" else shape.tag, **kept
                )
            else:
                continue
            colour = visual.findtext("material/diffuse") or visual.findtext("material/ambient")
            if colour is not None and len(words := colour.split()) in (3, 4):
                material = etree.SubElement(new, "material", name="")
                etree.SubElement(material, "color", rgba=" ".join([*words, "1"][:4]))

    def add_joint(
        self, out: etree._Element, joint: etree._Element, frames: Mapping[str, pin.SE3]
    ) -> None:
        """Add a joint."""
        kind = self.kind(joint)
        name = joint.get("name", "")
        parent = self.text(joint, "parent")
        child = self.text(joint, "child")
        for role, link in (("parent", parent), ("child", child)):
            if link not in frames:
                what = f"joint '{name}' has '{link}' as {role}, which is no link of the model"
                raise RigError(self.at(joint), what, "name a link that exists")
        origin = frames[parent].actInv(frames[child])
        if kind == "fixed":
            urdf.add_joint(out, name, kind, parent, child, origin)
            return
        axis = joint.find("axis")
        limit = {}
        way = np.array([0.0, 0.0, 1.0]) if axis is None else self.axis(joint, axis)
        for key in ("lower", "upper", "effort", "velocity"):
            value = self.number(joint, f"axis/limit/{key}", np.inf)
            unknown = {"lower": -LARGEST_NUMBER, "upper": LARGEST_NUMBER}.get(key, 0.0)
            stated = value if key in ("lower", "upper") else max(value, 0.0)  # -1: none
            limit[key] = stated if isfinite(value) and abs(value) < LARGEST_NUMBER else unknown
        unbounded = limit["lower"] == -LARGEST_NUMBER and limit["upper"] == LARGEST_NUMBER
        kind = "continuous" if kind == "revolute" and unbounded else kind
        new = urdf.add_joint(out, name, kind, parent, child, origin, frames[child].rotation.T @ way)
        etree.SubElement(new, "limit", {key: f"{value:.17g}" for key, value in limit.items()})
        friction = {
            key: self.number(joint, f"axis/dynamics/{key}", 0.0) for key in ("damping", "friction")
        }
        etree.SubElement(new, "dynamics", {key: f"{value:.17g}" for key, value in friction.items()})
        if self.number(joint, "axis/dynamics/spring_stiffness", 0.0):
            self.notes.append(
                f"{name} has a spring, which is left out: it is a cable-spring to plant or to find"
            )

    def axis(self, joint: etree._Element, axis: etree._Element) -> np.ndarray:
        """Return the direction of a joint's axis in the model's axes."""
        xyz = axis.find("xyz")
        way = np.array([0.0, 0.0, 1.0]) if xyz is None else self.numbers(xyz, 3)
        inside = "" if xyz is None else xyz.get("expressed_in", "")
        old = axis.findtext("use_parent_model_frame", "1" if self.old else "0").strip().lower()
        if old in ("1", "true"):
            return way
        frame = self.pose(inside, joint) if inside else self.pose_of(joint.get("name", ""), joint)
        return np.asarray(frame.rotation @ way)

    def pose(self, name: str, asking: etree._Element) -> pin.SE3:
        """Return the pose in the model of what has a name, when every joint is at zero."""
        if name not in self.named and name not in self.poses:
            raise RigError(
                self.at(asking),
                f"is placed by '{name[:40]}', which is not there",
                "name a link or frame",
            )
        return self.pose_of(name, self.named.get(name, asking))

    def pose_of(self, name: str, element: etree._Element) -> pin.SE3:
        """Return the pose in the model of a link, joint or frame of that name."""
        if name in self.poses:
            known = self.poses[name]
            if known is None:
                raise RigError(
                    self.at(element),
                    f"'{name[:40]}' is placed by itself",
                    "cut the circle of relative_to",
                )
            return known
        self.poses[name] = None
        pose = element.find("pose")
        usual = {
            "joint": element.findtext("child", "").strip(),
            "frame": element.get("attached_to", ""),
        }
        by = (
            ("" if pose is None else pose.get("relative_to", ""))
            or usual.get(element.tag, "")
            or _MODEL
        )
        try:
            found = self.pose(by, element) * self.stated(element)
        except RecursionError as error:
            raise RigError(
                self.at(element), "is placed by too long a chain of frames", "place it in the model"
            ) from error
        self.poses[name] = found
        return found

    def stated(self, element: etree._Element) -> pin.SE3:
        """Return the pose that an element states, in whatever places it."""
        pose = element.find("pose")
        if pose is None or not (pose.text or "").strip():
            return pin.SE3.Identity()
        if pose.get("rotation_format") == "quat_xyzw":
            x, y, z, *q = self.numbers(pose, 7)
            if not np.linalg.norm(q) > 0.5:
                raise RigError(
                    self.at(pose),
                    "<pose> has a quaternion that is none",
                    "give x y z w of length 1",
                )
            return pin.SE3(
                pin.Quaternion(np.array(q) / np.linalg.norm(q)).matrix(), np.array([x, y, z])
            )
        values = self.numbers(pose, 6)
        unit = pi / 180 if pose.get("degrees", "false").strip().lower() in ("true", "1") else 1.0
        return pin.SE3(pin.rpy.rpyToMatrix(*(unit * values[3:])), values[:3])

    def numbers(self, element: etree._Element, count: int) -> np.ndarray:
        """Return the numbers in an element; ``inf`` is one."""
        words = (element.text or "").split()
        values = [
            float(word) if re.fullmatch("[+-]?inf", word) else parse_decimal(word)
            for word in words[: count + 1]
        ]
        if len(values) != count or None in values:
            short = " ".join(words)[:LONGEST_NUMBER]
            raise RigError(
                self.at(element), f"<{element.tag}> holds '{short}'", f"write {count} numbers"
            )
        return np.array(values, dtype=float)

    def number(self, element: etree._Element, path: str, default: float) -> float:
        """Return the number at a path below an element, or the default."""
        found = element.find(path)
        return default if found is None else float(self.numbers(found, 1)[0])

    def text(self, joint: etree._Element, tag: str) -> str:
        """Return the name of a joint's parent or child."""
        return str(joint.findtext(tag, "")).strip()

    def at(self, element: etree._Element) -> str:
        """Return the place of an element."""
        return f"{self.place}:{element.sourceline}"
