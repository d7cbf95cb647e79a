"""Sensors of two grades, and how a true run becomes what they show."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sin

import numpy as np

from .draws import log_uniform

GYRO_DENSITY = np.radians(0.005)
"""White noise of the rate channel, rad/s per √Hz; dirty sensors have a multiple of it."""
ACCELEROMETER_DENSITY = 100e-6 * 9.81


@dataclass(frozen=True)
class Sensors:
    """Encoders (bits per turn, noise in rad before quantisation), rate channel (rad/s; may be absent), torque noise as
    shares of each joint's torque rms (white, and coloured below a corner in Hz), clock jitter as a share of the period,
    lost rows as a share of all."""

    level: str
    encoder_bits: int
    encoder_noise: float
    has_rate: bool
    rate_noise: float
    rate_bias: float
    torque_white: float
    torque_coloured: float
    torque_corner: float
    jitter: float
    lost: float

    @property
    def step(self):
        """The encoder's step, rad."""
        return float(2.0 * pi / 2**self.encoder_bits)

    @property
    def faults(self):
        """Data causes that are true of these sensors whatever else is hidden."""
        return ["clock"] if self.jitter > 0.0 or self.lost > 0.0 else []

    def reader(self, world, samples, rng):
        """What the controller sees."""
        return Measurement(world, self, samples, rng)


def draw_sensors(rng, level, rate):
    """ "clean": white noise and 16 bits; "dirty": coarse encoders, coloured noise, bias, jitter, lost rows."""
    gyro = float(GYRO_DENSITY * np.sqrt(rate / 2.0))
    if level == "clean":
        white = rng.uniform(0.002, 0.01)
        has_rate = rng.random() < 0.75
        rate_noise = gyro * rng.uniform(0.7, 1.5)
        return Sensors(level, 16, 2e-5, has_rate, rate_noise, 0.0, white, 0.0, 1.0, 0.0, 0.0)
    return Sensors(
        level=level,
        encoder_bits=int(rng.integers(12, 16)),
        encoder_noise=rng.uniform(0.0, 1e-4),
        has_rate=rng.random() < 0.7,
        rate_noise=gyro * rng.uniform(2.0, 6.0),
        rate_bias=float(np.radians(rng.uniform(-0.3, 0.3))),
        torque_white=rng.uniform(0.002, 0.014),
        torque_coloured=rng.uniform(0.002, 0.014),
        torque_corner=log_uniform(rng, 2.0, 40.0),
        jitter=rng.uniform(0.005, 0.05) if rng.random() < 0.7 else 0.0,
        lost=rng.uniform(0.0005, 0.01) if rng.random() < 0.6 else 0.0,
    )


class Measurement:
    """(sample, true q, true v) → encoder and rate readings; its noise is drawn beforehand, the same for every run."""

    def __init__(self, world, sensors, samples, rng):
        shape = (samples, world.joints)
        self.step = sensors.step
        self.q_noise = (sensors.encoder_noise * rng.normal(size=shape)).tolist()
        v_noise = sensors.rate_noise * rng.normal(size=shape)
        signs = rng.choice([-1.0, 1.0], world.joints)
        self.v_noise = (v_noise + sensors.rate_bias * signs).tolist()
        self.shown = list(zip(world.offset, world.eccentric, strict=True))

    def __call__(self, k, q, v):
        angles = [
            self.step * round((x + o + a * sin(x + p) + e) / self.step)
            for x, (o, (a, p)), e in zip(q, self.shown, self.q_noise[k], strict=True)
        ]
        return angles, [x + e for x, e in zip(v, self.v_noise[k], strict=True)]


def coloured(rng, shape, corner, rate):
    """First-order low-passed white noise of unit rms, (N, n)."""
    keep = exp(-2.0 * pi * corner / rate)
    path = rng.normal(size=shape)
    path[1:] *= np.sqrt(1.0 - keep * keep)
    for k in range(1, shape[0]):
        path[k] += keep * path[k - 1]
    return path


def torque_noise(rng, sensors, torque, rate):
    """The error of the reported torque, (N, n), N m."""
    white = sensors.torque_white * rng.normal(size=torque.shape)
    slow = sensors.torque_coloured * coloured(rng, torque.shape, sensors.torque_corner, rate)
    return (white + slow) * np.sqrt(np.mean(torque**2, axis=0))


def stamps(rng, sensors, t):
    """Time stamps as a jittery clock writes them, still increasing."""
    period = float(t[1] - t[0])
    error = np.clip(rng.normal(size=len(t)), -3.0, 3.0) * sensors.jitter * period
    return t + error - error[0]


def kept_rows(rng, lost, samples):
    """Indices of the rows that were not lost: of a share `lost` some are alone, some two or three in a row."""
    keep = np.ones(samples, dtype=bool)
    for start in rng.integers(2, samples - 8, int(lost * samples / 2.0)):
        keep[start : start + int(rng.integers(1, 4))] = False
    return np.flatnonzero(keep)
