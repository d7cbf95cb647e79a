"""A vector signal, its derivatives and its near future from noisy samples, by a steady-state Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial, pi

import numpy as np

from gimbal_pin.log import Array


@dataclass(frozen=True)
class Predictor:
    """``x⁺ = A x``, ``z = x_0 + noise``: a chain of integrators that white noise drives at its end.

    As a continuous filter it has Butterworth's poles at `cutoff` (the spectral factor of q/r = ω^(2 order)): no lag of
    the signal in the pass band, nor of its derivatives, and `order` orders of fall above it.

    Attributes:
        order: States per axis: the signal and its derivatives.
        cutoff: Bandwidth, Hz.
        dt: Sampling interval, s.
    """

    order: int
    cutoff: float
    dt: float

    @cached_property
    def transition(self) -> Array:
        """A, (order, order)."""
        return np.array([self.row(self.dt, k) for k in range(self.order)])

    @cached_property
    def gain(self) -> Array:
        """Steady-state gain K of ``x = x⁻ + K (z - x⁻_0)``, (order, 1)."""
        from scipy.linalg import solve_discrete_are

        scale = np.array([self.dt**k for k in range(self.order)])
        unit = Predictor(self.order, self.cutoff, 1.0).transition
        H = np.eye(1, self.order)
        Q = driven(self.order) * (2 * pi * self.cutoff * self.dt) ** (2 * self.order)
        P = solve_discrete_are(unit.T, H.T, Q, np.eye(1))
        return np.asarray(P @ H.T / (H @ P @ H.T + 1)) / scale[:, None]

    def row(self, lead: float, derivative: int = 0) -> Array:
        """Weights of the states that give a derivative of the signal `lead` s ahead, (order,)."""
        powers = range(-derivative, self.order - derivative)
        return np.array([lead**k / factorial(k) if k >= 0 else 0.0 for k in powers])

    def start(self, sample: Array) -> Array:
        """States for a signal that has stood still at a sample, (order, 3)."""
        return np.vstack([sample, np.zeros((self.order - 1, len(sample)))])

    def step(self, x: Array, sample: Array) -> Array:
        """Return the states with the next sample, (order, 3)."""
        ahead = self.transition @ x
        return np.asarray(ahead + self.gain * (sample - ahead[0]))


def driven(order: int) -> Array:
    """Covariance that unit white noise on the highest state's derivative leaves in the chain after one second."""
    powers = np.array([order - 1 - k for k in range(order)])
    factors = np.array([factorial(p) for p in powers.tolist()])
    sums = powers[:, None] + powers[None, :] + 1
    return np.asarray(1.0 / (sums * factors[:, None] * factors[None, :]))
