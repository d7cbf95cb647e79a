"""Has the payload changed? Innovations, whitened, against what a change would add to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri

from gimbal_pin.estimators.base import LAGS, tapered
from gimbal_pin.log import Array
from gimbal_pin.online.recursive import Known

WINDOWS = (4, 8, 16)
"""Rows that are looked back at, two per period of the cutoff: a large change shows in few, a small one takes more."""
LONGER = 2
"""A window's score must be beyond chance for as many rows as it has and so many more: one row, or a passage near
standstill that the model does not describe, is no payload."""
CHANCE = 1e-9
"""Chance of a false alarm per look and window, if the noise is as it was."""
SEEN = 0.5
"""Share of a row's samples that must not be masked out for it to count."""
OFF = 5.0
"""Standard deviations from which on a row is taken to be of another payload, once one was announced."""
SILENT = 1e-9
"""No torque is known better than this, N m."""
FLOOR = 0.01
"""White noise that is added to the noise's autocovariance, in shares of its power."""


class Score(NamedTuple):
    """``T``, chi-square with `freedom` degrees if nothing has changed, of the newest rows."""

    value: float
    freedom: int

    @property
    def mean(self) -> float:
        """T over its expectation."""
        return self.value / max(self.freedom, 1)

    def alarms(self, dispersion: float) -> bool:
        """Whether T is beyond chance, for noise whose T has come out `dispersion` times its expectation so far."""
        return self.freedom > 0 and self.value > dispersion * float(chdtri(self.freedom, CHANCE))


def scores(rows: Array, known: Known, directions: Array, doubt: Array, counts: Sequence[int]) -> list[Score]:
    """``T = max_γ log-likelihood ratio``: by how much a change γ along D explains the innovations better than none.

    Innovations ``e = b - A theta`` of all joints, stacked, have the covariance ``Γ + A P Aᵀ``: the noise's own
    autocovariance and what is not known of theta, friction being doubted beyond its estimate, for it is never quite
    Coulomb's and warms up. Whitened by its triangular factor they are regressed on ``A D``,
    whitened likewise; T is the part that this explains (Willsky and Jones 1976, a generalised likelihood ratio). With
    the newest row first, the factor of fewer rows is the upper left part of that of all.

    Args:
        rows: ``[A b share]`` of the newest rows, oldest first, (m, n, k + 2).
        known: What was known before them.
        directions: D, (k, r).
        doubt: Standard deviation of each parameter beyond its estimated one, in shares of its value, (k,).
        counts: How many of the newest rows each score takes.
    """
    newest = rows[::-1] * (rows[::-1, :, -1:] > SEEN)
    m, n, _ = newest.shape
    flat = newest.reshape(m * n, -1)
    A = flat[:, :-2]
    spread = A @ (known.spread + np.diag((doubt * known.estimate.theta) ** 2)) @ A.T
    blocks = np.einsum("tjsj->jts", spread.reshape(m, n, m, n))  # a view
    blocks += noise(known.gamma, newest[:, :, -1])
    L = np.linalg.cholesky(spread)
    data = np.column_stack([A @ directions, flat[:, -2] - A @ known.estimate.theta])
    white = solve_triangular(L, data, lower=True, check_finite=False)
    squares = np.stack([white[: n * count].T @ white[: n * count] for count in counts])
    return explained(squares)


def noise(gamma: Array, share: Array) -> Array:
    """Covariance of each joint's residuals at consecutive rows, (N m)², (n, m, m); one for rows that do not count.

    Args:
        gamma: Autocovariance, (LAGS + 1, n).
        share: How much of each row was not masked out, zero for those that do not count, (m, n).
    """
    m = len(share)
    lags = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
    taper = np.append(tapered(), 0.0)
    shape = np.vstack([gamma, np.zeros(gamma.shape[1])]) * taper[:, None]
    shape[0] += FLOOR * gamma[0] + SILENT**2
    # The mean of a share of the samples has noise as the root of that share.
    size = np.sqrt(share.T)
    out = shape[np.minimum(lags, LAGS + 1)].transpose(2, 0, 1) * (size[:, :, None] * size[:, None, :])
    each = np.arange(m)
    out[:, each, each] += share.T == 0.0
    return np.asarray(out)


def explained(squares: Array) -> list[Score]:
    """Part of ``eᵀe`` that lies in the columns C' span, and its dimension, from ``[C e]ᵀ[C e]``, (w, r + 1, r + 1)."""
    normal, right = squares[:, :-1, :-1], squares[:, :-1, -1]
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-300))
    values, vectors = np.linalg.eigh(normal / (size[:, :, None] * size[:, None, :]))
    keep = values > 1e-9 * np.maximum(values[:, -1:], 1e-300)
    parts = np.einsum("wij,wi->wj", vectors, right / size) ** 2 / np.where(keep, values, 1.0)
    found = np.sum(np.where(keep, parts, 0.0), axis=1)
    return [Score(value, count) for value, count in zip(found.tolist(), keep.sum(axis=1).tolist())]


def onset(rows: Array, known: Known, dispersion: float) -> int:
    """Return the first of the rows whose torque is `OFF` standard deviations off on any joint; the last if none is."""
    A, share = rows[:, :, :-2], rows[:, :, -1]
    error = rows[:, :, -2] - A @ known.estimate.theta
    own = known.gamma[0] * share + np.einsum("tja,ab,tjb->tj", A, known.spread, A, optimize=True)
    off = np.any((share > SEEN) & (error**2 > OFF**2 * dispersion * own), axis=1)
    return int(np.argmax(off)) if off.any() else len(rows) - 1
