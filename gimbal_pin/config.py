"""A rig's YAML: what a URDF cannot say of motors, limits, sensors and the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from math import inf, isnan, pi
from pathlib import Path
from typing import Any

from gimbal_pin.errors import RigError
from gimbal_pin.reading import read_yaml


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


def load_config(path: Path) -> Config:
    """Read a rig's YAML; `RigError` names the unknown key or the value of the wrong kind."""
    data, place = read_yaml(path, RigError) or {}, str(path)
    if isinstance(data, dict) and "schema" in data:
        mend = "rename it: a YAML that is named as the URDF beside it is taken for the rig's own"
        raise RigError(place, "is a model or a controller that gimbal_pin wrote, not a rig's YAML", mend)
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
    return Config(**texts, motors=motors, limits=limits, imus=tuple(imus), noise=noise)


def overlaid(base: Config, top: Config) -> Config:
    """Return `base` with what `top` states on top of it; a joint keeps what `top` does not state about it."""
    merged = changed(top, Config())
    merged["limits"] = {**base.limits, **{j: {**base.limits.get(j, {}), **entry} for j, entry in top.limits.items()}}
    motors = {j: replace(base.motors.get(j, Motor()), **changed(motor, Motor())) for j, motor in top.motors.items()}
    return replace(base, **{**merged, "motors": {**base.motors, **motors}})


def changed(value: Any, default: Any) -> dict[str, Any]:
    """Return the fields in which a dataclass differs from its default."""
    return {f.name: getattr(value, f.name) for f in fields(value) if getattr(value, f.name) != getattr(default, f.name)}


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
