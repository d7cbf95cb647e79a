"""Several gyros and the encoders between them: less noise in the camera's attitude than its own gyro has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from math import sqrt
from operator import add
from typing import NamedTuple

import pinocchio as pin

from gimbal_pin.log import Array


class Fused(NamedTuple):
    """What fusion remembers, one entry per other gyro.

    Attributes:
        attitudes: Attitudes in the world, each integrated from its own gyro, (3, 3).
        turning: The rates that were integrated last, rad/s, (3,).
        gaps: What they make of the camera's attitude less what its own gyro makes of it, smoothed, rad, (3,).
    """

    attitudes: tuple[Array, ...]
    turning: tuple[Array, ...]
    gaps: tuple[Array, ...]


@dataclass(frozen=True)
class Fusion:
    """``R̂ = R exp(Σ ŷ_i / M)``, ``ŷ_i⁺ = ŷ_i + k (log(Rᵀ R_i R_ic(q)) - ŷ_i)``: the mean of M gyros' attitudes.

    The camera's own motion is in none of the gaps y: they hold the gyros' noise alone, which walks, and the encoders',
    which is white. So k, Kalman's gain for that, may be as slow as it likes: it is in no loop, and costs no margin.

    Attributes:
        gyro: Density of the gyros' noise, rad/s/√Hz.
        step: Angle of one encoder step, rad.
        dt: Sampling interval, s.
    """

    gyro: float
    step: float
    dt: float

    @cached_property
    def gain(self) -> float:
        """k: of a walk whose steps are two gyros' noise over a sample, seen with an encoder's rounding."""
        walk, white = self.gyro**2 * self.dt, max(self.step, 1e-9) ** 2 / 12
        ratio = walk / white
        return float((sqrt(ratio**2 + 4 * ratio) - ratio) / 2)

    def step_on(
        self, memory: Fused, rates: Sequence[Array], camera: Array, between: Sequence[Array], elapsed: float
    ) -> tuple[Array, Array, Fused]:
        """Return what to turn the camera's attitude by, rad, what to add to its rate, rad/s, (3,) each, and the memory.

        Args:
            memory: The memory.
            rates: Readings of the other gyros, rad/s, (3,) each.
            camera: Attitude that the camera's own gyro gives, (3, 3).
            between: Attitude of the camera in each other gyro's link, (3, 3).
            elapsed: Time since the last sample, s.
        """
        half = elapsed / 2
        attitudes = tuple(
            [R @ pin.exp3((before + now) * half) for R, before, now in zip(memory.attitudes, memory.turning, rates)]
        )
        own, gain, share = camera.T, self.gain, 1 / (len(rates) + 1)
        changes = [gain * (pin.log3(own @ (R @ to)) - gap) for R, to, gap in zip(attitudes, between, memory.gaps)]
        gaps = tuple([gap + change for gap, change in zip(memory.gaps, changes)])
        turn, rate = reduce(add, gaps) * share, reduce(add, changes) * (share / self.dt)
        return turn, rate, Fused(attitudes, tuple(rates), gaps)
