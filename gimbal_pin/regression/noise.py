"""Coloured noise: each joint's residual as an autoregressive process, fitted to its autocovariance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block

ORDER = 12
"""Highest order: six periods of the cutoff."""
STABLE = 0.995
"""A reflection coefficient beyond this ends the recursion."""


class Autoregression(NamedTuple):
    """``e_t + Σ_l polynomial[l] e_{t-l} = ε_t``, the variance of ε being `power`, (N m)²."""

    polynomial: Array
    power: float

    def whiten(self, x: Array) -> Array:
        """Turn e into ε along the first axis."""
        return np.asarray(lfilter(self.polynomial, [1.0], x, axis=0))

    def colour(self, x: Array) -> Array:
        """Turn ε into e along the first axis."""
        return np.asarray(lfilter([1.0], self.polynomial, x, axis=0))


def join_blocks(blocks: Sequence[Block]) -> list[Block]:
    """Join the blocks of one segment: correlation does not end where a chunk does, but it does across a gap."""
    gaps = [np.diff(block.t) for block in blocks if len(block.t) > 1]
    step = float(np.median(np.concatenate(gaps))) if gaps else 0.0
    runs: list[list[Block]] = []
    for block in blocks:
        if runs and 0 < block.t[0] - runs[-1][-1].t[-1] < 1.5 * step:
            runs[-1].append(block)
        else:
            runs.append([block])
    return [
        Block(*(np.concatenate(x) for x in zip(*run))) if len(run) > 1 else run[0] for run in runs
    ]


def compute_autocovariance(errors: Sequence[Array], shares: Sequence[Array]) -> Array:
    """Autocovariance at lags 0 ... `ORDER` of residuals (m, n) where their rows count, (ORDER + 1, n)."""
    total = np.zeros((ORDER + 1, errors[0].shape[1]))
    count = np.zeros_like(total)
    for error, share in zip(errors, shares):
        for lag in range(min(ORDER, len(error) - 1) + 1):
            total[lag] += np.sum(error[: len(error) - lag] * error[lag:], axis=0)
            count[lag] += np.sum(share[: len(share) - lag] * share[lag:], axis=0)
    return total / np.maximum(count, 1.0)


def fit_autoregression(gamma: Array, rows: float) -> Autoregression:
    """Process of an autocovariance, (lags + 1,), of so many rows N, by Levinson's recursion.

    Its order p is that of the least ``N log power + 2 (p + 1) N / (N - p - 2)``, Akaike's criterion for few rows
    (Hurvich and Tsai 1989): plain, it takes twelve coefficients of fifty rows for granted, and intervals are too
    narrow. The power is that of N - p rows: so many are left.
    """
    polynomial = np.ones(1)
    power = max(float(gamma[0]), 0.0)
    best = Autoregression(polynomial, power)
    least = np.inf
    for order in range(len(gamma)):
        left = rows - order - 2
        if power <= 1e-12 * gamma[0] or gamma[0] <= 0 or (order and left <= 0):
            break
        score = rows * np.log(power) + 2 * (order + 1) * rows / max(left, 1.0)
        if score < least:
            best = Autoregression(polynomial, power * rows / max(rows - order, 1.0))
            least = score
        if order == len(gamma) - 1:
            break
        reflection = -float(polynomial @ gamma[order + 1 : 0 : -1]) / power
        if abs(reflection) > STABLE:
            break
        longer = np.append(polynomial, 0.0)
        polynomial = longer + reflection * longer[::-1]
        power *= 1 - reflection**2
    return best


def count_independent_rows(gamma: Array, rows: Array) -> Array:
    """``N / (1 + 2 Σ ρ²)``, (n,): independent rows that tell a power as well as N of this autocovariance do.

    Bartlett, J. R. Statist. Soc. Suppl. 8 (1946).

    Args:
        gamma: Autocovariance at lags from 0, (lags + 1, n).
        rows: N, (n,).
    """
    correlation = gamma[1:] / np.maximum(gamma[0], 1e-300)
    return np.asarray(rows / (1 + 2 * np.sum(correlation**2, axis=0)))
