"""A disturbance observer on the linearised joints, and the loop it makes, broken at the plant's input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, pi
from typing import NamedTuple


class Observed(NamedTuple):
    """What the observer remembers.

    Attributes:
        rate: Estimated ė per joint, rad/s.
        disturbance: Estimated acceleration that the model did not foresee, rad/s².
        commanded: Feedback of the last samples that has not acted yet, oldest first, rad/s².
    """

    rate: tuple[float, ...]
    disturbance: tuple[float, ...]
    commanded: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Observer:
    """``ė⁺ = ė - dt (u + d)``, d constant: a Luenberger observer with both poles at ``exp(-2π hz dt)``.

    What is linearised leaves ``q̈ = q̈_d + u + d``: whatever makes the camera turn against the commands is d.

    Attributes:
        hz: Its bandwidth, Hz.
        dt: Sampling interval, s.
        delay: Samples from the measurement to the torque.
    """

    hz: float
    dt: float
    delay: int = 1

    @cached_property
    def gains(self) -> tuple[float, float]:
        """Of the rate (1) and of the disturbance (1/s)."""
        away = 1 - exp(-2 * pi * self.hz * self.dt)
        return 2 * away, away**2 / self.dt

    def start(self, n: int) -> Observed:
        """Memory before the first sample."""
        return Observed((0.0,) * n, (0.0,) * n, ((0.0,) * n,) * self.delay)

    def step(
        self, memory: Observed, rate: Sequence[float], feedback: Sequence[float], free: Sequence[bool]
    ) -> Observed:
        """Return the memory after a sample.

        Args:
            memory: The memory before it.
            rate: Measured ė, rad/s.
            feedback: Commanded u, rad/s².
            free: Joints whose torque was not cut: the others' disturbance stands, as conditional integration does.
        """
        queue = (*memory.commanded, tuple(feedback))
        own, out = self.gains
        gap = [v - estimate for v, estimate in zip(rate, memory.rate)]
        rates = [
            estimate - self.dt * (u + d) + own * e
            for estimate, u, d, e in zip(memory.rate, queue[0], memory.disturbance, gap)
        ]
        disturbance = [d - out * e if ok else d for d, e, ok in zip(memory.disturbance, gap, free)]
        return Observed(tuple(rates), tuple(disturbance), queue[1:])
