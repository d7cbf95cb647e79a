"""Balance: how far to slide the camera, what gravity torque that saves, and whether the motors hold it as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.dynamics.checking import spread_poses
from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.effects.rig_effect import describe_way, find_camera_axes, get_payload
from gimbal_pin.errors import NORMAL_95, UsageError, digits
from gimbal_pin.identification.difference import BaseDifference
from gimbal_pin.log.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.rig import PHI

COUNT = 400
"""Poses over which gravity is balanced."""
BALANCE_RANK = 1e-6
"""A direction that moves less gravity torque than this share of the most cannot be balanced by."""
MINIMISED = (
    f"that way gravity's torque over the motors' limits is least, mean square over all joints and {COUNT} poses that "
    "fill the rig's limits: one joint may take more than before, for another's sake"
)
"""What the way is the best for."""
WORTH = 1e-4
"""A way shorter than this, m, is nothing that a hand can slide."""
TIGHT = 0.5
"""Share of a motor's torque from which gravity leaves it too little to move with."""


class KnownMass(NamedTuple):
    """A payload's mass that is not its URDF's.

    Attributes:
        value: kg.
        std: Its standard deviation, kg, which may hold more than `gain` makes of the base parameters' own.
        is_weighed: Whether it was given beside the log, else identified.
        gain: Its change per change of the base parameters, (b,); zero where it was weighed.
    """

    value: float
    std: float
    is_weighed: bool
    gain: Array


@dataclass(frozen=True, eq=False)
class Balance:
    """The result of `compute_balance`.

    Attributes:
        way: How far to slide the payload forward, left and up, m, (3,); zero along what gravity does not show.
        std: Standard deviations, m, (3,).
        mass: Mass of the payload that the way stands on, kg.
        source: Whose that is: "identified", "weighed", or its URDF's where it does not show, "stated".
        before: Joint → largest gravity torque over its poses as it is, N m.
        after: The same once the payload has been slid.
        available: Joint → torque of its motor, N m.
        forces: Joint → unit of these: N of one that slides.
    """

    way: Array
    std: Array
    mass: float
    source: str
    before: Mapping[str, float]
    after: Mapping[str, float]
    available: Mapping[str, float]
    forces: Mapping[str, str]

    @property
    def held(self) -> Mapping[str, float]:
        """Joint → share of the motor's torque that gravity takes as it is, at most."""
        return {joint: self.before[joint] / self.available[joint] for joint in self.before}

    @property
    def sentences(self) -> tuple[str, ...]:
        """How to balance it, what that saves, and whether the motors hold it unbalanced."""
        return self.how(), MINIMISED, self.holding()

    def how(self) -> str:
        """Say how far to slide it, and what that saves."""
        clear = np.where(np.abs(self.way) > np.maximum(2 * self.std, WORTH), self.way, 0.0)
        if not clear.any():
            most = 1e3 * float(np.max(np.abs(self.way) + 2 * self.std))
            return f"the payload is balanced, to {digits(most, 2)} mm"
        joint = max(self.before, key=lambda name: self.before[name] - self.after[name])
        std = 1e3 * max(float(self.std[clear != 0].max()), 1e-5)
        after = digits(self.after[joint], 2)
        before = digits(self.before[joint], 2)
        saved = f"gravity then takes {after} instead of {before} {self.forces[joint]} at {joint}"
        way = f"{describe_way(clear)} (± {digits(NORMAL_95 * std, 1)} mm"
        open_ = "the stated {}, which the log does not show: half as far if it weighs twice that"
        of = {"stated": open_, "weighed": "the {} that were weighed"}.get(self.source, "its {}")
        mass = of.format(f"{digits(1e3 * self.mass, 4)} g")
        return f"to balance the payload, slide it {way} at {mass}): {saved}"

    def holding(self) -> str:
        """Say whether the motors hold it as it is."""
        joint = max(self.held, key=lambda name: self.held[name])
        share = self.held[joint]
        if not np.isfinite(self.available[joint]) or share == 0:
            return f"unbalanced, gravity takes up to {digits(self.before[joint], 2)} {self.forces[joint]} at {joint}"
        taken = f"gravity takes up to {digits(100 * share, 2)} % of {joint}'s torque"
        if share >= 1:
            return f"unbalanced, the motors cannot hold it: {taken}"
        return f"unbalanced, the motors hold it{', with little left to move it' if share > TIGHT else ''}: {taken}"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds: millimetres forward, left and up."""
        return {
            "slide_mm": (1e3 * self.way).tolist(),
            "std_mm": (1e3 * self.std).tolist(),
            "stated_mass": 1e3 * self.mass,
            "mass_source": self.source,
            "moment_kg_mm": (1e3 * self.mass * self.way).tolist(),
            "gravity_torque_before": dict(self.before),
            "gravity_torque_after": dict(self.after),
            "share_of_motor": dict(self.held),
            "holds_unbalanced": all(share < 1 for share in self.held.values()),
            "sentence": "; ".join(self.sentences),
        }


def compute_balance(found: BaseDifference, mass: KnownMass | None = None) -> Balance | None:
    """``argmin_s Σ_q ‖W (G(q) + S(q) s)‖²`` over poses q within the limits; None where no payload is mounted.

    G = Y(q) β is gravity with the identified base parameters, S its change per way s of the payload, in proportion to
    its mass, W one over the motors' torque. Deviations are of β and of a mass that follows from it, together.

    Args:
        found: The gimbal with the payload.
        mass: The payload's mass; None: the stated one.
    """
    rig = found.rig
    try:
        body, inertia, _ = get_payload(rig)
    except UsageError:
        return None
    q = spread_poses(rig, COUNT)
    still = np.zeros_like(q)
    full = compute_regressor(rig, q, still, still)
    gravity = full[:, :, find_base_columns(rig, found.reduction)]
    moments = [10 * body + PHI.index(symbol) for symbol in ("mx", "my", "mz")]
    weighs = float(inertia.mass) if mass is None else mass.value
    per_way = weighs * full[:, :, moments] @ find_camera_axes(rig)
    limit = np.where(np.isfinite(rig.tau_max), rig.tau_max, 1.0)[:, None]
    inverse = np.linalg.pinv((per_way / limit).reshape(-1, 3), rcond=BALANCE_RANK)
    beta = found.refitted
    gain = -inverse @ (gravity / limit).reshape(-1, len(beta))
    way = gain @ beta
    loads = gravity @ beta, gravity @ beta + per_way @ way
    before, after = (dict(zip(rig.joints, np.abs(x).max(axis=0).round(9).tolist())) for x in loads)
    slope, own = (np.zeros(len(beta)), 0.0) if mass is None else (mass.gain, mass.std**2)
    per_beta = gain - np.outer(way / weighs, slope)
    more = max(own - float(slope @ found.covariance @ slope), 0.0)
    std = np.sqrt(
        np.maximum(np.diag(per_beta @ found.covariance @ per_beta.T), 0.0)
        + more * (way / weighs) ** 2
    )
    source = "stated" if mass is None else "weighed" if mass.is_weighed else "identified"
    available = dict(zip(rig.joints, rig.tau_max.tolist()))
    forces = {j: rig.in_units(j, "N m") for j in rig.joints}
    return Balance(way, std, weighs, source, before, after, available, forces)
