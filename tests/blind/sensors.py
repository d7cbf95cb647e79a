"""Sensors of two grades and those of a drive, and how a true run becomes what they show."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, pi, sin

import numpy as np
from scipy.signal import butter, freqz_sos, lfilter, sosfilt

from .draws import log_uniform

GYRO_DENSITY = np.radians(0.005)
"""White noise of the rate channel, rad/s per √Hz; dirty sensors have a multiple of it."""
ACCELEROMETER_DENSITY = 100e-6 * 9.81
FARTHEST = 4.5e-3
"""Torque against angle, s: within what is estimated of every log."""
LOWEST_CONTROL_RATE = 400.0
SETTLING_S = 3.0


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
    def faults(self):
        """Data causes that are true of these sensors whatever else is hidden."""
        return ["clock"] if self.jitter > 0.0 or self.lost > 0.0 else []

    def reader(self, world, samples, rng):
        """Return the controller's sensors: (sample, true q, true v) → encoder and rate readings.

        The noise is drawn beforehand, alike for every run."""
        shape = (samples, world.joints)
        q_noise = (self.encoder_noise * rng.normal(size=shape)).tolist()
        v_noise = self.rate_noise * rng.normal(size=shape)
        signs = rng.choice([-1.0, 1.0], world.joints)
        v_noise = (v_noise + self.rate_bias * signs).tolist()
        shown = list(zip(world.offset, world.eccentric))
        step = 2.0 * pi / 2**self.encoder_bits

        def read(k, q, v):
            angles = [
                step * round((x + o + a * sin(x + p) + e) / step)
                for x, (o, (a, p)), e in zip(q, shown, q_noise[k])
            ]
            return angles, [x + e for x, e in zip(v, v_noise[k])]

        return read


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


def torque_noise(rng, sensors, torque, rate):
    """The error of the reported torque, white and first-order low-passed, (N, n), N m."""
    white = sensors.torque_white * rng.normal(size=torque.shape)
    keep = exp(-2.0 * pi * sensors.torque_corner / rate)
    kicks = rng.normal(size=torque.shape)
    kicks[1:] *= np.sqrt(1.0 - keep * keep)
    slow = sensors.torque_coloured * lfilter([1.0], [1.0, -keep], kicks, axis=0)
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


@dataclass(frozen=True)
class Colour:
    """Noise of unit rms. "ar1": x' = `phi` x + e at the log's rate; "low-pass": second-order Butterworth at `hertz`."""

    kind: str
    phi: float
    hertz: float

    def _low_pass(self, rate):
        return butter(2, self.hertz, fs=rate, output="sos")

    def _gain(self, hertz, rate):
        """|H|² of the filter that white noise goes through."""
        if self.kind == "ar1":
            return 1.0 / np.abs(1.0 - self.phi * np.exp(-2j * np.pi * hertz / rate)) ** 2
        return np.abs(freqz_sos(self._low_pass(rate), hertz, fs=rate)[1]) ** 2

    def _power(self, rate):
        """Variance after the filter, of white noise of variance one."""
        grid = (np.arange(200_000) + 0.5) / 200_000 * 0.5 * rate
        return float(self._gain(grid, rate).mean())

    def density(self, hertz, rate):
        """One-sided power per Hz at these frequencies; its integral up to rate / 2 is one."""
        return self._gain(hertz, rate) / (0.5 * rate * self._power(rate))

    def series(self, rng, shape, rate):
        """Samples (N, n), settled from the first one on."""
        ar1 = self.kind == "ar1"
        corner = -float(np.log(self.phi)) * rate / (2.0 * np.pi) if ar1 else self.hertz
        before = round(SETTLING_S / min(corner, 1.0) * rate)
        white = rng.normal(size=(shape[0] + before, shape[1])) / np.sqrt(self._power(rate))
        if ar1:
            return lfilter([1.0], [1.0, -self.phi], white, axis=0)[before:]
        return sosfilt(self._low_pass(rate), white, axis=0)[before:]


def draw_colour(rng, rate):
    """φ of 0.9–0.99 at the log's rate, or a corner of 0.5–15 Hz."""
    hertz = log_uniform(rng, 0.5, min(15.0, 0.2 * rate))
    return Colour(str(rng.choice(["ar1", "low-pass"])), rng.uniform(0.9, 0.99), hertz)


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
    def faults(self):
        """Data causes that are true of these sensors whatever else is hidden."""
        clock = self.jitter > 0.0 or self.lost > 0.0 or self.repeated > 0.0
        return [*(["clock"] if clock else []), *(["filtered-velocity"] if self.has_rate else [])]

    def reader(self, world, samples, rng):
        """Return the controller's sensors: (sample, true q, true v) → encoder angles and rates.

        A second-order tracking loop, damped by 0.8, or a filtered difference makes the rates. It is called sample by
        sample, in order."""
        step = 2.0 * pi / 2**self.encoder_bits
        noise = self.encoder_noise * rng.normal(size=(samples, world.joints))
        period = world.seconds / samples
        turn = 2.0 * pi * self.rate_hz * period
        keep = exp(-turn)
        angle = rate = None

        def read(k, q, v):
            nonlocal angle, rate
            shown = (step * np.round((world.encoder(np.array(q)) + noise[k]) / step)).tolist()
            if k == 0:
                angle = shown
                rate = list(v)
            elif self.rate_law == "observer":
                guess = [x + period * r for x, r in zip(angle, rate)]
                error = [x - g for x, g in zip(shown, guess)]
                angle = [g + 1.6 * turn * e for g, e in zip(guess, error)]
                rate = [r + turn * turn / period * e for r, e in zip(rate, error)]
            else:
                raw = [(x - y) / period for x, y in zip(shown, angle)]
                angle = shown
                rate = [r + (w - r) * keep for r, w in zip(raw, rate)]
            return shown, rate

        return read

    def reported(self, command, rate):
        """A held command (N, n) behind the current's first-order low-pass, at each sample's beginning."""
        keep = exp(-2.0 * pi * self.current_hz / rate)
        return lfilter([0.0, 1.0 - keep], [1.0, -keep], command - command[0], axis=0) + command[0]

    def passed(self, hertz):
        """|H|² of that low-pass."""
        return 1.0 / (1.0 + (hertz / self.current_hz) ** 2)


def control_rate(rate):
    """Return the controller's rate (Hz): the log's, or a multiple of a slow log's."""
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
