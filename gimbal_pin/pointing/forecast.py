"""The platform's motion at the moment at which the torque acts, from the last samples of its IMU (Wiener's filter)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_toeplitz

from gimbal_pin.control.aim import Carried
from gimbal_pin.control.base import Pid
from gimbal_pin.log import Array
from gimbal_pin.pointing.spectrum import Spectrum

TAPS = 128
"""Samples that it looks back on."""
FLOOR = 1e-4
"""Weight of an error where the loop suppresses it best, against where it does so worst."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """``x(t + lead) ≈ Σ h_k z(t - k dt)``, h the filter of least error after the loop: ``min E|G (x̂ - x)|²``.

    The spectrum says what is signal, what is noise, and how far the one can be foreseen: a smooth motion by its
    derivatives, a propeller by its period, white noise not at all. G is how the loop answers an acceleration: what it
    suppresses by itself may be foreseen less well. Normal equations are Toeplitz: ``r = ∫ W (S + N) cos ωτ``.

    Attributes:
        spectrum: How the platform moves.
        gains: The outer loop, which says G, one per lead.
        dt: Sampling interval, s.
        leads: How far ahead, s.
    """

    spectrum: Spectrum
    gains: tuple[Pid, ...]
    dt: float
    leads: tuple[float, ...]

    @cached_property
    def weights(self) -> tuple[Array, ...]:
        """Per lead, what gives rate, angular acceleration and, in the last row, the force, (3, TAPS)."""
        known = self.spectrum.until(0.5 / self.dt)
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

    def ahead(self, memory: Array) -> list[Carried]:
        """The platform's motion, one per lead."""
        foreseen = [weights.dot(memory) for weights in self.weights]
        return [Carried(found[2, 3:], found[0, :3], found[1, :3]) for found in foreseen]

    def start(self, w: Array, f: Array) -> Array:
        """Memory for a platform that has always moved as in the first sample, (TAPS, 6), newest first."""
        return np.tile(np.concatenate([w, f]), (TAPS, 1))

    def step(self, memory: Array, w: Array, f: Array) -> Array:
        """Memory with the next sample."""
        return np.concatenate([w, f, memory.ravel()[:-6]]).reshape(TAPS, 6)


def passing(gains: Pid, f: Array) -> Array:
    """|G|² of ``G = s / (s³ + kd s² + kp s + ki)``, from an acceleration to the angle's error, over its largest."""
    s = 2j * np.pi * f
    power = np.abs(s / (s**3 + gains.kd * s**2 + gains.kp * s + gains.ki + 1e-12)) ** 2
    return np.asarray(power / power.max() + FLOOR)


def solved(
    f: Array, power: Array, noise: float, weight: Array, dt: float, lead: float, derivatives: Sequence[int]
) -> Array:
    """Filters, (len(derivatives), TAPS), that give derivatives (0 or 1) of a signal `lead` s ahead."""
    signal, omega, tau = weight * power, 2 * np.pi * f, dt * np.arange(TAPS)
    column = np.cos(np.outer(tau, omega)) @ (signal + weight * noise)
    column[0] *= 1 + 1e-9
    ahead = np.outer(tau + lead, omega)
    right = {0: lambda: np.cos(ahead) @ signal, 1: lambda: -np.sin(ahead) @ (signal * omega)}
    return np.asarray(solve_toeplitz(column, np.stack([right[k]() for k in derivatives], axis=1)).T)
