"""What a motion must keep to: angle, rate, acceleration and torque, with a margin."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite, pi
from typing import NamedTuple

import numpy as np

from gimbal_pin.dynamics.configurations import fill_angle_limits, fill_limits, fill_rate_limits
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation.adjoint import differentiate_rnea, differentiate_samples
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.rig import Rig

QUANTITIES = ("q", "dq", "ddq", "tau")
LARGEST_RATE = 100.0
LARGEST_TORQUE = 1000.0
LARGEST_TRAVEL = 4 * pi
"""A rate, rad/s, a torque, N m, and a travel to either side, rad, that no camera gimbal has: who writes more fills in
a form."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """``|q - centre| <= half, |v| <= velocity, |a| <= acceleration, |tau| <= torque`` per joint, (n,) each, SI.

    A rate or acceleration without a limit stays free: the angle's limit bounds both in a finite Fourier series
    (Bernstein: ``|v| <= L w half``, ``|a| <= (L w)^2 half``), and the torque does the rest.
    """

    centre: Array
    half: Array
    velocity: Array
    acceleration: Array
    torque: Array

    @staticmethod
    def of(rig: Rig, margin: float = 0.0) -> Envelope:
        """The rig's limits, each but for the share `margin`.

        Angle limits that are not stated are those of `fill_angle_limits`.

        Raises:
            UsageError: The margin is not in [0, 1), or a joint is left with no room to move.
        """
        if not 0 <= margin < 1:
            raise UsageError(
                "margin", f"is {margin}", "give a share of the limits from 0 up to under 1"
            )
        ends = np.array([fill_angle_limits(rig, j, limit) for j, limit in enumerate(rig.limits)])
        limits = {
            "travel": (ends[:, 1] - ends[:, 0]) / 2,
            "velocity limit": np.array([limit.velocity for limit in rig.limits]),
            "acceleration limit": np.array([limit.acceleration for limit in rig.limits]),
            "torque limit": rig.tau_max,
        }
        for name, values in limits.items():
            for joint, value in zip(rig.joints, values):
                if not value > 0:
                    place = f"rig {rig.name}: joint '{joint}'"
                    raise UsageError(place, f"has a {name} of {value:g}", "widen its limits")
        return Envelope(ends.mean(axis=1), *(values * (1 - margin) for values in limits.values()))

    @property
    def kinematic(self) -> Array:
        """Limits of the angle from the centre, the rate and the acceleration, (3, n)."""
        return np.stack([self.half, self.velocity, self.acceleration])

    @property
    def pace(self) -> Array:
        """Rate limits, (n,); where none is stated: what half a hertz over the full travel takes."""
        return fill_rate_limits(self.half, self.velocity)

    def spread(self) -> Motion:
        """States spread evenly over the limits, always the same ones, (N, n); no motion in time: see `fill_limits`."""
        return fill_limits(self.centre, self.half, self.velocity, self.acceleration)

    def compute_kinematic_shares(self, motion: Motion) -> Array:
        """Angle from the centre, rate and acceleration as shares of their limits, signed, (3, N, n)."""
        return np.stack(
            [
                (motion.q - self.centre) / self.half,
                motion.v / self.velocity,
                motion.a / self.acceleration,
            ]
        )

    def compute_torque_shares(self, model: Model, motion: Motion) -> Array:
        """Largest torque up and down as shares of the limit, (2, N, n), whichever way dry friction pushes."""
        return (
            np.stack([sign * self._push(model, motion, sign) for sign in (1.0, -1.0)]) / self.torque
        )

    @staticmethod
    def _push(model: Model, motion: Motion, sign: float) -> Array:
        """The model's torque with all dry friction in one direction, N m, (N, n)."""
        return model.inverse_dynamics(
            motion.q, motion.v, motion.a, np.full_like(motion.q, sign), motion.t
        )

    def differentiate_torque_shares(self, model: Model, motion: Motion) -> Array:
        """Derivative of `compute_torque_shares` of each joint to each joint's q, v, a, (2, 3, N, n, n).

        ``tau = rnea + passive(tau)``, hence ``d tau = (d rnea + d passive) / (1 - d passive/d tau)``; what a
        term reads of the weight changes with every joint's angle.
        """
        rigid = differentiate_rnea(model.rig.model, motion)
        out = []
        still = replace(motion, v=np.zeros_like(motion.v), a=np.zeros_like(motion.a))
        weight = model.weight(motion.q)
        for sign in (1.0, -1.0):

            def passive(
                q: Array, v: Array, a: Array, tau: Array, weight: Array, sign: float = sign
            ) -> Array:
                return model.passive(q, v, a, np.full_like(q, sign), tau, motion.t, weight=weight)

            at = [motion.q, motion.v, motion.a, self._push(model, motion, sign), weight]
            *own, per_tau, per_weight = differentiate_samples(passive, at)
            change = np.stack(own)[..., None] * np.eye(model.rig.n)
            if per_weight.any():
                change[0] += per_weight[..., None] * differentiate_rnea(model.rig.model, still)[0]
            out.append(sign * (rigid + change) / (1 - per_tau)[..., None])
        return np.stack(out) / self.torque[:, None]

    def find_largest_shares(self, model: Model, motion: Motion) -> Array:
        """Largest share of each limit that a motion uses, rows as `QUANTITIES`, (4, n); 0 where there is no limit."""
        used = np.swapaxes(self.compute_kinematic_shares(motion), 0, 1)
        kinematic = np.maximum(find_crest(used), find_crest(-used))
        torque = find_crest(np.swapaxes(self.compute_torque_shares(model, motion), 0, 1)).max(
            axis=0
        )
        return np.vstack([kinematic, np.maximum(torque, 0.0)])


def find_crest(x: Array) -> Array:
    """Largest value of smooth functions that are sampled evenly, (N, ...) → (...).

    Between samples a crest rises to the vertex of the parabola through the three around it,
    ``x_0 - (x_1 - x_-1)^2 / 8 (x_1 - 2 x_0 + x_-1)``.
    """
    before = x[:-2]
    middle = x[1:-1]
    after = x[2:]
    is_crest = (middle >= before) & (middle >= after) & (middle > np.minimum(before, after))
    bend = np.where(is_crest, before - 2 * middle + after, -1.0)
    vertex = np.where(is_crest, middle - (after - before) ** 2 / (8 * bend), -np.inf)
    return np.asarray(np.concatenate([x, vertex]).max(axis=0))


class AssumedLimit(NamedTuple):
    """A limit that a motion keeps to though nobody states it.

    Attributes:
        joint: The joint.
        quantity: As `--limit` and a YAML name it: velocity, acceleration, lower or upper.
        value: What is assumed.
        unit: Its unit.
        stated: What the rig states instead: infinite, or more than any gimbal has.
    """

    joint: str
    quantity: str
    value: float
    unit: str
    stated: float


def assume_limits(
    rig: Rig, speed: float = 0.25, travel: float = 0.25
) -> tuple[Rig, tuple[AssumedLimit, ...]]:
    """Return the rig with safe limits where nothing, or nothing plausible, bounds a joint's rate or torque.

    Rate: no point of the rig passes `speed`, with all joints turning at once. Acceleration, where no torque limit
    bounds it: that of half a hertz at the rate limit. Such a joint is moved by `travel` about its zero, or what of its
    own travel is nearest to that. One of over two turns either way counts as none.

    Args:
        rig: The rig.
        speed: Of a machine with people within its reach, m/s: the manual reduced speed of ISO 10218-1.
        travel: To either side, rad, 14°; a tenth of that in metres for a slide.
    """
    reach = compute_joint_reach(rig)
    limits = []
    assumed = list[AssumedLimit]()
    for j, (joint, limit) in enumerate(zip(rig.joints, rig.limits)):
        safe = replace(limit)
        if not rig.slides[j] and max(-limit.lower, limit.upper) > LARGEST_TRAVEL:
            safe = replace(safe, lower=-inf, upper=inf)
        if limit.velocity > LARGEST_RATE:
            safe = replace(safe, velocity=speed / (rig.n * (1.0 if rig.slides[j] else reach[j])))
        if rig.tau_max[j] > LARGEST_TORQUE and not isfinite(limit.acceleration):
            safe = replace(safe, acceleration=pi * safe.velocity)
        if safe.velocity != limit.velocity or safe.acceleration != limit.acceleration:
            lower, upper = fill_angle_limits(rig, j, safe)
            half = min(travel * (0.1 if rig.slides[j] else 1.0), (upper - lower) / 2)
            middle = min(max(0.0, lower + half), upper - half)
            safe = replace(safe, lower=middle - half, upper=middle + half)
            for quantity, unit in (
                ("velocity", "rad/s"),
                ("acceleration", "rad/s²"),
                ("lower", "rad"),
                ("upper", "rad"),
            ):
                value = getattr(safe, quantity)
                stated = getattr(limit, quantity)
                if value != stated:
                    assumed.append(
                        AssumedLimit(joint, quantity, value, rig.in_units(joint, unit), stated)
                    )
        limits.append(safe)
    return (replace(rig, limits=tuple(limits)) if assumed else rig), tuple(assumed)


def compute_joint_reach(rig: Rig) -> Array:
    """Farthest that what a joint carries can be from its axis, m, (n,): outwards along the chain, in whatever pose.

    A body reaches as far from its centre of mass as a rod of its radius of gyration: √3 of that.
    """
    model = rig.model
    reach = np.zeros(rig.n + 1)
    for j in range(rig.n, 0, -1):
        body = model.inertias[j]
        radius = np.sqrt(1.5 * np.trace(body.inertia) / body.mass)
        slid = (
            max(map(abs, (rig.limits[j - 1].lower, rig.limits[j - 1].upper)))
            if rig.slides[j - 1]
            else 0.0
        )
        reach[j] = max(reach[j], np.linalg.norm(body.lever) + radius) + (
            slid if isfinite(slid) else 0.0
        )
        parent = model.parents[j]
        reach[parent] = max(
            reach[parent], np.linalg.norm(model.jointPlacements[j].translation) + reach[j]
        )
    return reach[1:]
