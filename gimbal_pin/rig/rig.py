"""A gimbal as data: URDF, Pinocchio model, motors, limits, payload, and where the camera is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import RigError
from gimbal_pin.rig import urdf
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.config import Config, Limits, Motor, overlay_config
from gimbal_pin.rig.files import YAML_SUFFIXES, find_payload, find_rig
from gimbal_pin.rig.formats import convert_to_urdf
from gimbal_pin.rig.inertia import join_names, mend_inertias, remove_unfelt_inertials
from gimbal_pin.rig.plausibility import find_implausible_values
from gimbal_pin.rig.reading import parse_decimal
from gimbal_pin.rig.records import LARGEST_NUMBER
from gimbal_pin.rig.types import Array
from gimbal_pin.rig.urdf_checks import MOVABLE, check_name

GRAVITY = 9.81
"""Acceleration of gravity, m/s², down the world's z."""
_SLIDING_UNITS = {
    r"\(N m\)": "N",
    r"N m\b": "N",
    r"kg m(\^2|²)": "kg",
    r"\brad\b": "m",
    r"per turn\b": "per 2π m",
}
"""What stands in units of joints that turn → what stands there of joints that slide."""

PHI = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""A body's ten inertial parameters in Pinocchio's order: mass, first moments, inertia about the joint's origin."""


@dataclass(frozen=True, eq=False)
class Rig(Record):
    """A tree of bodies on a base, with one actuated angle per joint.

    Attributes:
        name: Bundled name or file stem.
        urdf: URDF text, payload included, joint types as written.
        model: Pinocchio model on a fixed base; `continuous` joints are revolute in it: nq = nv = number of joints. Its
            ``armature`` holds the rotors' inertia that `motors` state, so every torque and mass matrix includes it.
        joints: Joint names in the model's order (n).
        links: The link that each joint moves (n); links fixed to it are lumped into it.
        motors: One per joint.
        limits: One per joint.
        friction: Coulomb and viscous coefficients from ``<dynamics>``, N m and N m s/rad, shape (n, 2).
        base: Root link.
        camera_frame: Link whose +x axis is the line of sight.
        payload: Name of the mounted payload, or None.
        payload_link: Root link of the mounted payload, or None.
        config: The YAML it came with.
        path: URDF file, for meshes named relative to it.
        notes: Sentences on flaws of the URDF that do not matter.
        rotors_apart: Joints whose rotor is a term of a model, in place of the one that `motors` state.
    """

    name: str
    urdf: str
    model: pin.Model
    joints: tuple[str, ...]
    links: tuple[str, ...]
    motors: tuple[Motor, ...]
    limits: tuple[Limits, ...]
    friction: Array
    base: str
    camera_frame: str
    payload: str | None
    payload_link: str | None
    config: Config
    path: Path
    notes: tuple[str, ...] = ()
    source: str = ""
    rotors_apart: frozenset[str] = frozenset()

    ROWS: ClassVar[str] = "joints"
    __repr__ = brief

    def __post_init__(self) -> None:
        """Give the Pinocchio model the rotors that the motors state."""
        rows = zip(self.joints, self.motors)
        apart = {*self.rotors_apart, *self.coupling}
        stated = np.array([0.0 if joint in apart else motor.armature for joint, motor in rows])
        if not np.array_equal(self.model.armature, stated):
            model = self.model.copy()
            model.armature = stated
            object.__setattr__(self, "model", model)

    @property
    def armature(self) -> Array:
        """Stated inertia of each motor's rotor at its joint, ``gear_ratio² rotor_inertia``, kg m², (n,).

        Zero at the joints `rotors_apart`, and where a motor turns with several joints, see `coupling`.
        """
        return np.array(self.model.armature)

    @property
    def coupling(self) -> Mapping[str, Mapping[str, float]]:
        """Joint → other joint → turns of the former's motor per turn of the latter, see `Config`."""
        return {joint: others for joint, others in self.config.coupling.items() if others}

    def build_motor_row(self, joint: str) -> Array:
        """Return g of ``g q``, the angle of a joint's motor at its joint, (n,): of a motor of its own a unit vector."""
        turns = {joint: 1.0, **self.coupling.get(joint, {})}
        return np.array([turns.get(each, 0.0) for each in self.joints])

    def with_rotors_apart(self, joints: Iterable[str]) -> Rig:
        """Return the rig without the rotors that are stated at some joints, and with all others."""
        apart = frozenset(joints)
        return self if apart == self.rotors_apart else replace(self, rotors_apart=apart)

    @property
    def aims(self) -> bool:
        """Whether anything of it is said to be a camera: else its line of sight is that of the last link by default."""
        return (
            self.payload is not None
            or bool(self.config.camera_frame)
            or self.camera_frame != self.links[-1]
        )

    @staticmethod
    @check_arguments
    def load(
        rig: str | Path,
        payload: str | Path | None = None,
        mend: bool = False,
        fixed: Mapping[str, float] | None = None,
    ) -> Rig:
        """Load a bundled rig or one of `robot_descriptions` by name, a URDF, xacro, SDF or MJCF, or a YAML of one.

        `payload`: a bundled one's name or a file's path; None mounts the YAML's default. `mend`: whether every inertia
        that breaks a rule becomes the nearest that does not. `fixed`: joint → angle, rad, or place, m, beside the
        YAML's.

        Raises:
            RigError: Anything that keeps it from being a rig, with file and mend.
        """
        path, config = find_rig(rig)
        check_name(path.stem, "the rig", str(path))
        config = replace(config, fixed={**config.fixed, **(fixed or {})})
        text, notes, _ = convert_to_urdf(path, config.xacro)
        element = urdf.parse_checked(text, str(path), config.fixed)
        by_name = {joint.get("name"): joint for joint in element.findall("joint")}
        for joint, at in config.fixed.items():
            if joint not in by_name:
                raise RigError(
                    f"{path}: fixed", f"there is no joint '{joint}'", "name a joint of the file"
                )
            _fix_joint(by_name[joint], at)
        notes = notes + remove_unfelt_inertials(element, str(path))
        name = str(payload) if payload is not None else config.payload
        payload_link = None
        if name is not None:
            other = find_payload(name)
            check_name(other.stem, "the payload", name)
            text, more, _ = convert_to_urdf(other, {})
            part = urdf.parse_checked(text, str(other))
            notes += more + remove_unfelt_inertials(part, str(other), carried=True)
            payload_link = urdf.find_root_link(part, str(other))
            urdf.mount(
                element, part, config.mount or "camera_mount", f"{path} with {Path(other).name}"
            )
        mounted = Path(name).stem if name else None
        stated = Path(rig) if Path(rig).suffix in YAML_SUFFIXES else path.with_suffix(".yaml")
        built = build_rig(
            path, urdf.to_text(element), config, mounted, payload_link, str(stated), mend
        )
        mimics = [
            f"{joint.get('name')} ({joint.find('mimic').get('joint')})"
            for joint in element.xpath("joint[mimic]")
        ]
        mimicking = [
            f"a joint that mimics another is held where the other's zero has it: {join_names(mimics)}"
        ]
        doubts = find_implausible_values(built)
        return replace(
            built, notes=(*notes, *built.notes, *mimicking * bool(mimics), *doubts), source=str(rig)
        )

    def __str__(self) -> str:
        """Name, payload and joints; the URDF and the model would fill the screen."""
        return f"Rig(name={self.name!r}, payload={self.payload!r}, joints={self.joints})"

    def to_dict(self) -> dict[str, Any]:
        """Return what it is and what bounds its joints, null where nothing does; its bodies stand in `urdf`."""
        rows = zip(self.joints, self.links, self.limits, self.motors, self.friction.tolist())
        joints = {
            joint: {
                "link": link,
                **asdict(limits),
                "motor": asdict(motor),
                "coulomb": dry,
                "viscous": viscous,
            }
            for joint, link, limits, motor, (dry, viscous) in rows
        }
        facts = {
            "rig": self.name,
            "payload": self.payload,
            "base": self.base,
            "camera_frame": self.camera_frame,
        }
        return {"schema": 1, **facts, "joints": joints}

    @property
    def title(self) -> str:
        """Its name, and what it carries."""
        return f"{self.name} with {self.payload}" if self.payload else self.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def phi(self) -> Array:
        """The URDF's inertial parameters, (10 n,), per body in the order of `PHI`."""
        return np.concatenate(
            [inertia.toDynamicParameters() for inertia in self.model.inertias[1:]]
        )

    @cached_property
    def floating(self) -> pin.Model:
        """The model on a base that moves: six rates of the base first, then the joints'; see `build_floating_model`."""
        return build_floating_model(self.model)

    @property
    def tau_max(self) -> Array:
        """Torque limits, N m, (n,)."""
        return np.array(
            [min(motor.tau_max, limit.effort) for motor, limit in zip(self.motors, self.limits)]
        )

    @property
    def stops(self) -> tuple[Array, Array]:
        """Lowest and highest angle of every joint, rad, (n,) each; infinite where there is no stop."""
        return np.array([limit.lower for limit in self.limits]), np.array(
            [limit.upper for limit in self.limits]
        )

    def joint_index(self, joint: str) -> int:
        """Return the column of a joint; `RigError` lists the joints if there is none of that name."""
        if joint not in self.joints:
            raise RigError(
                f"rig {self.name}",
                f"has no joint '{joint}'",
                f"its joints are {', '.join(self.joints)}",
            )
        return self.joints.index(joint)

    @cached_property
    def slides(self) -> tuple[bool, ...]:
        """Whether each joint slides, and does not turn (n)."""
        return tuple(
            joint.shortname().startswith("JointModelP") for joint in self.model.joints.tolist()[1:]
        )

    @cached_property
    def continuous(self) -> tuple[bool, ...]:
        """Whether each joint turns without stops (n): its angles 2π apart are one pose."""
        return tuple((np.isinf(self.stops).all(axis=0) & ~np.array(self.slides)).tolist())

    def in_units(self, joint: str | None, text: str) -> str:
        """Return a text, or a unit, that is written as of a joint that turns, in the units of a joint."""
        return (
            to_sliding(text)
            if joint in self.joints and self.slides[self.joints.index(joint)]
            else text
        )

    @property
    def force(self) -> str:
        """Unit of what drives its joints: N m, N, or both where some slide."""
        return " or ".join(dict.fromkeys(self.in_units(joint, "N m") for joint in self.joints))

    @cached_property
    def weightless(self) -> Rig:
        """The rig without gravity: its torques are those of inertia alone."""
        model = self.model.copy()
        model.gravity = pin.Motion.Zero()
        return replace(self, model=model)

    @cached_property
    def stated(self) -> Rig:
        """The rig with the inertial parameters that its URDF states."""
        return replace(self, model=to_pinocchio(self.urdf, str(self.path)))

    def with_phi(self, phi: Array) -> Rig:
        """Return the rig with other inertial parameters in its model, (10 n,); its URDF text stays as it is."""
        model = self.model.copy()
        for body, parameters in enumerate(np.reshape(phi, (-1, 10)), start=1):
            model.inertias[body] = pin.Inertia.FromDynamicParameters(parameters)
        return replace(self, model=model)


def build_rig(
    path: Path,
    text: str,
    config: Config,
    payload: str | None,
    payload_link: str | None,
    stated: str,
    mend: bool = False,
) -> Rig:
    """Build the rig from its merged URDF; `RigError` where URDF and YAML (`stated`) contradict each other."""
    place = str(path) if payload is None else f"{path} with {payload}"
    urdf.check_joints(urdf.parse_checked(text, place), place)
    model = to_pinocchio(text, place)
    sound, notes = mend_inertias(text, model, place, mend)
    element = urdf.parse_robot(sound, place)
    joints = tuple(model.names[1:])
    links = urdf.list_element_names(element, "link")
    coupled = [joint for own, others in config.coupling.items() for joint in (own, *others)]
    for key in (*config.motors, *config.limits, *coupled):
        if key not in joints and key not in config.fixed:
            raise RigError(
                stated,
                f"speaks of joint '{key}', which the rig has not",
                f"joints: {', '.join(joints)}",
            )
    by_name = {joint.get("name"): joint for joint in element.findall("joint")}
    moved = tuple(by_name[joint].find("child").get("link") for joint in joints)
    usual = (
        "camera"
        if "camera" in links
        else (*urdf.find_sensor_links(element, "camera"), moved[-1])[0]
    )
    camera = config.camera_frame or usual
    for link in (camera, *config.imus):
        if link not in links:
            raise RigError(
                stated,
                f"speaks of link '{link}', which the rig has not",
                f"links: {', '.join(links)}",
            )
    if config.optical_axis != "x":
        turned = f"{camera}_sight"
        at = pin.SE3(_SIGHT_ROTATIONS[config.optical_axis], np.zeros(3))
        while turned in links:
            turned += "_"
        etree.SubElement(element, "link", name=turned)
        urdf.add_joint(element, f"{turned}_joint", "fixed", camera, turned, at)
        camera = turned
        sound = urdf.to_text(element)
    if sound != text:
        model = to_pinocchio(sound, place)
    config = replace(
        config,
        motors=overlay_config(Config(motors=_read_transmissions(element, joints)), config).motors,
    )
    limits = tuple(
        _read_limits(by_name[joint], config.limits.get(joint, {}), stated) for joint in joints
    )
    if idle := [joint for joint, limit in zip(joints, limits) if limit.lower == limit.upper]:
        notes.append(
            f"lower and upper limit are equal, so the travel counts as not stated: {join_names(idle)}"
        )
    friction = [
        [
            float(urdf.read_numbers(by_name[joint].find("dynamics"), key, "0")[0])
            for key in ("friction", "damping")
        ]
        for joint in joints
    ]
    return Rig(
        name=path.stem,
        urdf=sound,
        model=model,
        joints=joints,
        links=moved,
        motors=tuple(config.motors.get(joint, Motor()) for joint in joints),
        limits=tuple(
            replace(x, lower=-math.inf, upper=math.inf) if x.lower == x.upper else x for x in limits
        ),
        friction=np.array(friction),
        base=urdf.find_root_link(element, place),
        camera_frame=camera,
        payload=payload,
        payload_link=payload_link,
        config=config,
        path=path,
        notes=tuple(notes),
    )


_SIGHT_ROTATIONS = {
    "x": np.eye(3),
    "-x": np.diag([-1.0, -1.0, 1.0]),
    "y": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-y": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "z": np.array(
        [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    ),  # ROS: z forward, y down (REP 103)
    "-z": np.array(
        [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]
    ),  # OpenGL, MuJoCo: -z forward, y up
}
"""Optical axis → rotation to a frame whose x is the line of sight and whose z is up in the picture."""


def _read_transmissions(robot: etree._Element, joints: tuple[str, ...]) -> dict[str, Motor]:
    """Return joint → gear ratio, rotor inertia and torque constant, as far as a ``<transmission>`` states them.

    ROS 1 (``mechanicalReduction``, ``motorTorqueConstant``), ros2_control (``mechanical_reduction``) and Drake
    (``drake:gear_ratio``, ``drake:rotor_inertia``); one joint and one motor each. What is no number is passed over.
    """
    out = {}
    for transmission in robot.iter("transmission"):
        moved = [joint.get("name") for joint in transmission.findall("joint")]
        if len(moved) != 1 or moved[0] not in joints or len(transmission.findall("actuator")) != 1:
            continue
        ratio = 1.0
        found = dict[str, float]()
        for element in transmission.iterdescendants(etree.Element):
            value = abs(parse_decimal((element.get("value") or element.text or "").strip()) or 0.0)
            tag = etree.QName(element).localname.replace("_", "").lower()
            if tag in ("mechanicalreduction", "gearratio") and 0 < value <= 1e5:
                ratio *= value
            elif tag in ("rotorinertia", "motortorqueconstant") and 1e-12 < value < 1e6:
                found[tag] = value
        constant = found.get("motortorqueconstant")
        out[moved[0]] = Motor(
            torque_constant=None if constant is None else ratio * constant,
            gear_ratio=ratio,
            rotor_inertia=found.get("rotorinertia", 0.0),
        )
    return out


def to_pinocchio(text: str, place: str) -> pin.Model:
    """Return the fixed-base model, `continuous` joints as unlimited revolute ones (logs hold one angle per joint).

    A joint that mimics another, ``q = multiplier q' + offset``, is fixed at its offset.
    """
    robot = urdf.parse_robot(text, place)
    for joint in robot.xpath("joint[mimic]"):
        _fix_joint(joint, float(joint.find("mimic").get("offset", "0")))
    for joint in robot.findall("joint[@type='continuous']"):
        joint.set("type", "revolute")
        if joint.find("limit") is None:
            etree.SubElement(joint, "limit", effort="0", velocity="0")
    try:
        model = pin.buildModelFromXML(urdf.strip_to_skeleton(robot))
    except (ValueError, RuntimeError) as error:
        raise RigError(
            place, f"is not a URDF that Pinocchio reads ({error})", "mend what it names"
        ) from error
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    for joint, inertia in zip(model.names[1:], model.inertias[1:]):
        if not inertia.mass > 0:
            raise RigError(
                f"{place}: joint '{joint}'",
                "moves no mass",
                "give its link an <inertial>, or mount a payload",
            )
    return model


def _fix_joint(joint: etree._Element, at: float) -> None:
    """Make a joint a fixed one where it reads `at`, rad or m, in place."""
    kind = joint.get("type")
    joint.set("type", "fixed")
    if at and kind in MOVABLE:
        axis = urdf.read_numbers(joint.find("axis"), "xyz", "1 0 0")
        way = at * axis / max(float(np.linalg.norm(axis)), 1e-6)
        turn = (
            pin.SE3(np.eye(3), way) if kind == "prismatic" else pin.SE3(pin.exp3(way), np.zeros(3))
        )
        urdf.set_pose(joint, urdf.read_pose(joint) * turn)


def _read_limits(joint: etree._Element, override: Mapping[str, float], place: str) -> Limits:
    """Return the URDF's limits of a joint with the YAML's entries on top.

    An effort or velocity of 0 counts as not stated: it is what exporters write who do not know it. One of 1e16 or more,
    SDF's word for no limit, is infinite.
    """
    limit = joint.find("limit")
    every = dict[str, float]()
    for key in ("effort", "velocity", "lower", "upper") if limit is not None else ():
        value = limit.get(key)
        is_end = key in ("lower", "upper")
        if value is not None and (
            (is_end and joint.get("type") != "continuous") or (not is_end and float(value))
        ):
            every[key] = float(value)
    every |= override
    limits = Limits(
        **{
            key: math.copysign(math.inf, x) if abs(x) >= LARGEST_NUMBER else x
            for key, x in every.items()
        }
    )
    if limits.lower > limits.upper:
        what = f"has lower limit {limits.lower:g} above upper {limits.upper:g}"
        raise RigError(f"{place}: limits.{joint.get('name')}", what, "swap them")
    return limits


def to_sliding(text: str) -> str:
    """Return units of a joint that turns as those of one that slides: ``N m s/rad`` as ``N s/m``."""
    for turning, sliding in _SLIDING_UNITS.items():
        text = re.sub(turning, sliding, text)
    return text


def build_floating_model(model: pin.Model) -> pin.Model:
    """Return the model behind a free-flyer, without gravity: the base's prescribed acceleration is specific force.

    With the base's attitude identity, its velocity (0, ω) and its acceleration (f, ω̇), the joints' torques are those
    of the base that moves so. Pinocchio's base acceleration is spatial, classical minus ω×v: hence v = 0. The base's
    own inertia is left out, as no joint feels it: the first six rows of RNEA are the wrench of the moved bodies on it.

    Gravity that leans in the model (`base-tilt`) means that the base leans against its platform: so does the rig here.
    """
    out = pin.Model()
    out.gravity.linear = np.zeros(3)
    root = out.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    lean = pin.SE3(compute_lean(model.gravity.linear), np.zeros(3))
    places = [
        lean * place if model.parents[j] == 0 else place
        for j, place in enumerate(model.jointPlacements)
    ]
    for j in range(1, model.njoints):
        out.addJoint(int(model.parents[j]) + root, model.joints[j], places[j], model.names[j])
        out.appendBodyToJoint(j + root, model.inertias[j], pin.SE3.Identity())
    for frame in model.frames[1:]:
        place = lean * frame.placement if frame.parentJoint == 0 else frame.placement
        out.addFrame(pin.Frame(frame.name, frame.parentJoint + root, 0, place, frame.type), False)
    out.armature = np.concatenate([np.zeros(out.nv - model.nv), model.armature])
    return out


def compute_lean(gravity: np.ndarray) -> np.ndarray:
    """Smallest rotation R with ``gravity = Rᵀ (0, 0, -g)``; identity without gravity."""
    if not np.any(gravity):
        return np.eye(3)
    down = np.array([0.0, 0.0, -np.linalg.norm(gravity)])
    return np.asarray(pin.Quaternion.FromTwoVectors(np.asarray(gravity), down).toRotationMatrix())
