"""Several gyros and the encoders between them: less noise in the camera's attitude than its own gyro has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array
from gimbal_pin.pointing.measures import SLOW

exp3, log3 = pin.exp3, pin.log3
SPAN = 1 / (2 * pi * SLOW)
"""Time over which gaps are looked at, s: what changes them slower than `SLOW` is drift."""
SURE = 5.0
"""Deviations of the sensors' noise beyond which a gap is none of it: by chance once in 43 h on nine channels, whose
values are independent after `SPAN`."""
FAINT = 1e-5
"""Least deviation, rad: `SURE` times that is 0.003°, below which no gap harms."""


class Fused(NamedTuple):
    """What fusion remembers, one entry per other gyro.

    Attributes:
        attitudes: Attitudes in the world, each integrated from its own gyro, (3, 3).
        rates: Rates at the last sample, rad/s, (L, 3).
        gaps: What they make of the camera's attitude less what its own gyro makes of it, smoothed, rad, (L, 3).
        turn: What to turn the camera's attitude by, rad, (3,).
        rate: What to add to its rate, rad/s, (3,).
        slow: The gaps behind a low-pass of `SPAN`, rad, (L, 3).
        ended: Whether a gap was beyond the gyros' noise: then nothing is fused any more, and the turn stays.
    """

    attitudes: tuple[Array, ...]
    rates: Array
    gaps: Array
    turn: Array
    rate: Array
    slow: Array
    ended: bool = False

    @staticmethod
    def begun(attitudes: Sequence[Array], rates: Array) -> Fused:
        """Memory for attitudes that are known, where the gyros read `rates`, rad/s, (L, 3)."""
        still, zero = np.zeros_like(rates), np.zeros(3)
        return Fused(tuple(attitudes), rates, still, zero, zero, still)

    def on(self, rates: Array, elapsed: float) -> Fused:
        """Return the memory after a sample."""
        turns = (self.rates + rates) * (elapsed / 2)
        attitudes = tuple([R.dot(exp3(turn)) for R, turn in zip(self.attitudes, turns)])
        return Fused(attitudes, rates, *self[2:])


@dataclass(frozen=True)
class Fusion:
    """``R̂ = R exp(Σ ŷ_i / M)``, ``ŷ_i⁺ = ŷ_i + k (log(Rᵀ R_i R_ic(q)) - ŷ_i)``: the mean of M gyros' attitudes.

    The camera's own motion is in none of the gaps y: they hold the gyros' noise alone, which walks, and the encoders',
    which is white. So k, Kalman's gain for that, may be as slow as it likes: it is in no loop, and costs no margin.
    A gyro of a wrong scale, mounted askew or with a bias puts the motion into its gap: a gap that changes by more than
    the noise of gyros and encoders explains ends the fusion.

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

    @property
    def share(self) -> float:
        """Share of a gap in its slow part, per sample."""
        return min(1.0, self.dt / SPAN)

    @cached_property
    def bound(self) -> float:
        """Largest change of a gap over `SPAN` that is noise, rad.

        Two gyros' walks gain ``gyro²`` a second, of which a high-pass of that time leaves half; three encoders round.
        """
        return SURE * max(sqrt(self.gyro**2 * SPAN / 2 + 3 * self.step**2 / 12), FAINT)

    def compared(self, memory: Fused, camera: Array, between: Sequence[Array]) -> Fused:
        """Return the memory after a comparison.

        Args:
            memory: The memory at this sample.
            camera: Attitude that the camera's own gyro gives, (3, 3).
            between: Attitude of the camera in each other gyro's link, (3, 3).
        """
        if memory.ended:
            return memory
        own = camera.T
        seen = np.array([log3(own.dot(R.dot(to))) for R, to in zip(memory.attitudes, between)])
        gaps = memory.gaps + self.gain * (seen - memory.gaps)
        slow = memory.slow + self.share * (gaps - memory.slow)
        if max(map(abs, (gaps - slow).ravel().tolist())) > self.bound:
            return memory._replace(rate=np.zeros(3), ended=True)
        turn = np.add.reduce(gaps) / (len(gaps) + 1)
        return Fused(memory.attitudes, memory.rates, gaps, turn, (turn - memory.turn) / self.dt, slow)
