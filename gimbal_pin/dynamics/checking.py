"""A rig on the scales: what was checked, what its motors must bear, and what a log of it must hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.dynamics.base_parameters import compute_base
from gimbal_pin.dynamics.reduction import spread_states
from gimbal_pin.dynamics.regressor import compute_rnea
from gimbal_pin.log.log import Array
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.config import load_config
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs, find_payload, find_rig
from gimbal_pin.rig.rig import Rig

CHECKED_POSES = 2000


@dataclass(frozen=True)
class JointCheck:
    """One joint: what it moves and what holds it.

    Attributes:
        link: The link it moves.
        slides: Whether it slides: what is in rad and N m of others is in m and N.
        mass: Mass of that body with all that is fixed to it, kg.
        lower: Smallest angle, rad.
        upper: Largest angle, rad.
        velocity: Limit of the rate, rad/s.
        acceleration: Limit of the acceleration, rad/s².
        tau_max: Limit of the torque, N m.
        gravity_torque: Largest gravity torque over poses within the limits, N m.
        encoder_bits: Resolution of its encoder, or None.
        armature: Stated inertia of the motor's rotor at the joint, kg m².
    """

    link: str
    slides: bool
    mass: float
    lower: float
    upper: float
    velocity: float
    acceleration: float
    tau_max: float
    gravity_torque: float
    encoder_bits: float | None
    armature: float


@dataclass(frozen=True)
class Checked(Record):
    """The result of `check`.

    Attributes:
        rig: The rig's name.
        payload: The mounted payload, or None.
        camera_frame: Link whose +x is the line of sight.
        mount: Link that a payload is fixed to, or None.
        imus: Links that carry an IMU.
        joints: Joint → what was found.
        identifiable: Number of base parameters, friction included.
        columns: Columns that a log must hold.
        optional: Columns that a log may hold.
        warnings: Sentences about what is not wrong but unwise.
    """

    rig: Rig
    camera_frame: str
    mount: str | None
    imus: tuple[str, ...]
    joints: Mapping[str, JointCheck]
    identifiable: int
    columns: tuple[str, ...]
    optional: tuple[str, ...]
    warnings: tuple[str, ...]

    ROWS: ClassVar[str] = "joints"
    __repr__ = brief

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        every = {**vars(self), "joints": {joint: asdict(one) for joint, one in self.joints.items()}}
        return {"schema": 1, **every, "rig": self.rig.name, "payload": self.rig.payload}


@check_arguments
def check(rig: Rig) -> Checked:
    """Describe a rig that loaded, and so passed the checks of tree, axes, limits and inertias (`Rig.load`)."""
    load = compute_gravity_load(rig)
    rows = zip(
        rig.joints,
        rig.links,
        rig.slides,
        rig.model.inertias[1:],
        rig.limits,
        rig.motors,
        rig.tau_max,
        load,
    )
    joints = {
        joint: JointCheck(
            link=link,
            slides=slides,
            mass=float(body.mass),
            lower=limit.lower,
            upper=limit.upper,
            velocity=limit.velocity,
            acceleration=limit.acceleration,
            tau_max=float(tau_max),
            gravity_torque=float(torque),
            encoder_bits=motor.encoder_bits,
            armature=motor.armature,
        )
        for joint, link, slides, body, limit, motor, tau_max, torque in rows
    }
    need = ("t", *(f"{name}_{joint}" for name in ("q", "tau") for joint in rig.joints))
    may = tuple(f"{name}_{joint}" for name in ("dq", "q_ref", "temp") for joint in rig.joints)
    imus = tuple(f"{kind}_{link}_x/y/z" for link in rig.config.imus for kind in ("gyro", "accel"))
    return Checked(
        rig=rig,
        camera_frame=rig.camera_frame,
        mount=rig.config.mount,
        imus=rig.config.imus,
        joints=joints,
        identifiable=len(compute_base(rig).terms),
        columns=need,
        optional=may + imus,
        warnings=(*rig.notes, *_warn_of_joints(joints)),
    )


def list_bundled() -> dict[str, Any]:
    """Return the bundled rigs and payloads with their descriptions, as JSON holds them."""
    bodies = {name: find_rig(name)[1] for name in bundled_rigs()}
    loads = {
        name: load_config(find_payload(name).with_suffix(".yaml")) for name in bundled_payloads()
    }
    return {
        "schema": 1,
        "rigs": {
            name: {"payload": rig.payload, "description": rig.description}
            for name, rig in bodies.items()
        },
        "payloads": {name: {"description": config.description} for name, config in loads.items()},
    }


def spread_poses(rig: Rig, count: int = CHECKED_POSES) -> Array:
    """Poses that fill the joints' limits evenly, a whole turn where there are none, rad, (count, n)."""
    lower = np.array([max(limit.lower, -np.pi) for limit in rig.limits])
    upper = np.array([min(limit.upper, np.pi) for limit in rig.limits])
    unit = spread_states(rig, count)[0] / (2 * np.pi) + 0.5
    return np.asarray(lower + unit * (upper - lower))


def compute_gravity_load(rig: Rig) -> Array:
    """Largest gravity torque per joint over poses that fill the limits evenly, N m, (n,)."""
    q = spread_poses(rig)
    return np.asarray(np.abs(compute_rnea(rig, q, np.zeros_like(q), np.zeros_like(q))).max(axis=0))


def _warn_of_joints(joints: Mapping[str, JointCheck]) -> list[str]:
    """Return a sentence for each joint that its motor can hardly hold, or whose torque nobody limits."""
    out = []
    for name, joint in joints.items():
        share = joint.gravity_torque / joint.tau_max
        if share > 0.5:
            mend = (
                "balance the payload"
                if share < 1
                else "correct mass (kg), centre (m) or torque limit (N m), or balance"
            )
            out.append(
                f"{name}: gravity takes up to {100 * share:.0f} % of the motor's torque: {mend}"
            )
        if np.isinf(joint.tau_max):
            out.append(
                f"{name}: no torque limit is stated: give effort in the URDF or tau_max in the YAML"
            )
    return out
