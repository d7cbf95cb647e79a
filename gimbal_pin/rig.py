"""A gimbal as data: URDF, Pinocchio model, motors, limits, payload, and where the camera is."""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from math import inf, isnan, pi
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from lxml import etree

from gimbal_pin import urdf
from gimbal_pin.errors import RigError
from gimbal_pin.log import Array

GRAVITY = 9.81
"""Acceleration of gravity, m/s², down the world's z."""

YAML = (".yaml", ".yml")

PHI = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""A body's ten inertial parameters in Pinocchio's order: mass, first moments, inertia about the joint's origin."""


@dataclass(frozen=True)
class Motor:
    """The motor and encoder of one joint.

    Attributes:
        tau_max: Largest torque, N m.
        torque_constant: Torque per current, N m/A.
        slots: Stator slots, or None.
        poles: Rotor poles (twice the pole pairs), or None.
        encoder_bits: Resolution of the angle sensor over one turn, or None.
    """

    tau_max: float = inf
    torque_constant: float = 1.0
    slots: int | None = None
    poles: int | None = None
    encoder_bits: float | None = None

    @property
    def encoder_step(self) -> float:
        """Angle of one encoder step, rad; 0 where the resolution is not stated."""
        return 2 * pi / 2**self.encoder_bits if self.encoder_bits else 0.0


@dataclass(frozen=True)
class Limits:
    """Limits of one joint: angle rad, velocity rad/s, acceleration rad/s², effort N m."""

    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    acceleration: float = inf
    effort: float = inf


@dataclass(frozen=True)
class Noise:
    """Noise densities of the rig's IMUs: gyro rad/s/√Hz, accelerometer m/s²/√Hz."""

    gyro: float = 0.0
    accelerometer: float = 0.0


@dataclass(frozen=True)
class Config:
    """A rig's YAML: what a URDF cannot say.

    Attributes:
        urdf: Path of the URDF, relative to the YAML; None: the file of the same name beside it.
        description: One sentence.
        mount: Link that a payload is fixed to.
        camera_frame: Link whose +x axis is the line of sight.
        payload: Payload mounted when none is named: a bundled name, or a URDF's path relative to the YAML.
        inertia: "trusted" if the URDF's inertias are known to be right, so that differences from them are findings.
        motors: Joint → `Motor`.
        limits: Joint → the entries of `Limits` to override.
        imus: Links that carry an IMU.
        noise: Densities of the IMUs' noise.
    """

    urdf: str | None = None
    description: str = ""
    mount: str | None = None
    camera_frame: str | None = None
    payload: str | None = None
    inertia: str = "nominal"
    motors: Mapping[str, Motor] = field(default_factory=dict)
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    imus: tuple[str, ...] = ()
    noise: Noise = Noise()


@dataclass(frozen=True, eq=False)
class Rig:
    """A tree of bodies on a fixed base, with one actuated angle per joint.

    Attributes:
        name: Bundled name or file stem.
        urdf: URDF text, payload included, joint types as written.
        model: Pinocchio model; `continuous` joints are revolute in it, so that nq = nv = number of joints.
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

    @staticmethod
    def load(rig: str | Path, payload: str | Path | None = None) -> Rig:
        """Load a bundled rig by name, a URDF, or a YAML that names a URDF.

        Args:
            rig: Bundled name, or path of a URDF or YAML file.
            payload: Bundled payload's name or URDF path; None mounts the YAML's default.

        Raises:
            RigError: Anything that keeps it from being a rig, with file and mend.
        """
        path, config = find(rig)
        element = urdf.tree(read(path), str(path))
        name = str(payload) if payload is not None else config.payload
        payload_link = None
        if name is not None:
            other = payload_path(name)
            part = urdf.tree(read(other), str(other))
            payload_link = urdf.root_link(part, str(other))
            urdf.mount(element, part, config.mount or "camera_mount", str(path))
        text, mounted = urdf.to_text(element), Path(name).stem if name else None
        stated = Path(rig) if Path(rig).suffix in YAML else path.with_suffix(".yaml")
        return build(path, text, config, mounted, payload_link, str(stated))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def phi(self) -> Array:
        """The URDF's inertial parameters, (10 n,), per body in the order of `PHI`."""
        return np.concatenate([inertia.toDynamicParameters() for inertia in self.model.inertias[1:]])

    @property
    def tau_max(self) -> Array:
        """Torque limits, N m, (n,)."""
        return np.array([min(motor.tau_max, limit.effort) for motor, limit in zip(self.motors, self.limits)])

    def joint_index(self, joint: str) -> int:
        """Return the column of a joint; `RigError` lists the joints if there is none of that name."""
        if joint not in self.joints:
            raise RigError(f"rig {self.name}", f"has no joint '{joint}'", f"its joints are {', '.join(self.joints)}")
        return self.joints.index(joint)

    def with_phi(self, phi: Array) -> Rig:
        """Return the rig with other inertial parameters in its model, (10 n,); its URDF text stays as it is."""
        model = self.model.copy()
        for body, parameters in enumerate(np.reshape(phi, (-1, 10)), start=1):
            model.inertias[body] = pin.Inertia.FromDynamicParameters(parameters)
        return replace(self, model=model)


def bundled() -> Path:
    """Return the folder of the bundled rigs: inside the installed package, or beside it in a checkout."""
    inside = Path(str(importlib.resources.files("gimbal_pin"))) / "urdf"
    return inside if inside.is_dir() else Path(__file__).parents[1] / "urdf"


def bundled_rigs() -> tuple[str, ...]:
    """Names of the bundled rigs."""
    return tuple(sorted(path.stem for path in bundled().glob("*.urdf")))


def bundled_payloads() -> tuple[str, ...]:
    """Names of the bundled payloads."""
    return tuple(sorted(path.stem for path in (bundled() / "payloads").glob("*.urdf")))


def find(rig: str | Path, above: tuple[Path, ...] = ()) -> tuple[Path, Config]:
    """Return the URDF's path and the configuration of a bundled name, URDF or YAML path.

    Args:
        rig: Bundled name or path.
        above: The YAML files that led here, resolved: none may name itself, directly or in a circle.
    """
    path = bundled() / f"{rig}.urdf" if str(rig) in bundled_rigs() else Path(rig)
    if not path.is_file():
        names = ", ".join(bundled_rigs())
        raise RigError(str(rig), "is neither a file nor a bundled rig", f"give a path, or one of {names}")
    if path.suffix not in YAML:
        beside = path.with_suffix(".yaml")
        return path, load_config(beside) if beside.is_file() else Config()
    if path.resolve() in above:
        raise RigError(str(path), "names itself as its rig", "name a URDF with 'urdf:'")
    config = load_config(path)
    target = find_target(path, config)
    if target.suffix == ".urdf":
        return target, config
    base_path, base = find(target, (*above, path.resolve()))
    return base_path, overlaid(base, config)


def find_target(path: Path, config: Config) -> Path:
    """Return what a YAML's `urdf:` names: a bundled rig, or a file relative to the YAML."""
    if config.urdf is None:
        return path.with_suffix(".urdf")
    if config.urdf in bundled_rigs():
        return bundled() / f"{config.urdf}.yaml"
    return path.parent / config.urdf


def overlaid(base: Config, top: Config) -> Config:
    """Return `base` with what `top` states on top of it; a joint keeps what `top` does not state about it."""
    merged = changed(top, Config())
    merged["limits"] = {**base.limits, **{j: {**base.limits.get(j, {}), **entry} for j, entry in top.limits.items()}}
    motors = {j: replace(base.motors.get(j, Motor()), **changed(motor, Motor())) for j, motor in top.motors.items()}
    return replace(base, **{**merged, "motors": {**base.motors, **motors}})


def changed(value: Any, default: Any) -> dict[str, Any]:
    """Return the fields in which a dataclass differs from its default."""
    return {f.name: getattr(value, f.name) for f in fields(value) if getattr(value, f.name) != getattr(default, f.name)}


def payload_path(payload: str) -> Path:
    """Return the URDF of a bundled payload or of a path."""
    path = bundled() / "payloads" / f"{payload}.urdf" if payload in bundled_payloads() else Path(payload)
    if not path.is_file():
        names = ", ".join(bundled_payloads())
        raise RigError(payload, "is neither a file nor a bundled payload", f"give a URDF, or one of {names}")
    return path


def read(path: Path) -> str:
    """Return a text file's content; `RigError` if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RigError(str(path), f"cannot be read ({error})", "give a readable text file") from error


def load_config(path: Path) -> Config:
    """Read a rig's YAML; `RigError` names the unknown key or the value of the wrong kind."""
    data, place = plain_yaml(path), str(path)
    known(data, Config, place)
    motors = {joint: typed(Motor, entry, f"{place}: motors.{joint}") for joint, entry in table(data, "motors", place)}
    limits = {
        joint: numbers(Limits, entry, f"{place}: limits.{joint}") for joint, entry in table(data, "limits", place)
    }
    noise = typed(Noise, data.get("noise") or {}, f"{place}: noise")
    imus = data.get("imus") or []
    if not isinstance(imus, list) or not all(isinstance(link, str) for link in imus):
        raise RigError(f"{place}: imus", f"is {imus!r}", "write a list of links, e.g. [head, cradle]")
    if data.get("inertia", "nominal") not in ("nominal", "trusted"):
        raise RigError(f"{place}: inertia", f"is '{data['inertia']}'", "write trusted or nominal")
    texts = {
        key: data[key]
        for key in ("urdf", "description", "mount", "camera_frame", "payload", "inertia")
        if data.get(key) is not None
    }
    for key, value in texts.items():
        if not isinstance(value, str):
            raise RigError(f"{place}: {key}", f"is {value!r}", "write a text")
    if "payload" in texts and texts["payload"] not in bundled_payloads():
        texts["payload"] = str(path.parent / texts["payload"])
    return Config(**texts, motors=motors, limits=limits, imus=tuple(imus), noise=noise)


def plain_yaml(path: Path) -> Any:
    """Return a YAML file's values; `RigError` names the line where it breaks or where a key stands twice."""
    try:
        loader = yaml.SafeLoader(read(path))
        root = loader.get_single_node()
        check_twice(root, depth=3)
        return {} if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise RigError(f"{path}{line}", f"is not YAML ({error.problem})", "mend that line") from error
    except (yaml.YAMLError, ValueError) as error:
        raise RigError(str(path), f"is not YAML ({error})", "give a YAML file") from error


def check_twice(node: yaml.Node | None, depth: int) -> None:
    """Raise `yaml.MarkedYAMLError` at a key that stands twice in one table: the first would be lost in silence."""
    if depth == 0 or not isinstance(node, yaml.MappingNode):
        return
    seen = set()
    for key, value in node.value:
        if str(key.value) in seen:
            raise yaml.MarkedYAMLError(problem=f"'{key.value}' stands twice", problem_mark=key.start_mark)
        seen.add(str(key.value))
        check_twice(value, depth - 1)


def known(data: Any, kind: type, place: str) -> None:
    """Raise `RigError` unless `data` is a mapping whose keys are fields of `kind`."""
    keys = [f.name for f in fields(kind)]
    if not isinstance(data, dict):
        raise RigError(place, "is not a table of keys and values", f"give keys out of {', '.join(keys)}")
    for key in data:
        if key not in keys:
            raise RigError(place, f"has an unknown key '{key}'", f"the known ones are {', '.join(keys)}")


def table(data: Mapping[str, Any], key: str, place: str) -> list[tuple[str, Any]]:
    """Return the joint → entry pairs under `key`."""
    value = data.get(key) or {}
    if not isinstance(value, dict):
        raise RigError(f"{place}: {key}", "is not a table of joints", "write one line per joint")
    return list(value.items())


def numbers(kind: type, entry: Any, place: str) -> dict[str, float]:
    """Return the entry's values as floats, its keys being fields of `kind`; all but angles are sizes, so positive."""
    known(entry, kind, place)
    try:
        values = {key: float(value) for key, value in entry.items()}
    except (TypeError, ValueError) as error:
        raise RigError(place, f"has a value that is no number ({error})", "write numbers, in SI units") from error
    for key, value in values.items():
        if isnan(value) or (value < 0 and key not in ("lower", "upper")):
            raise RigError(f"{place}.{key}", f"is {value:g}", "write its size, in SI units")
    return values


def typed(kind: type, entry: Any, place: str) -> Any:
    """Return a frozen `kind` built from the entry's numbers."""
    values: dict[str, Any] = numbers(kind, entry, place)
    for key in values.keys() & {"slots", "poles"}:
        if not values[key].is_integer():
            raise RigError(f"{place}.{key}", f"is {values[key]:g}", "write a whole number")
        values[key] = int(values[key])
    return kind(**values)


def build(path: Path, text: str, config: Config, payload: str | None, payload_link: str | None, stated: str) -> Rig:
    """Build the rig from its merged URDF; `RigError` where URDF and YAML (`stated`) contradict each other."""
    robot = urdf.checked(text, str(path))
    model = to_pinocchio(text, str(path))
    joints = tuple(model.names[1:])
    by_name = {joint.name: joint for joint in robot.joints}
    for key in (*config.motors, *config.limits):
        if key not in joints:
            raise RigError(stated, f"speaks of joint '{key}', which the rig has not", f"joints: {', '.join(joints)}")
    element = urdf.parse(text, str(path))
    links = urdf.names(element, "link")
    camera = config.camera_frame or ("camera" if "camera" in links else by_name[joints[-1]].child)
    for link in (camera, *config.imus):
        if link not in links:
            raise RigError(stated, f"speaks of link '{link}', which the rig has not", f"links: {', '.join(links)}")
    return Rig(
        name=path.stem,
        urdf=text,
        model=model,
        joints=joints,
        links=tuple(by_name[joint].child for joint in joints),
        motors=tuple(config.motors.get(joint, Motor()) for joint in joints),
        limits=tuple(joint_limits(by_name[joint], config.limits.get(joint, {}), stated) for joint in joints),
        friction=np.array([joint_friction(by_name[joint]) for joint in joints]),
        base=urdf.root_link(element, str(path)),
        camera_frame=camera,
        payload=payload,
        payload_link=payload_link,
        config=config,
        path=path,
    )


def to_pinocchio(text: str, place: str) -> pin.Model:
    """Return the fixed-base model, `continuous` joints as unlimited revolute ones (logs hold one angle per joint)."""
    robot = urdf.parse(text, place)
    for joint in robot.findall("joint[@type='continuous']"):
        joint.set("type", "revolute")
        if joint.find("limit") is None:
            etree.SubElement(joint, "limit", effort="0", velocity="0")
    try:
        model = pin.buildModelFromXML(urdf.to_text(robot))
    except (ValueError, RuntimeError) as error:
        raise RigError(place, f"is not a URDF that Pinocchio reads ({error})", "mend what it names") from error
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    for joint, inertia in zip(model.names[1:], model.inertias[1:]):
        if not inertia.mass > 0:
            raise RigError(
                f"{place}: joint '{joint}'", "moves no mass", "give its link an <inertial>, or mount a payload"
            )
    return model


def joint_limits(joint: Any, override: Mapping[str, float], place: str) -> Limits:
    """Return the URDF's limits of a yourdfpy joint with the YAML's entries on top.

    An effort or velocity of 0 counts as not stated: it is what exporters write who do not know it.
    """
    limit = joint.limit
    stated: dict[str, float] = {}
    if limit is not None:
        keys = ("effort", "velocity") if joint.type == "continuous" else ("effort", "velocity", "lower", "upper")
        given = {key: getattr(limit, key) for key in keys}
        stated = {key: float(x) for key, x in given.items() if x or (x is not None and key in ("lower", "upper"))}
    limits = Limits(**{**stated, **override})
    if limits.lower > limits.upper:
        what = f"has lower limit {limits.lower:g} above upper {limits.upper:g}"
        raise RigError(f"{place}: limits.{joint.name}", what, "swap them")
    return limits


def joint_friction(joint: Any) -> tuple[float, float]:
    """Return the Coulomb and viscous coefficients of a yourdfpy joint's ``<dynamics>``; zero where not stated."""
    dynamics = joint.dynamics
    return (0.0, 0.0) if dynamics is None else (float(dynamics.friction or 0.0), float(dynamics.damping or 0.0))
