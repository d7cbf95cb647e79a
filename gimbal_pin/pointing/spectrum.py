"""How a platform moves, as the power of its IMU's channels over frequency: what can be said of its near future."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from gimbal_pin.errors import LogError
from gimbal_pin.log.log import Array, Imu

RESOLUTION = 0.5
"""Width of a frequency bin, Hz."""
VIBRATION = (0.03, 1.0)
"""Vibration, rad/s and m/s² rms, that no one can foresee where nothing is known: it counts as noise."""
MEAN = 2
"""First bin that gravity, a constant, does not leak into."""
SMEARED = 0.02
"""Share of its frequency over which a line is smeared: rotors do not keep their speed."""
QUIET = (0.6, 0.95)
"""Part of the band, in shares of half the sampling rate, whose median power is taken for the sensor's noise."""
HAND = (0.5, 30.0)
"""Corners of a motion that is assumed where nothing is known, Hz: as 1/f² between, as 1/f⁶ above."""
SURPRISE = 0.01
"""Share of a measured motion's power that may come as a motion of that shape instead, next time."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power densities of the platform's rate and specific force, mean of their axes.

    Attributes:
        f: Frequencies, Hz, (K,).
        rate: (rad/s)²/Hz, without the sensor's noise, (K,).
        force: (m/s²)²/Hz, without the sensor's noise, its mean in the first bin, (K,).
        rate_noise: Density of the gyro's noise, (rad/s)²/Hz.
        force_noise: Density of the accelerometer's noise, (m/s²)²/Hz.
    """

    f: Array
    rate: Array
    force: Array
    rate_noise: float
    force_noise: float

    @staticmethod
    def of(imu: Imu, dt: float, name: str = "platform") -> Spectrum:
        """Measure it in the readings of a platform's IMU, sampled every `dt` s.

        Raises:
            LogError: The IMU has no gyro or no accelerometer, or its readings are too short for the resolution.
        """
        if imu.gyro is None or imu.accel is None:
            raise LogError(name, "holds no gyro or no accelerometer of the base", "give gyro_ and accel_ of it")
        width = round(1 / RESOLUTION / dt)
        if len(imu.gyro) < 2 * width:
            raise LogError(name, f"holds {len(imu.gyro) * dt:.3g} s of the platform", f"give {2 / RESOLUTION:g} s")
        f, rate = welch(imu.gyro, 1 / dt, nperseg=width, axis=0, detrend=False)
        _, force = welch(imu.accel, 1 / dt, nperseg=width, axis=0, detrend=False)
        return Spectrum.of_powers(f, rate.mean(axis=1), force.mean(axis=1))

    @staticmethod
    def of_powers(f: Array, rate: Array, force: Array) -> Spectrum:
        """Take the sensors' noise off measured power densities, and leave room for surprise."""
        parted = [without_noise(f, smeared(f, power)) for power in (rate, force)]
        (rate, rate_noise), (force, force_noise) = parted
        surprise = SURPRISE * assumed(f)
        rate = rate + rate.sum() * f[1] * surprise
        force = force + force[MEAN:].sum() * f[1] * surprise
        return Spectrum(f, rate, force, rate_noise, force_noise)

    def until(self, top: float) -> Spectrum:
        """Return it up to another highest frequency, Hz: no motion above what was seen, but the sensor's noise."""
        step = float(self.f[1] - self.f[0])
        f = step * np.arange(round(top / step) + 1)
        rate, force = (np.interp(f, self.f, power, right=0.0) for power in (self.rate, self.force))
        return Spectrum(f, rate, force, self.rate_noise, self.force_noise)

    @staticmethod
    def assumed(dt: float, gyro: float, accelerometer: float) -> Spectrum:
        """A hand's motion, 0.3 rad/s and 1.5 m/s² rms, for noise densities in rad/s/√Hz and m/s²/√Hz."""
        f = np.linspace(0.0, 0.5 / dt, round(0.5 / dt / RESOLUTION) + 1)
        force = 1.5**2 * assumed(f)
        force[0] += 100.0 / RESOLUTION
        noise = [max(own, 1e-9) ** 2 + x**2 / f[-1] for own, x in zip((gyro, accelerometer), VIBRATION)]
        return Spectrum(f, 0.3**2 * assumed(f), force, *noise)


def assumed(f: Array) -> Array:
    """The motion of `HAND`, of unit power, 1/Hz."""
    shape = 1 / ((1 + (f / HAND[0]) ** 2) * (1 + (f / HAND[1]) ** 4))
    return np.asarray(shape / (shape.sum() * f[1]))


def smeared(f: Array, power: Array) -> Array:
    """Mean of a spectrum over `SMEARED` of each frequency to both sides."""
    total = np.concatenate([[0.0], np.cumsum(power)])
    low = np.searchsorted(f, f * (1 - SMEARED), side="left")
    high = np.searchsorted(f, f * (1 + SMEARED), side="right")
    return np.asarray((total[high] - total[low]) / (high - low))


def without_noise(f: Array, power: Array) -> tuple[Array, float]:
    """Take the sensor's noise, which is white, off a spectrum; return both."""
    quiet = (f > QUIET[0] * f[-1]) & (f < QUIET[1] * f[-1])
    noise = max(float(np.median(power[quiet])), 1e-12 * float(power.max(initial=0.0)), 1e-30)
    return np.maximum(power - noise, 0.0), noise
