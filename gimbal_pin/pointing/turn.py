"""How the camera turns to where it shall look: a way that its joints' motors and limits allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from gimbal_pin.control.laws.design import BRAKES, spare_torque
from gimbal_pin.control.laws.uncertainty import UNLIMITED_RATE, compute_inertia, sample_poses
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.rig.brief import brief


class Gaze(NamedTuple):
    """Where the camera should look at one moment.

    Attributes:
        R: Attitude in the world, (3, 3).
        w: Its rate, in its own frame, rad/s, (3,).
        dw: Its angular acceleration, in its own frame, rad/s², (3,).
    """

    R: Array
    w: Array
    dw: Array

    @staticmethod
    def still(R: Array) -> Gaze:
        """An attitude that is kept."""
        return Gaze(R, np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Turn:
    """``q(t) = q_1 + (σ(t) - 1) Δ``, as seen from the world on the base of the start.

    The straight way of the joints stays within their limits, wherever it begins. σ̇ rises as 3x² - 2x³, x from 0 to 1
    along the ramp, is constant, and falls so again: σ̈ does not jump.

    Attributes:
        base: Attitude of the base link in the world at the start, (3, 3).
        goal: q_1, angles at which the camera looks as wanted from there, rad, (n,).
        way: Δ, from the angles at the start to those, rad, (n,).
        begun: Time of the start, s.
        rate: Largest σ̇, 1/s.
        ramp: Time in which it is reached, s.
    """

    base: Array
    goal: Array
    way: Array
    begun: float
    rate: float
    ramp: float

    @property
    def end(self) -> float:
        """Time at which the camera looks as wanted, s."""
        return self.begun + 1 / self.rate + self.ramp

    def progress(self, t: float) -> tuple[float, float, float]:
        """σ - 1, σ̇ and σ̈ at a time."""
        since = max(t - self.begun, 0.0)
        left = max(self.end - t, 0.0)
        near = min(since, left)
        x = min(near / self.ramp, 1.0)
        way = self.rate * (self.ramp * x**3 * (1 - x / 2) + max(near - self.ramp, 0.0))
        speed = self.rate * x**2 * (3 - 2 * x)
        swing = self.rate / self.ramp * 6 * x * (1 - x)
        return (way - 1, speed, swing) if since < left else (-way, speed, -swing)

    def stopped(self, t: float) -> Turn:
        """Return the way that comes to rest from a time on, as it would at its end."""
        x = min(max(t - self.begun, 0.0) / self.ramp, (self.end - t) / self.ramp, 1.0)
        left = self.progress(t)[0] + self.rate * self.ramp * x**3 * (1 - x / 2)
        return replace(
            self, goal=self.goal + left * self.way, begun=self.begun + t + self.ramp * x - self.end
        )

    def gaze(self, t: float, sight: Sight) -> Gaze:
        """Return where the camera should look at a time."""
        left, speed, swing = self.progress(t)
        q = self.goal + left * self.way
        v = speed * self.way
        still = np.zeros(3)
        drift = sight.drift(q, v, still, still)
        driven = sight.rate(q, swing * self.way, still)
        return Gaze(self.base.dot(sight.attitude(q)), sight.rate(q, v, still), drift + driven)


@dataclass(frozen=True, eq=False)
class Pace:
    """How fast joints may turn.

    Attributes:
        rates: Largest rates, rad/s, (n,).
        torques: Torques that every motor surely has for it, N m, (n,).
        inertias: Largest inertias of any pose, their entries without sign, kg m², (n, n).
        near: Way of a joint up to which the loop answers as it does to any error, rad.
        ramp: Time in which a turn becomes fast at least, s: slower than any loop here, so that none is excited.
    """

    rates: Array
    torques: Array
    inertias: Array
    near: float = 1e-3
    ramp: float = 0.1

    __repr__ = brief

    @staticmethod
    def of(model: Model, share: float = 0.98, least: float = 0.1) -> Pace:
        """Return `share` of the rig's rates, and `BRAKES` of what gravity and friction leave at the worst pose.

        Args:
            model: The model.
            share: The rest of a rate is what the loop corrects on top.
            least: Share of a torque limit that is left where a motor hardly holds its load at some pose.
        """
        q = sample_poses(model.rig)[0]
        rates = share * np.array(
            [min(limit.velocity, UNLIMITED_RATE) for limit in model.rig.limits]
        )
        torques = np.maximum(BRAKES * spare_torque(model, q).min(axis=0), least * model.tau_max)
        return Pace(rates, torques, np.abs(compute_inertia(model, q)).max(axis=0))

    def turn(self, sight: Sight, base: Array, q: Array, wanted: Array, t: float) -> Turn | None:
        """Return the way from angles to a wanted attitude; None where there is none to go.

        Args:
            sight: Kinematics of the camera.
            base: Attitude of the base link in the world, (3, 3).
            q: Angles, rad, (n,).
            wanted: Attitude in the world, (3, 3).
            t: Time, s.
        """
        goal = sight.reached(base, wanted, sight.home)
        way = goal - q
        size = np.abs(way)
        if not size.max() > self.near:
            return None
        quickest = (self.rates / size).min()
        hardest = (self.torques / self.inertias.dot(size)).min()
        rate = min(quickest, sqrt(hardest / 1.5), 1 / self.ramp)
        return Turn(base, goal, way, t, float(rate), float(max(1.5 * rate / hardest, self.ramp)))
