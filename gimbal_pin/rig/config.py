"""A rig's YAML: motors, limits, sensors and the camera, which a URDF cannot describe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf, pi
from pathlib import Path
from typing import Any

from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.records import LARGEST_NUMBER, bounded_field, read_fields, read_record

SMALLEST_POSITIVE = 1e-9
"""Least torque, N m and N m/A, and rate, rad/s: the smallest motors give 1e-6 N m, and nothing is divided by zero."""
_OPTICAL_AXES = tuple(f"{sign}{axis}" for axis in "xyz" for sign in ("", "-"))


@dataclass(frozen=True)
class Motor:
    """The motor and encoder of one joint.

    Attributes:
        tau_max: Largest torque, N m.
        torque_constant: Torque per current, N m/A, or None.
        slots: Stator slots, or None.
        poles: Rotor poles (twice the pole pairs), or None.
        encoder_bits: Resolution of the angle sensor over one turn, or None; a double's 52 are the finest.
        encoder_zero: Mapped reading of the angle sensor at the URDF's zero, rad or m; subtracted on reading.
        gear_ratio: Turns of the rotor per turn of the joint; torques and the constant above are the joint's.
        rotor_inertia: The rotor's inertia about its own axis, kg m².
        torque_offset: "fit" if the reported torque is off by a constant, which then is a parameter of the model; else
            "none".
    """

    tau_max: float = bounded_field(inf, SMALLEST_POSITIVE, inf)
    torque_constant: float | None = bounded_field(None, SMALLEST_POSITIVE, LARGEST_NUMBER)
    slots: int | None = bounded_field(None, 1, 1000)
    poles: int | None = bounded_field(None, 2, 1000)
    encoder_bits: float | None = bounded_field(None, 1, 52)
    encoder_zero: float = bounded_field(0.0, -1e8, 1e8)
    gear_ratio: float = bounded_field(1.0, -1e5, 1e5)
    rotor_inertia: float = bounded_field(0.0, 0.0, LARGEST_NUMBER)
    torque_offset: str = "none"

    @property
    def armature(self) -> float:
        """The rotor's inertia at the joint, kg m²."""
        return self.gear_ratio**2 * self.rotor_inertia

    @property
    def states_rotor(self) -> bool:
        """Whether a gear or a rotor is stated: then the rotor's inertia is a parameter of the model."""
        return self.rotor_inertia > 0 or abs(self.gear_ratio) != 1

    @property
    def encoder_step(self) -> float:
        """Angle of one encoder step, rad; 0 where the resolution is not stated."""
        return 2 * pi / 2**self.encoder_bits if self.encoder_bits else 0.0


@dataclass(frozen=True)
class Limits:
    """Limits of one joint: angle rad, velocity rad/s, acceleration rad/s², effort N m."""

    lower: float = bounded_field(-inf, -inf, LARGEST_NUMBER)
    upper: float = bounded_field(inf, -LARGEST_NUMBER, inf)
    velocity: float = bounded_field(inf, SMALLEST_POSITIVE, inf)
    acceleration: float = bounded_field(inf, SMALLEST_POSITIVE, inf)
    effort: float = bounded_field(inf, SMALLEST_POSITIVE, inf)


@dataclass(frozen=True)
class Noise:
    """Noise densities of the rig's IMUs: gyro rad/s/√Hz, accelerometer m/s²/√Hz."""

    gyro: float = bounded_field(0.0, 0.0, 1e3)
    accelerometer: float = bounded_field(0.0, 0.0, 1e3)


@dataclass(frozen=True)
class Config:
    """A rig's YAML.

    Attributes:
        urdf: Path of the URDF, xacro, SDF or MJCF, relative to the YAML; None: the URDF of the same name beside it.
        xacro: Arguments of a xacro file: name → text.
        description: One sentence.
        mount: Link that a payload is fixed to.
        camera_frame: Link that looks along one of its axes.
        optical_axis: Which: x, -x, y, -y, z or -z; ROS's optical frames look along z, many a gimbal's camera along -x.
        fixed: Joint → angle, rad, or place, m, at which it is fixed; the rig does not have the joint.
        payload: Payload mounted when none is named: a bundled name, or a URDF's path relative to the YAML.
        inertia: "trusted" if the URDF's inertias are known to be right, so that differences from them are findings.
        motors: Joint → `Motor`.
        limits: Joint → the entries of `Limits` to override.
        coupling: Joint → other joint → turns of the former's motor per turn of the latter, as a share of those per turn
            of its own: that motor's angle at its joint is ``q + sum ratio q_other``.
        imus: Links that carry an IMU.
        noise: Densities of the IMUs' noise.
    """

    urdf: str | None = None
    xacro: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    mount: str | None = None
    camera_frame: str | None = None
    optical_axis: str = "x"
    fixed: Mapping[str, float] = field(default_factory=dict)
    payload: str | None = None
    inertia: str = "nominal"
    motors: Mapping[str, Motor] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)
    coupling: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    imus: tuple[str, ...] = ()
    noise: Noise = Noise()

    __repr__ = brief


def is_written(path: Path) -> bool:
    """Whether a YAML is a model or a controller that gimbal_pin wrote, and so no rig's."""
    data = read_yaml(path, RigError)
    return isinstance(data, dict) and "schema" in data


def load_config(path: Path) -> Config:
    """Read a rig's YAML; `RigError` names the unknown key or the value of the wrong kind."""
    data = read_yaml(path, RigError)
    place = str(path)
    if isinstance(data, dict) and "schema" in data:
        what = "is a model or a controller that gimbal_pin wrote, not a rig's YAML"
        raise RigError(place, what, "give the rig's URDF, or a YAML that names it")
    if isinstance(data, dict):
        data = {key: entry for key, entry in data.items() if entry is not None}
    config = read_record(Config, {} if data is None else data, place, RigError)
    if config.inertia not in ("nominal", "trusted"):
        raise RigError(f"{place}: inertia", f"is '{config.inertia}'", "write trusted or nominal")
    if config.optical_axis not in _OPTICAL_AXES:
        mend = f"write one of {', '.join(_OPTICAL_AXES)}"
        raise RigError(f"{place}: optical_axis", f"is '{config.optical_axis}'", mend)
    for joint, motor in config.motors.items():
        if motor.torque_offset not in ("none", "fit"):
            at = f"{place}: motors.{joint}.torque_offset"
            raise RigError(at, f"is '{motor.torque_offset}'", "write fit or none")
    for joint, others in config.coupling.items():
        if joint in others:
            what = "couples a joint with itself"
            raise RigError(f"{place}: coupling.{joint}", what, "name other joints")
    rows = config.limits.items()
    limits = {
        joint: read_fields(Limits, entry, f"{place}: limits.{joint}", RigError)
        for joint, entry in rows
    }
    return replace(config, limits=limits)


def read_limits(
    texts: Sequence[str], joints: Sequence[str], limits: Sequence[Limits]
) -> tuple[Limits, ...]:
    """Return the joints' limits, those of texts such as ``pan.velocity=2`` in place of their own.

    Raises:
        UsageError: A text names no joint or limit of the rig, or no number that such a limit may have.
    """
    named = dict(zip(joints, limits))
    for given in texts:
        name, _, number = given.partition("=")
        joint, _, quantity = name.rpartition(".")
        place = f"--limit {given}"
        mend = f"write JOINT.velocity=NUMBER with a joint out of {', '.join(joints)}"
        if joint not in named:
            raise UsageError(place, f"the rig has no joint '{joint}'", mend)
        try:
            value = float(number)
        except ValueError:
            raise UsageError(place, f"'{number}' is no number", mend) from None
        named[joint] = replace(
            named[joint], **read_fields(Limits, {quantity: value}, place, UsageError)
        )
    return tuple(named.values())


def overlay_config(base: Config, top: Config) -> Config:
    """Return `base` with what `top` states on top of it; a joint keeps what `top` does not state about it."""
    merged = _list_changes(top, Config())
    merged["limits"] = {
        **base.limits,
        **{j: {**base.limits.get(j, {}), **entry} for j, entry in top.limits.items()},
    }
    merged["fixed"] = {**base.fixed, **top.fixed}
    merged["xacro"] = {**base.xacro, **top.xacro}
    usual = Motor()
    motors = {
        j: replace(base.motors.get(j, usual), **_list_changes(own, usual))
        for j, own in top.motors.items()
    }
    return replace(base, **{**merged, "motors": {**base.motors, **motors}})


def _list_changes(value: Any, default: Any) -> dict[str, Any]:
    """Return the fields in which a dataclass differs from its default."""
    return {
        f.name: getattr(value, f.name)
        for f in fields(value)
        if getattr(value, f.name) != getattr(default, f.name)
    }
