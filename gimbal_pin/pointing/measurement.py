"""Measurements of a gimbal's sensors, and the resolution and noise that they have."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import pi
from typing import NamedTuple

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig

GYRO = np.deg2rad(0.005)
"""Noise density of the benchmark's gyros, rad/s/√Hz."""
ACCELEROMETER = 100e-6 * 9.81
"""Noise density of its accelerometers, m/s²/√Hz."""
BITS = 16
"""Resolution of its encoders."""


NO_GYROS = np.zeros(0)
"""The readings of a rig without gyros between platform and camera."""


class Measurement(NamedTuple):
    """One sample of every sensor: what a controller gets, and all that it gets.

    Attributes:
        t: Time stamp, s.
        q: Angles, rad, (n,).
        gyro: Rate of the gyro beside the camera, in the camera's frame, rad/s, (3,).
        w: Rate of the platform's gyro, in the base link's frame, rad/s, (3,).
        f: Specific force of the platform, m/s², (3,).
        links: Rates of the gyros on links between the two, each in its link's frame, rad/s, (3 L,).
    """

    t: float
    q: Array
    gyro: Array
    w: Array
    f: Array
    links: Array = NO_GYROS


@dataclass(frozen=True, eq=False)
class Station:
    """The sensors of the benchmark.

    Attributes:
        step: Angle of one encoder step, rad, (n,); 0: exact.
        noise: Densities of the IMUs' noise.
    """

    step: Array
    noise: Noise = field(default_factory=lambda: Noise(GYRO, ACCELEROMETER))

    @staticmethod
    def of(rig: Rig) -> Station:
        """16-bit encoders on every joint."""
        return Station(np.full(rig.n, 2 * pi / 2**BITS))

    @staticmethod
    def exact(rig: Rig) -> Station:
        """Sensors without error."""
        return Station(np.zeros(rig.n), Noise())

    def draws(self, samples: int, links: int, dt: float, rng: np.random.Generator) -> Array:
        """Noise of camera gyro, platform gyro, accelerometer and links' gyros, rad/s, m/s², (samples, 3 + links, 3)."""
        densities = [self.noise.gyro, self.noise.gyro, self.noise.accelerometer] + [
            self.noise.gyro
        ] * links
        return (
            np.array(densities)[:, None]
            / np.sqrt(2 * dt)
            * rng.standard_normal((samples, 3 + links, 3))
        )

    def angles(self, q: Array) -> Array:
        """The angles as the encoders report them, rad, (n,)."""
        return np.asarray(np.rint(q / self.step) * self.step) if self.coarse else q.copy()

    @cached_property
    def coarse(self) -> bool:
        """Whether the encoders have steps."""
        return bool(self.step.all())
