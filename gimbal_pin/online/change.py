"""Has the payload changed? Innovations, whitened, against what a change would add to them."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import chdtri, fdtri

from gimbal_pin.log.log import Array
from gimbal_pin.regression import LAGS, Known, taper_lags
from gimbal_pin.rig.brief import brief

WINDOWS = (4, 8, 16)
"""Rows that are looked back at, two per period of the cutoff: a large change shows in few, a small one takes more."""
LONGER = 7
"""Consecutive rows without which, whichever they are, a change must still show: the filters spread one push, or a
passage near standstill that the model does not describe, over six or so."""
KEPT = (2, *WINDOWS)
"""Rows that are left of a window then."""
LOOK = max(KEPT) + LONGER
"""Newest rows that are looked at."""
CHANCE = 1e-9
"""Chance of a false alarm per look and window, if the noise is as it was."""
EARLY = 1e-6
"""The same while the noise itself is known from few rows only: then a score has heavier tails than any that counts."""
ALIKE = 2.5
"""Rows, half a period of the cutoff apart, that tell as much of slow noise's power as one would of white noise's."""
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

    def alarms(self, dispersion: float, squares: float = inf) -> bool:
        """Whether T is beyond chance, for noise whose T has come out `dispersion` times its expectation so far.

        Args:
            dispersion: As above.
            squares: From how many squares the noise's power is known; T over its freedom then has Fisher's F
                distribution in the place of chi-square's.
        """
        if self.freedom == 0:
            return False
        if squares == inf:
            return self.value > dispersion * float(chdtri(self.freedom, CHANCE))
        return squares > 0 and self.mean > dispersion * float(fdtri(self.freedom, squares, 1 - EARLY))


class Watch(NamedTuple):
    """What the newest rows are compared with.

    Attributes:
        theta: Parameters, (k,).
        spread: Their covariance, friction being doubted beyond it, (k, k).
        noise: Covariance of each joint's residuals at consecutive rows, (N m)², (n, m, m).
        directions: How a change moves the parameters, (k, r).
    """

    theta: Array
    spread: Array
    noise: Array
    directions: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @staticmethod
    def of(known: Known, directions: Array, doubt: Array) -> Watch:
        """Return it for an estimate.

        Args:
            known: The estimate.
            directions: As above.
            doubt: By what share of its value each parameter may be off without a change, (k,): friction is never quite
                Coulomb's, and warms up.
        """
        theta, m = known.estimate.theta, LOOK
        lags = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
        shape = np.zeros((LAGS + 2, known.gamma.shape[1]))
        shape[:-1] = known.gamma * taper_lags()[:, None]
        shape[0] += FLOOR * known.gamma[0] + SILENT**2
        noise = shape[np.minimum(lags, LAGS + 1)].transpose(2, 0, 1)
        return Watch(theta, known.spread + np.diag((doubt * theta) ** 2), noise, directions)


def scores(rows: Array, watch: Watch) -> list[Score]:
    """``T = max_γ log-likelihood ratio``: by how much a change γ along D explains the innovations better than none.

    Innovations ``e = b - A theta`` of all joints, stacked, have the covariance ``Γ + A P Aᵀ``: the noise's own
    autocovariance and what is not known of theta. Whitened by its triangular factor they are regressed on ``A D``,
    whitened likewise; T is the part that this explains (Willsky and Jones 1976, a generalised likelihood ratio). With
    the newest row first, the factor of fewer rows is the upper left part of that of all.

    Args:
        rows: ``[A b share]`` of the newest rows, oldest first, (m, n, k + 2), m the longest of `WINDOWS`.
        watch: What was known before them.

    Returns:
        One per window.
    """
    white = whitened(rows[::-1], np.arange(len(rows)), watch)
    return explained(gram_matrices(white, rows.shape[1], WINDOWS))


def scores_without_transient(rows: Array, watch: Watch) -> list[Score]:
    """Return what `scores` does, of so many more rows, without those `LONGER` that tell most of a change.

    A push, or one passage that the model does not describe, then leaves nothing; a payload leaves what the other rows
    say. Their covariance is that of the rows that stay, so that nothing of the others is in them.

    Args:
        rows: The newest rows, oldest first, (LOOK, n, k + 2).
        watch: What was known before them.

    Returns:
        One per entry of `KEPT`.
    """
    newest, found = rows[::-1], []
    for begin in range(max(KEPT) + 1):
        at = np.delete(np.arange(LOOK), slice(begin, begin + LONGER))
        counts = [count for count in KEPT if count >= begin]
        found.append(explained(gram_matrices(whitened(newest[at], at, watch), rows.shape[1], counts))[::-1])
    each = ([one[k] for one in found if k < len(one)] for k in range(len(KEPT)))
    return [min(some, key=lambda score: score.mean) for some in each][::-1]


def gram_matrices(white: Array, n: int, counts: Sequence[int]) -> Array:
    """``[C e]ᵀ[C e]`` of the newest rows of n joints, as many as each count says, (len(counts), r + 1, r + 1)."""
    return np.stack([white[: n * count].T @ white[: n * count] for count in counts])


def whitened(newest: Array, at: NDArray[np.integer[Any]], watch: Watch) -> Array:
    """Return ``L⁻¹ [A D  b - A theta]`` with the factor of their covariance, (m n, r + 1).

    Args:
        newest: ``[A b share]``, newest first, (m, n, k + 2).
        at: How many rows ago each of them was, (m,).
        watch: What was known before them.
    """
    newest = newest * (newest[:, :, -1:] > SEEN)
    m, n, _ = newest.shape
    flat = newest.reshape(m * n, -1)
    A, share = flat[:, :-2], newest[:, :, -1].T
    spread = A @ watch.spread @ A.T
    blocks = np.einsum("tjsj->jts", spread.reshape(m, n, m, n))  # a view
    # The mean of a share of the samples has noise as the root of that share.
    size = np.sqrt(share)
    blocks += watch.noise[:, at[:, None], at] * (size[:, :, None] * size[:, None, :])
    spread[np.diag_indices(m * n)] += share.T.ravel() == 0.0
    L = np.linalg.cholesky(spread)
    data = np.concatenate([A @ watch.directions, (flat[:, -2] - A @ watch.theta)[:, None]], axis=1)
    return np.asarray(solve_triangular(L, data, lower=True, check_finite=False))


def explained(squares: Array) -> list[Score]:
    """Part of ``eᵀe`` that lies in the columns C' span, and its dimension, from ``[C e]ᵀ[C e]``, (w, r + 1, r + 1)."""
    normal, right = squares[:, :-1, :-1], squares[:, :-1, -1]
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-300))
    values, vectors = np.linalg.eigh(normal / (size[:, :, None] * size[:, None, :]))
    keep = values > 1e-9 * np.maximum(values[:, -1:], 1e-300)
    parts = np.einsum("wij,wi->wj", vectors, right / size) ** 2 / np.where(keep, values, 1.0)
    found = np.sum(np.where(keep, parts, 0.0), axis=1)
    return [Score(value, count) for value, count in zip(found.tolist(), keep.sum(axis=1).tolist())]


def onset(rows: Array, watch: Watch, dispersion: float) -> int:
    """Return the first of the rows whose torque is `OFF` standard deviations off on any joint; the last if none is."""
    A, share = rows[:, :, :-2], rows[:, :, -1]
    error = rows[:, :, -2] - A @ watch.theta
    own = watch.noise[:, 0, 0] * share + np.einsum("tja,ab,tjb->tj", A, watch.spread, A, optimize=True)
    off = np.any((share > SEEN) & (error**2 > OFF**2 * dispersion * own), axis=1)
    return int(np.argmax(off)) if off.any() else len(rows) - 1
