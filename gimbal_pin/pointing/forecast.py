"""The platform's motion at the moment at which the torque acts, from the last samples of its IMU (Wiener's filter)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import exp
from operator import lt
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz

from gimbal_pin.control.laws.aim import Carried
from gimbal_pin.control.laws.base import Pid
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.spectrum import Spectrum

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
        weights: The filters in use, one per lead, see `Forecast.solved`.
        found: Motion at every lead, rate, angular acceleration and force, (9,) each.
        due: What was foreseen and what was held for the last lead, dw and f, oldest first, (2, 6) each.
        smooth: The errors of both behind a low-pass of the loop's crossover, (2, 6).
        scores: Mean squares of both one's errors: of dw and f, all and the slow part of them, (2, 4).
        trust: Share of the forecast that is used, 0 to 1.
        used: Whether it is in force as far as events say; before `SETTLED` it counts as such.
        samples: Samples so far.
        blocks: Blocks of samples that the next spectrum is measured in.
        power: Mean power densities in flight, rate and force, (2, K), and of how many spectra; None: no flight yet.
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

    @property
    def foresees(self) -> bool:
        """Whether there is anything to foresee."""
        return any(self.leads)

    @cached_property
    def weights(self) -> tuple[Array, ...]:
        """The filters before the flight, one per lead."""
        return self.solved(self.spectrum)

    def solved(self, spectrum: Spectrum) -> tuple[Array, ...]:
        """Per lead, what gives rate, angular acceleration and, in the last row, the force, (3, TAPS)."""
        known = spectrum.until(0.5 / self.dt)
        rows = [(passing(gains, known.f), self.dt, lead) for gains, lead in zip(self.gains, self.leads)]
        return tuple(
            np.vstack(
                [
                    solved(known.f, known.rate, known.rate_noise, *row, (0, 1)),
                    solved(known.f, known.force, known.force_noise, *row, (0,)),
                ]
            )
            for row in rows
        )

    def held(self, taps: Array) -> Array:
        """What was measured last, half a sample ago: rate, angular acceleration, force, (9,)."""
        now, before = taps[0], taps[1]
        mean, change = (now + before) / 2, (now[:3] - before[:3]) / self.dt
        return np.concatenate([mean[:3], change, mean[3:]])

    @cached_property
    def due(self) -> int:
        """Samples after which what was foreseen for the last lead is what was measured last."""
        return max(1, int(self.leads[-1] / self.dt + 0.5))

    @cached_property
    def shares(self) -> tuple[float, float]:
        """Shares of a new error in the slow errors and in the mean squares; ``√kp`` is about a loop's crossover."""
        return 1 - exp(-self.dt * self.gains[-1].kp ** 0.5), 1 - exp(-self.dt / JUDGED)

    def ahead(self, past: Past) -> list[Carried]:
        """The platform's motion, one per lead."""
        return [Carried(x[6:], x[:3], x[3:6]) for x in past.found]

    def start(self, w: Array, f: Array) -> Past:
        """Memory for a platform that has always moved as in the first sample."""
        taps = np.tile(np.concatenate([w, f]), (TAPS, 1))
        none, weights = self.held(taps), self.weights if self.foresees else ()
        due = (np.stack([none[3:], none[3:]]),) * self.due
        return Past(taps, weights, (none,) * len(self.leads), due, np.zeros((2, 6)), np.zeros((2, 4)))

    def step(self, past: Past, t: float, w: Array, f: Array) -> Past:
        """Memory with the next sample, at time t, s."""
        taps = np.concatenate([w, f, past.taps.ravel()[:-6]]).reshape(TAPS, 6)
        none = self.held(taps)
        if not self.foresees:
            return past._replace(taps=taps, found=(none,) * len(self.leads))
        far = [filtered(weights, taps) for weights in past.weights]
        due, smooth, scores, trust = self.compared(past, none[3:], far[-1][3:])
        found = tuple([none + trust * (x - none) for x in far])
        used, events = past.used, past.events
        if trust == (0.0 if used else 1.0) and past.samples * self.dt > SETTLED:
            used = not used
            said = (
                "the forecast errs less than none again" if used else "the forecast errs more than none: none is used"
            )
            events = (*events, f"{t:.3f} s: {said}")[:MOST]
        after = Past(
            taps,
            past.weights,
            found,
            due,
            smooth,
            scores,
            trust,
            used,
            past.samples + 1,
            past.blocks,
            past.power,
            events,
        )
        return self.learned(after) if self.learns and after.samples % TAPS == 0 else after

    def compared(self, past: Past, none: Array, far: Array) -> tuple[tuple[Array, ...], Array, Array, float]:
        """Judge what comes due; return what is to come, slow errors, mean squares, and trust."""
        slow, mean = self.shares
        errors = past.due[0] - none
        smooth = past.smooth + slow * (errors - past.smooth)
        both = np.concatenate([errors, smooth], axis=1)
        scores = past.scores + mean * ((both * both).dot(THREES) - past.scores)
        foreseen, held = scores.tolist()
        better = all(map(lt, foreseen, held))
        trust = min(1.0, past.trust + self.dt / RISE) if better else max(0.0, past.trust - self.dt / FALL)
        return (*past.due[1:], np.array([far, none])), smooth, scores, trust

    def learned(self, past: Past) -> Past:
        """Memory after a block of samples: a spectrum every `EVERY` of them, its filters one block later."""
        blocks, number = (*past.blocks, past.taps[::-1])[-BLOCKS:], past.samples // TAPS
        if number >= BLOCKS and number % EVERY == 0:
            before, seen = (0.0, 0) if past.power is None else past.power
            power = before + (powers(np.concatenate(blocks), self.dt) - before) / min(seen + 1, SPECTRA)
            return past._replace(blocks=blocks, power=(power, seen + 1))
        if past.power is not None and number % EVERY == 1:
            f = np.fft.rfftfreq(BLOCKS * TAPS, self.dt)
            return past._replace(blocks=blocks, weights=self.solved(Spectrum.of_powers(f, *past.power[0])))
        return past._replace(blocks=blocks)


def filtered(weights: Array, taps: Array) -> Array:
    """Rate, angular acceleration and force by filters, (3, TAPS), (9,)."""
    rows = weights.dot(taps)
    return np.concatenate([rows[0, :3], rows[1, :3], rows[2, 3:]])


def powers(samples: Array, dt: float) -> Array:
    """One-sided power densities of rate and force, mean of their axes, behind Hann's window, (2, K)."""
    window = hann(len(samples))
    parts = np.abs(np.fft.rfft(samples * window[:, None], axis=0)) ** 2 * (2 * dt / np.sum(window**2))
    return np.stack([parts[:, :3].mean(axis=1), parts[:, 3:].mean(axis=1)])


@lru_cache(maxsize=1)
def hann(samples: int) -> Array:
    """Hann's window, periodic."""
    return np.asarray(np.sin(np.pi * np.arange(samples) / samples) ** 2)


def passing(gains: Pid, f: Array) -> Array:
    """|G|² of ``G = s / (s³ + kd s² + kp s + ki)``, from an acceleration to the angle's error, over its largest."""
    s = 2j * np.pi * f
    power = np.abs(s / (s**3 + gains.kd * s**2 + gains.kp * s + gains.ki + 1e-12)) ** 2
    return np.asarray(power / power.max() + FLOOR)


def solved(
    f: Array, power: Array, noise: float, weight: Array, dt: float, lead: float, derivatives: Sequence[int]
) -> Array:
    """Filters, (len(derivatives), TAPS), that give derivatives (0 or 1) of a signal `lead` s ahead."""
    signal, omega = weight * power, 2 * np.pi * f
    column = waves(len(f), float(f[1]), dt, 0.0)[0] @ (signal + weight * noise)
    column[0] *= 1 + 1e-9
    cosines, sines = waves(len(f), float(f[1]), dt, lead)
    right = {0: lambda: cosines @ signal, 1: lambda: -sines @ (signal * omega)}
    return np.asarray(solve_toeplitz(column, np.stack([right[k]() for k in derivatives], axis=1)).T)


@lru_cache(maxsize=8)
def waves(count: int, step: float, dt: float, lead: float) -> tuple[Array, Array]:
    """Cosines and sines of every tap's age plus a lead, at frequencies ``step·k``, (TAPS, count) each."""
    angles = np.outer(dt * np.arange(TAPS) + lead, 2 * np.pi * step * np.arange(count))
    return np.cos(angles), np.sin(angles)
