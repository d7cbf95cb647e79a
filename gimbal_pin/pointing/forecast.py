"""The platform's motion when the torque acts, from the last samples of its IMU and its spectrum (Wiener's filter)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp
from operator import lt
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import welch

from gimbal_pin.control.laws.base import BaseState, Pid
from gimbal_pin.errors import LogError
from gimbal_pin.log.log import Array, Imu
from gimbal_pin.rig.brief import brief

RESOLUTION = 0.5
"""Width of a frequency bin, Hz."""
MEAN = 2
"""First bin that gravity, a constant, does not leak into."""
SMEARED = 0.02
"""Share of its frequency over which a line is smeared: rotors do not keep their speed."""
QUIET = (0.6, 0.95)
"""Part of the band, in shares of half the sampling rate, whose median power is taken for the sensor's noise."""
HAND = (0.5, 30.0)
"""Corners of a hand's motion, Hz: as 1/f² between, as 1/f⁶ above."""
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

    __repr__ = brief

    @staticmethod
    def of(imu: Imu, dt: float, name: str = "platform") -> Spectrum:
        """Measure it in the readings of a platform's IMU, sampled every `dt` s.

        Raises:
            LogError: The IMU has no gyro or no accelerometer, or its readings are too short for the resolution.
        """
        if imu.gyro is None or imu.accel is None:
            raise LogError(
                name, "holds no gyro or no accelerometer of the base", "give gyro_ and accel_ of it"
            )
        width = round(1 / RESOLUTION / dt)
        if len(imu.gyro) < 2 * width:
            raise LogError(
                name,
                f"holds {len(imu.gyro) * dt:.3g} s of the platform",
                f"give {2 / RESOLUTION:g} s",
            )
        f, rate = welch(imu.gyro, 1 / dt, nperseg=width, axis=0, detrend=False)
        _, force = welch(imu.accel, 1 / dt, nperseg=width, axis=0, detrend=False)
        return Spectrum.of_powers(f, np.stack([rate.mean(axis=1), force.mean(axis=1)]))

    @staticmethod
    def of_powers(f: Array, powers: Array) -> Spectrum:
        """Take the sensors' noise off measured power densities of rate and force, (2, K); leave room for surprise."""
        parts, noise = without_noise(f, smeared(f, powers))
        total = np.array([parts[0].sum(), parts[1, MEAN:].sum()]) * f[1]
        rate, force = parts + SURPRISE * total[:, None] * assumed(f)
        return Spectrum(f, rate, force, *noise.tolist())

    def until(self, top: float) -> Spectrum:
        """Return it up to another highest frequency, Hz: no motion above what was seen, but the sensor's noise."""
        f = np.linspace(0.0, top, round(top / float(self.f[1])) + 1)
        rate, force = (np.interp(f, self.f, power, right=0.0) for power in (self.rate, self.force))
        return Spectrum(f, rate, force, self.rate_noise, self.force_noise)


def assumed(f: Array) -> Array:
    """The motion of `HAND`, of unit power, 1/Hz."""
    shape = 1 / ((1 + (f / HAND[0]) ** 2) * (1 + (f / HAND[1]) ** 4))
    return np.asarray(shape / (shape.sum() * f[1]))


def smeared(f: Array, powers: Array) -> Array:
    """Mean of spectra, (…, K), over `SMEARED` of each frequency to both sides."""
    total = np.insert(np.cumsum(powers, axis=-1), 0, 0.0, axis=-1)
    low = np.searchsorted(f, f * (1 - SMEARED), side="left")
    high = np.searchsorted(f, f * (1 + SMEARED), side="right")
    return np.asarray((total.take(high, axis=-1) - total.take(low, axis=-1)) / (high - low))


def without_noise(f: Array, powers: Array) -> tuple[Array, Array]:
    """Take the sensors' noise, which is white, off spectra, (…, K); return both."""
    quiet = (f > QUIET[0] * f[-1]) & (f < QUIET[1] * f[-1])
    least = np.maximum(1e-12 * powers.max(axis=-1, initial=0.0), 1e-30)
    noise = np.maximum(np.median(powers[..., quiet], axis=-1), least)
    return np.maximum(powers - noise[..., None], 0.0), noise


TAPS = 128
"""Samples that it looks back on."""
FLOOR = 1e-4
"""Weight of an error where the loop suppresses it best, against where it does so worst."""
JUDGED = 0.25
"""Time constant of the mean squares that are compared, s: a period of the slowest motion that a loop at 25 Hz leaves
to the forecast, 4 Hz in profile S."""
RISE, FALL = 0.5, 0.05
"""Time in which a forecast that errs less than none comes into force, and in which one that errs more leaves it, s:
twice `JUDGED`, so that one lucky mean is not enough, and a crossover's period, before the loop has answered."""
SETTLED = 1.0
"""Before that nothing is said, s: four `JUDGED`, in which a good forecast has come into force."""
BLOCKS, EVERY = 16, 8
"""Blocks of `TAPS` samples that one spectrum in flight is measured in, 2 s at 1 kHz: half a hertz, as `Spectrum.of`;
and after how many a new one is, so that windows overlap by half."""
SPECTRA = 8
"""Spectra over which their mean is taken: 8 s at 1 kHz."""
MOST = 20
"""Events that are kept."""
THREES = np.kron(np.eye(4), np.ones((3, 1)))
"""Sums of three entries each, (12, 4)."""


class Past(NamedTuple):
    """What a forecast remembers.

    Attributes:
        taps: Last samples of the platform's IMU, rate and force, newest first, (TAPS, 6).
        weights: The filters in use, one per lead, see `Forecast.weights`.
        found: Motion at every lead, rate, angular acceleration and force, (9,) each.
        due: What was foreseen and what was held for the last lead, dw and f, oldest first, (2, 6) each.
        smooth: The errors of both behind a low-pass of the loop's crossover, (2, 6).
        scores: Mean squares of both one's errors: of dw and f, all and the slow part of them, (2, 4).
        trust: Share of the forecast that is used, 0 to 1.
        used: Whether it is in force as far as events say; before `SETTLED` it counts as such.
        samples: Samples so far.
        blocks: Blocks of samples that the next spectrum is measured in.
        power: Mean power densities in flight, rate and force, (2, K), and of how many spectra; None: no flight yet.
        spectrum: What they show, while its filters are worked out; None: nothing is.
        rows: As many rows of its filters as are ready.
        events: What happened, in sentences.
    """

    taps: Array
    weights: tuple[Array, ...]
    found: tuple[Array, ...]
    due: tuple[Array, ...]
    smooth: Array
    scores: Array
    trust: float = 0.0
    used: bool = True
    samples: int = 0
    blocks: tuple[Array, ...] = ()
    power: tuple[Array, int] | None = None
    spectrum: Spectrum | None = None
    rows: tuple[Array, ...] = ()
    events: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Forecast:
    """``x̂ = x_0 + α (Σ h_k z(t - k dt) - x_0)``: a forecast as far as it has shown to be better than none, x_0.

    None holds what was measured last: ``x_0 = ((w + w')/2, (w - w')/dt, (f + f')/2)``, half a sample ago, of gain one
    and of one phase. Force and angular acceleration have to agree: where the axes are apart from the IMU, what they
    ask of the motors mostly cancels, and beyond what it knows a filter of each alone would amplify the difference.

    h is the filter of least error after the loop: ``min E|G (x̂ - x)|²``. The spectrum says what is signal, what is
    noise, and how far the one can be foreseen: a smooth motion by its derivatives, a propeller by its period, white
    noise not at all. G is how the loop answers an acceleration: what it suppresses by itself may be foreseen less well.
    Normal equations are Toeplitz: ``r = ∫ W (S + N) cos ωτ``. The spectrum is that of a log first, then in flight the
    mean of those that the IMU shows, in constant memory.

    α rises while the forecasts erred less than none when they came due, and falls to none at once where they did not.

    Attributes:
        spectrum: How the platform is known to move before the flight.
        gains: The outer loop, which says G, one per lead.
        dt: Sampling interval, s.
        leads: How far ahead, s; all zero: nothing is foreseen, what was measured last is held.
        learns: Whether it learns in flight.
    """

    spectrum: Spectrum
    gains: tuple[Pid, ...]
    dt: float
    leads: tuple[float, ...]
    learns: bool = True

    __repr__ = brief

    @property
    def foresees(self) -> bool:
        """Whether there is anything to foresee."""
        return any(self.leads)

    @cached_property
    def weights(self) -> tuple[Array, ...]:
        """The filters before the flight, one per lead: rate, angular acceleration, and force, (3, TAPS) each."""
        known = self.spectrum.until(0.5 / self.dt)
        return self.filters([self.row(known, i) for i in range(3 * len(self.leads))])

    def filters(self, rows: Sequence[Array]) -> tuple[Array, ...]:
        """Rows of all filters, lead by lead."""
        return tuple(np.reshape(rows, (-1, 3, TAPS)))

    def row(self, known: Spectrum, i: int) -> Array:
        """Row i of the filters for a spectrum up to half the sampling rate, (TAPS,)."""
        lead, which = divmod(i, 3)
        power, noise = (
            (known.force, known.force_noise) if which == 2 else (known.rate, known.rate_noise)
        )
        weight = passing(self.gains[lead], known.f)
        s = 2j * np.pi * known.f
        column = waves(weight * (power + noise))
        column[0] *= 1 + 1e-9
        ahead = np.exp(s * self.leads[lead]) * (s if which == 1 else 1.0)
        return np.asarray(solve_toeplitz(column, waves(weight * power * ahead), check_finite=False))

    def held(self, taps: Array) -> Array:
        """What was measured last, half a sample ago: rate, angular acceleration, force, (9,)."""
        now = taps[0]
        before = taps[1]
        mean = (now + before) / 2
        change = (now[:3] - before[:3]) / self.dt
        return np.concatenate([mean[:3], change, mean[3:]])

    @cached_property
    def due(self) -> int:
        """Samples after which what was foreseen for the last lead is what was measured last."""
        return max(1, int(self.leads[-1] / self.dt + 0.5))

    @cached_property
    def shares(self) -> tuple[float, float]:
        """Shares of a new error in the slow errors and in the mean squares; ``√kp`` is about a loop's crossover."""
        return 1 - exp(-self.dt * self.gains[-1].kp ** 0.5), 1 - exp(-self.dt / JUDGED)

    def ahead(self, past: Past) -> list[BaseState]:
        """The platform's motion, one per lead."""
        return [BaseState(x[6:], x[:3], x[3:6]) for x in past.found]

    def start(self, w: Array, f: Array) -> Past:
        """Memory for a platform that has always moved as in the first sample."""
        taps = np.tile(np.concatenate([w, f]), (TAPS, 1))
        none = self.held(taps)
        weights = self.weights if self.foresees else ()
        due = (np.stack([none[3:], none[3:]]),) * self.due
        return Past(
            taps, weights, (none,) * len(self.leads), due, np.zeros((2, 6)), np.zeros((2, 4))
        )

    def step(self, past: Past, t: float, w: Array, f: Array) -> Past:
        """Memory with the next sample, at time t, s."""
        taps = np.concatenate([w, f, past.taps.ravel()[:-6]]).reshape(TAPS, 6)
        none = self.held(taps)
        if not self.foresees:
            return past._replace(taps=taps, found=(none,) * len(self.leads))
        far = [filtered(weights, taps) for weights in past.weights]
        due, smooth, scores, trust = self.compared(past, none[3:], far[-1][3:])
        found = tuple([none + trust * (x - none) for x in far])
        used = past.used
        events = past.events
        if trust == (0.0 if used else 1.0) and past.samples * self.dt > SETTLED:
            used = not used
            said = (
                "the forecast errs less than none again"
                if used
                else "the forecast errs more than none: none is used"
            )
            events = (*events, f"{t:.3f} s: {said}")[:MOST]
        after = past._replace(
            taps=taps, found=found, due=due, smooth=smooth, scores=scores, trust=trust, used=used, events=events,
            samples=past.samples + 1,
        )  # fmt: skip
        return self.learned(after) if self.learns else after

    def compared(
        self, past: Past, none: Array, far: Array
    ) -> tuple[tuple[Array, ...], Array, Array, float]:
        """Judge what comes due; return what is to come, slow errors, mean squares, and trust."""
        slow, mean = self.shares
        errors = past.due[0] - none
        smooth = past.smooth + slow * (errors - past.smooth)
        both = np.concatenate([errors, smooth], axis=1)
        scores = past.scores + mean * ((both * both).dot(THREES) - past.scores)
        foreseen, held = scores.tolist()
        better = all(map(lt, foreseen, held))
        trust = (
            min(1.0, past.trust + self.dt / RISE)
            if better
            else max(0.0, past.trust - self.dt / FALL)
        )
        return (*past.due[1:], np.array([far, none])), smooth, scores, trust

    def learned(self, past: Past) -> Past:
        """Memory after a sample: a spectrum every `EVERY` blocks, and its filters, a row a sample, in force together.

        All at one sample would take longer than a sample lasts.
        """
        if past.spectrum is not None:
            rows = (*past.rows, self.row(past.spectrum, len(past.rows)))
            if len(rows) < 3 * len(self.leads):
                return past._replace(rows=rows)
            return past._replace(weights=self.filters(rows), spectrum=None, rows=())
        number, sample = divmod(past.samples, TAPS)
        if sample == 0:
            past = past._replace(blocks=(*past.blocks, past.taps[::-1])[-BLOCKS:])
        if number < BLOCKS or number % EVERY or sample > 1:
            return past
        if sample == 1:
            return past._replace(spectrum=self.known(past))
        before, seen = (0.0, 0) if past.power is None else past.power
        power = before + (measure_powers(np.concatenate(past.blocks), self.dt) - before) / min(
            seen + 1, SPECTRA
        )
        return past._replace(power=(power, seen + 1))

    def known(self, past: Past) -> Spectrum:
        """The spectrum that the flight has shown, or that from before it."""
        if past.power is None:
            return self.spectrum
        return Spectrum.of_powers(self.flown, past.power[0])

    @cached_property
    def flown(self) -> Array:
        """Frequencies of a spectrum in flight, Hz."""
        return np.fft.rfftfreq(BLOCKS * TAPS, self.dt)


def filtered(weights: Array, taps: Array) -> Array:
    """Rate, angular acceleration and force by filters, (3, TAPS), (9,)."""
    rows = weights.dot(taps)
    return np.concatenate([rows[0, :3], rows[1, :3], rows[2, 3:]])


def measure_powers(samples: Array, dt: float) -> Array:
    """One-sided power densities of rate and force, mean of their axes, behind Hann's window, (2, K)."""
    window = np.sin(np.pi * np.arange(len(samples)) / len(samples)) ** 2
    found = np.fft.rfft(samples.T * window)
    parts = (found.real**2 + found.imag**2) * (2 * dt / np.sum(window**2))
    return np.asarray(parts.reshape(2, 3, -1).mean(axis=1))


def passing(gains: Pid, f: Array) -> Array:
    """|G|² of ``G = s / (s³ + kd s² + kp s + ki)``, from an acceleration to the angle's error, over its largest."""
    s = 2j * np.pi * f
    power = np.abs(s / (s**3 + gains.kd * s**2 + gains.kp * s + gains.ki + 1e-12)) ** 2
    return np.asarray(power / power.max() + FLOOR)


def waves(amplitudes: Array) -> Array:
    """``Σ Re(a_k exp(2πi k n / N))`` of N/2 + 1 amplitudes, for every tap n, (TAPS,)."""
    halved = amplitudes.copy()
    halved[1:-1] /= 2
    size = 2 * (len(amplitudes) - 1)
    return np.asarray(size * np.fft.irfft(halved, size)[:TAPS])
