"""Has the payload changed? Innovations, whitened, against what a change would add to them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular, toeplitz
from scipy.special import chdtri

from gimbal_pin.estimators.base import LAGS, tapered
from gimbal_pin.log import Array
from gimbal_pin.online.recursive import Known

WINDOWS = (4, 8, 16)
"""Rows that are looked back at, two per period of the cutoff: a large change shows in few, a small one takes more."""
CHANCE = 1e-9
"""Chance of a false alarm per look and window, if the noise is as it was."""
SEEN = 0.1
"""Share of a row's samples that must not be masked out for it to count."""


class Score(NamedTuple):
    """``T``, chi-square with `freedom` degrees if nothing has changed, of the newest `rows` rows."""

    value: float
    freedom: int
    rows: int

    @property
    def mean(self) -> float:
        """T over its expectation."""
        return self.value / max(self.freedom, 1)

    def alarms(self, dispersion: float) -> bool:
        """Whether T is beyond chance, for noise whose T has come out `dispersion` times its expectation so far."""
        return self.freedom > 0 and self.value > dispersion * float(chdtri(self.freedom, CHANCE))


def score(rows: Array, known: Known, directions: Array) -> Score:
    """``T = max_γ log-likelihood ratio``: by how much a change γ along D explains the innovations better than none.

    Innovations ``e = b - A theta`` of all joints, stacked, have the covariance ``Γ + A P Aᵀ``: the noise's own
    autocovariance and what is not known of theta. Whitened by its triangular factor they are regressed on ``A D``,
    whitened likewise; T is the part that this explains (Willsky and Jones 1976, a generalised likelihood ratio).

    Args:
        rows: ``[A b share]`` of the newest rows, (m, n, k + 2).
        known: What was known before them.
        directions: D, (k, r).
    """
    theta, P = known.estimate.theta, known.estimate.covariance
    share = rows[:, :, -1]
    parts = [np.flatnonzero(seen) for seen in share.T > SEEN]
    A = np.concatenate([rows[at, j, :-2] for j, at in enumerate(parts)])
    e = np.concatenate([rows[at, j, -2] for j, at in enumerate(parts)]) - A @ theta
    if not len(e):
        return Score(0.0, 0, len(rows))
    spread = A @ P @ A.T
    begin = 0
    for j, at in enumerate(parts):
        end = begin + len(at)
        spread[begin:end, begin:end] += noise(known.gamma[:, j], at, share[at, j])
        begin = end
    L = np.linalg.cholesky(spread)
    white = solve_triangular(L, np.column_stack([A @ directions, e]), lower=True, check_finite=False)
    return explained(white[:, :-1], white[:, -1], len(rows))


def noise(gamma: Array, at: Array, share: Array) -> Array:
    """Covariance of one joint's residuals at some rows, (N m)², tapered so that it is one, with a floor of 1 %."""
    column = np.zeros(int(at[-1]) + 1 if len(at) else 0)
    lags = min(len(column), LAGS + 1)
    column[:lags] = (gamma * tapered())[:lags]
    out = toeplitz(column)[np.ix_(at, at)] * np.outer(share, share)
    out[np.diag_indices_from(out)] += 0.01 * gamma[0] + 1e-300
    return np.asarray(out)


def explained(columns: Array, e: Array, rows: int) -> Score:
    """Part of ``eᵀe`` that lies in the columns' span, and its dimension."""
    size = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    keep = values > 1e-6 * max(values[0], 1e-300)
    return Score(float(np.sum((left[:, keep].T @ e) ** 2)), int(keep.sum()), rows)


def onset(rows: Array, known: Known, directions: Array) -> int:
    """Row since which a change explains the rows best: of all the ends of the window the one of the least chance."""
    scores = [score(rows[begin:], known, directions) for begin in range(len(rows))]
    # Wilson and Hilferty: how many standard deviations a chi-square of f degrees is above its mean.
    f = np.array([max(s.freedom, 1) for s in scores])
    z = (np.cbrt(np.array([s.value for s in scores]) / f) - (1 - 2 / (9 * f))) / np.sqrt(2 / (9 * f))
    return int(np.argmax(z))
