"""A drive's sensors: an encoder, a rate that an observer or a filter made of it, and a slow, coarse current."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, pi

import numpy as np

from .draws import log_uniform
from .drive_noise import Colour, draw_colour

FARTHEST = 4.5e-3
"""Torque against angle, s: within what is estimated of every log."""
LOWEST_CONTROL_RATE = 400.0


@dataclass(frozen=True)
class DriveSensors:
    """Angles: bits per turn, noise before quantisation (rad). Rates (may be absent): by an "observer" (tracking loop)
    or a "difference", of a bandwidth (Hz) and in steps (rad/s). Torque: noise as a share of its rms, low-pass (Hz),
    steps as shares of the motor's limit, a fresh value every so many rows. Angles and torque come so much late (s);
    together with the low-pass, torque is `alignment` (s) later than angles. Clock: rms error of the stamps (s). Rows:
    lost, and repeated, as shares of all."""

    level: str
    encoder_bits: int
    encoder_noise: float
    has_rate: bool
    rate_law: str
    rate_hz: float
    rate_step: float
    noise: Colour
    noise_share: float
    current_hz: float
    torque_step: float
    torque_every: int
    angle_late: float
    torque_late: float
    alignment: float
    jitter: float
    lost: float
    repeated: float

    @property
    def step(self):
        """The encoder's step, rad."""
        return 2.0 * pi / 2**self.encoder_bits

    @property
    def faults(self):
        """Data causes that are true of these sensors whatever else is hidden."""
        clock = self.jitter > 0.0 or self.lost > 0.0 or self.repeated > 0.0
        return [*(["clock"] if clock else []), *(["filtered-velocity"] if self.has_rate else [])]

    def reader(self, world, samples, rng):
        """What the controller sees."""
        return DriveReading(world, self, samples, rng)

    def reported(self, command, rate):
        """A held command (N, n) behind the current's first-order low-pass, at each sample's beginning."""
        keep = exp(-2.0 * pi * self.current_hz / rate)
        path = np.empty_like(command)
        y = command[0]
        for k, u in enumerate(command):
            path[k] = y
            y = u + (y - u) * keep
        return path

    def passed(self, hertz):
        """|H|² of that low-pass."""
        return 1.0 / (1.0 + (hertz / self.current_hz) ** 2)


class DriveReading:
    """(sample, true q, true v) → the encoder's angles and the rates made of them; called sample by sample, in order."""

    def __init__(self, world, sensors, samples, rng):
        self.world, self.step, self.observer = world, sensors.step, sensors.rate_law == "observer"
        self.noise = sensors.encoder_noise * rng.normal(size=(samples, world.joints))
        self.period = world.seconds / samples
        self.turn = 2.0 * pi * sensors.rate_hz * self.period
        self.angle = []
        self.rate = []

    def __call__(self, k, q, v):
        shown = self.step * np.round((self.world.encoder(np.array(q)) + self.noise[k]) / self.step)
        angles = shown.tolist()
        if k == 0:
            self.angle = angles
            self.rate = list(v)
        elif self.observer:
            self._track(angles)
        else:
            keep = exp(-self.turn)
            before = self.angle
            raw = [(x - y) / self.period for x, y in zip(angles, before, strict=True)]
            self.rate = [r + (w - r) * keep for r, w in zip(raw, self.rate, strict=True)]
            self.angle = angles
        return angles, self.rate

    def _track(self, angles):
        """A second-order tracking loop, damped by 0.8."""
        w = self.turn
        period = self.period
        guess = [x + period * r for x, r in zip(self.angle, self.rate, strict=True)]
        error = [x - g for x, g in zip(angles, guess, strict=True)]
        self.angle = [g + 1.6 * w * e for g, e in zip(guess, error, strict=True)]
        self.rate = [r + w * w / period * e for r, e in zip(self.rate, error, strict=True)]


def control_rate(rate):
    """What the controller runs at (Hz): the log's rate, or a multiple of a slow log's."""
    return rate * ceil(LOWEST_CONTROL_RATE / rate)


def draw_drive_sensors(rng, rate, aligned):
    """A drive's sensors for a log of this rate, Hz; `aligned`: its channels are not shifted, its current is fast."""
    current = 200.0 if aligned else log_uniform(rng, 20.0, 200.0)
    every = 2 if rate >= 400.0 and not aligned and rng.random() < 0.2 else 1
    slow = 0.5 / (pi * current) + 0.5 * (every - 1) / rate
    wanted = slow if aligned else rng.uniform(-FARTHEST, FARTHEST)
    control = control_rate(rate)
    late = max(0, ceil((slow - wanted) * control - 1e-9)) / control
    clock = rng.random() < 0.5
    holes = rng.random() < 0.4
    return DriveSensors(
        level="drive",
        encoder_bits=int(rng.integers(13, 18)),
        encoder_noise=rng.uniform(0.0, 5e-5),
        has_rate=rng.random() < 0.75,
        rate_law=str(rng.choice(["observer", "difference"])),
        rate_hz=min(log_uniform(rng, 20.0, 80.0), control / 12.0),
        rate_step=float(rng.choice([0.0, 0.002, 0.011, 0.03])),
        noise=draw_colour(rng, rate),
        noise_share=log_uniform(rng, 0.01, 0.05),
        current_hz=current,
        torque_step=2.0 ** -float(rng.integers(9, 13)),
        torque_every=every,
        angle_late=late,
        torque_late=wanted - slow + late,
        alignment=wanted,
        jitter=min(log_uniform(rng, 2e-5, 4e-4), 0.1 / rate) if clock else 0.0,
        lost=rng.uniform(0.0005, 0.01) if holes else 0.0,
        repeated=rng.uniform(0.001, 0.02) if rng.random() < 0.3 else 0.0,
    )
