"""What a recorded motion asks of a rig's motors, and the jitter that their limits leave whoever controls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear

from gimbal_pin.cli.inputs import read_platform
from gimbal_pin.control.laws.uncertainty import compute_inertia
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import WANTED, unbalance_payload
from gimbal_pin.pointing.result import SETTLING
from gimbal_pin.pointing.sight import Sight, holding
from gimbal_pin.rig.rig import Rig

AFTER = 0.6
"""After a moment at which a motor is too weak, for how long the loop may have to find back, s."""
READY = 0.3
"""How long before such a moment a controller that foresees it may begin to make ready, s."""
RATE = 250.0
"""Samples of a motion that are looked at, Hz."""


@dataclass(frozen=True, eq=False)
class Demand:
    """Torque that holds the camera exactly along a motion, beside what the motors give.

    Attributes:
        joints: Joint names.
        t: Time, s, (N,).
        tau: Torque, N m, (N, n).
        tau_max: Largest torque of each motor, N m, (n,).
        answer: Angular acceleration of the line of sight per torque of each joint, 1/(kg m²), (N, n).
    """

    joints: tuple[str, ...]
    t: Array
    tau: Array
    tau_max: Array
    answer: Array

    @staticmethod
    def of(plant: Model, wanted: Array, platform: Platform) -> Demand:
        """Return it for a plant whose camera looks as wanted, (3, 3): inverse dynamics of the exact motion."""
        step = max(1, round(1 / RATE / float(platform.t[1] - platform.t[0])))
        part = platform.part(slice(None, None, step))
        rig = plant.rig
        sight = Sight(rig)
        held = holding(sight, wanted, part)
        across = np.array([np.linalg.norm(sight.view(q).J[-2:], axis=0) for q in held.q])
        own = np.diagonal(compute_inertia(plant, held.q), axis1=1, axis2=2)
        tau = plant.inverse_dynamics(held.q, held.v, held.a, platform=part)
        return Demand(rig.joints, part.t, tau, rig.tau_max, across / own)

    @property
    def peak(self) -> Mapping[str, float]:
        """Joint → largest torque, N m."""
        return dict(zip(self.joints, np.abs(self.tau).max(axis=0).tolist()))

    @property
    def weak(self) -> tuple[str, ...]:
        """Joints whose motors give less than that."""
        limits = zip(self.peak.items(), self.tau_max.tolist())
        return tuple(joint for (joint, peak), limit in limits if peak > limit)

    @property
    def moments(self) -> tuple[tuple[float, float], ...]:
        """First and last time of every moment at which a motor is too weak, s; those `AFTER` s apart are one."""
        times = self.t[(np.abs(self.tau) > self.tau_max).any(axis=1)]
        parts = np.split(times, np.flatnonzero(np.diff(times) > AFTER) + 1) if len(times) else []
        return tuple((float(part[0]), float(part[-1])) for part in parts)

    @cached_property
    def least(self) -> Mapping[str, float]:
        """Jitter that the torque limits alone leave, rad rms, "unforeseen" and "foreseen"; nan where it takes too long.

        A controller that does not foresee the motion does nothing before a moment begins; one that does makes ready.
        """
        counts = self.t >= self.t[0] + SETTLING
        out = {}
        for name in ("unforeseen", "foreseen"):
            parts = [self.left(rows, j, name == "foreseen") for rows, j in self.stretches]
            power = sum(
                [
                    float(np.sum(part[counts[rows]] ** 2))
                    for part, (rows, _) in zip(parts, self.stretches)
                ]
            )
            out[name] = float(np.sqrt(power / max(1, int(counts.sum()))))
        return out

    @property
    def stretches(self) -> list[tuple[slice, int]]:
        """Samples around every moment, and the joint whose motor is too weak in it."""
        edges = [
            (np.searchsorted(self.t, [first - READY, last + AFTER])).tolist()
            for first, last in self.moments
        ]
        beyond = np.abs(self.tau) > self.tau_max
        return [
            (slice(a, b), j)
            for a, b in edges
            for j in np.flatnonzero(beyond[a:b].any(axis=0)).tolist()
        ]

    def left(self, rows: slice, j: int, foreseen: bool) -> Array:
        """Least error of the line of sight over some samples by a joint's weak motor, rad."""
        asked = self.tau[rows, j]
        limit = float(self.tau_max[j])
        if len(asked) > LONGEST_STRETCH:
            return np.full(len(asked), np.nan)
        known = 0 if foreseen else int(np.argmax(np.abs(asked) > limit))
        return least(float(self.t[1] - self.t[0]), asked, limit, self.answer[rows, j], known)


LONGEST_STRETCH = 600
"""Samples of the longest stretch that is worked out, in about a second."""


def least(dt: float, asked: Array, limit: float, answer: Array, first: int) -> Array:
    """``min Σ e²`` over all torques within the limit, ``ë = b (τ - τ_d)``: a bounded least-squares problem.

    No law of any kind gets below it, unless other joints turn the camera in this one's stead, which tilts the horizon:
    each of them is granted all the torque that it takes to stay.

    Args:
        dt: Sampling interval, s.
        asked: τ_d, torque that follows the motion exactly, N m, (N,).
        limit: Largest torque, N m.
        answer: b, acceleration of what is to be kept still, per torque, 1/(kg m²), (N,).
        first: Sample before which nothing is foreseen, so that e is zero until then; 0: the whole motion is known.

    Returns:
        The error at the end of every interval, rad, (N,).
    """
    n = len(asked)
    summed = np.tril(np.ones((n, n)))
    # Torque that may not act before `first` is no unknown of the problem.
    moved = (dt**2 * (summed @ summed - summed / 2) * answer)[:, first:]
    bounds = -limit - asked[first:], limit - asked[first:]
    found = lsq_linear(moved, np.zeros(n), bounds, tol=1e-12)
    return np.asarray(moved @ found.x)


def main(rig: str, log: Path, maps: tuple[str, ...] = (), payload: str | None = None) -> None:
    """Print each motor's largest torque beside its limit, the moments beyond it, and the least jitter.

    Args:
        rig: A rig.
        log: A recorded motion: gyro and accelerometer of its base link.
        maps: Columns of the log, as for `gimbal-pin track --map`.
        payload: Its payload.
    """
    loaded = Rig.load(rig, payload)
    motion = read_platform(loaded, "none", log, maps)
    found = Demand.of(
        nominal(unbalance_payload(loaded)), WANTED, motion.about(Sight(loaded).centre)
    )
    for joint, limit in zip(found.joints, found.tau_max.tolist()):
        print(f"{joint}: up to {found.peak[joint]:.3g} N m of {limit:g}")
    print(
        "beyond it:",
        ", ".join(f"{first:.2f} to {last:.2f} s" for first, last in found.moments) or "never",
    )
    if found.moments:
        print(
            "least jitter, deg rms:",
            ", ".join(f"{what} {degrees(x):.4f}" for what, x in found.least.items()),
        )
