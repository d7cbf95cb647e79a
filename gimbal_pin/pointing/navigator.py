"""From the sensors to the camera's attitude, the platform's motion, and where the joints should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.control.aim import Ahead, Aim, Carried
from gimbal_pin.log import Array
from gimbal_pin.pointing.predictor import Predictor
from gimbal_pin.pointing.seen import Seen
from gimbal_pin.pointing.sight import Sight, View

ErrorFrom = Literal["camera", "platform"]
"""Whose gyro tells the attitude: the camera's own, or the platform's with the encoders between."""
RATE = (4, 30.0)
"""Order and bandwidth, Hz, of the filter on the platform's rate."""
FORCE = (2, 30.0)
"""The same on its specific force."""


class Known(NamedTuple):
    """What navigation remembers.

    Attributes:
        R: Attitude in the world of the camera, or of the platform where that is what is integrated, (3, 3).
        turning: The rate that was integrated last, rad/s, (3,).
        rate: States of the filter on the platform's rate.
        force: States of the filter on its specific force.
        v: Joint rates, rad/s, (n,).
    """

    R: Array
    turning: Array
    rate: Array
    force: Array
    v: Array


class Fix(NamedTuple):
    """Angles, rates and aim at one sample.

    Attributes:
        q: Measured angles, rad, (n,).
        v: Joint rates from the gyros, rad/s, (n,).
        aim: Where the joints should be.
        steep: Whether the camera stands near a singular pose.
    """

    q: Array
    v: Array
    aim: Aim
    steep: bool


@dataclass(frozen=True, eq=False)
class Navigator:
    """Inverse kinematics of a fixed attitude from what the sensors say.

    ``q̇ = J⁻¹(ω_c - Rᵀ ω)``, ``e = J⁻¹ log(Rᵀ R_d)``, ``ė = -J⁻¹ ω_c``, ``q̇_d = q̇ + ė``, and
    ``q̈_d = -J⁻¹ α(q, q̇_d, ω, ω̇)`` with α the camera's angular acceleration while the joints do not accelerate.

    Attributes:
        sight: Kinematics of the camera.
        wanted: R_d, the camera's attitude in the world, (3, 3).
        dt: Sampling interval, s.
        leads: Times ahead at which the model is evaluated, s: one per distinct lead of the drives; zero: now.
        source: Whose gyro tells the attitude.
        accelerates: False takes no wanted acceleration from inverse kinematics.
        oracle: The platform's true motion ahead is known, not predicted.
        rate: Order and bandwidth of the filter on the platform's rate.
        force: The same on its specific force.
    """

    sight: Sight
    wanted: Array
    dt: float
    leads: tuple[float, ...] = (0.0,)
    source: ErrorFrom = "camera"
    accelerates: bool = True
    oracle: bool = False
    rate: tuple[int, float] = field(default=RATE)
    force: tuple[int, float] = field(default=FORCE)

    @cached_property
    def filters(self) -> tuple[Predictor, Predictor]:
        """The filters on the platform's rate and on its specific force."""
        return Predictor(*self.rate, self.dt), Predictor(*self.force, self.dt)

    @cached_property
    def weights(self) -> tuple[tuple[Array, Array], ...]:
        """Per lead, the weights of the states that give rate and angular acceleration, (2, order), and force."""
        rate, force = self.filters
        return tuple((np.array([rate.row(x), rate.row(x, 1)]), force.row(x)) for x in self.leads)

    def start(self, seen: Seen, camera: Array, base: Array) -> Known:
        """Memory at the first sample, where the attitudes in the world of camera and base link are known, (3, 3)."""
        rate, force = self.filters
        own, turning = (camera, seen.gyro) if self.source == "camera" else (base, seen.w)
        return Known(own, turning, rate.start(seen.w), force.start(seen.f), np.zeros(len(seen.q)))

    def fix(self, seen: Seen, known: Known) -> tuple[Fix, Known]:
        """Return where the joints are and should be, and the next memory."""
        turning = seen.gyro if self.source == "camera" else seen.w
        R = known.R @ pin.exp3((known.turning + turning) * (self.dt / 2))
        rate, force = self.filters
        rates, forces = rate.step(known.rate, seen.w), force.step(known.force, seen.f)
        view = self.sight.view(seen.q)
        v = view.inverse @ (seen.gyro - view.R.T @ seen.w)[self.sight.rows]
        actual = R if self.source == "camera" else R @ view.R
        error = view.inverse @ self.sight.error(actual, self.wanted)
        drop = view.inverse @ seen.gyro[self.sight.rows]
        ahead = self.ahead(seen, view, v, rates, forces)
        aim = Aim(seen.q + error, v - drop, ahead[0].a, ahead)
        return Fix(seen.q, v, aim, view.steep), Known(R, turning, rates, forces, v)

    def ahead(self, seen: Seen, view: View, v: Array, rates: Array, forces: Array) -> tuple[Ahead, ...]:
        """Return where the model is to be evaluated, for every lead."""
        out = []
        for lead, (weights, force) in zip(self.leads, self.weights):
            if self.oracle and seen.true is not None:
                base = seen.true
            else:
                w, dw = weights @ rates
                base = Carried(force @ forces, w, dw)
            q, there = (seen.q + lead * v, view) if lead else (seen.q, view)
            if lead:
                there = self.sight.view(q)
            out.append(self.wished(q, there, base))
        return tuple(out)

    def wished(self, q: Array, view: View, base: Carried) -> Ahead:
        """Return the joints' rates and accelerations that keep the camera's attitude on a platform that moves so."""
        v = -view.inverse @ (view.R.T @ base.w)[self.sight.rows]
        if not self.accelerates:
            return Ahead(q, v, np.zeros_like(q), base)
        a = -view.inverse @ self.sight.drift(q, v, base.w, base.dw)
        return Ahead(q, v, a, base)


def attitude(yaw: float, pitch: float, roll: float = 0.0) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)``, rad → (3, 3)."""
    return np.asarray(pin.rpy.rpyToMatrix(roll, pitch, yaw))


def carried(row: Sequence[float]) -> Carried:
    """Return a platform's motion from its rate, specific force and angular acceleration in one row, (9,)."""
    return Carried(row[3:6], row[:3], row[6:9])
