"""Has the payload changed? Innovations, whitened, against what a change would add to them."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri, fdtri

from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block, Indices, compute_residuals
from gimbal_pin.rig.brief import brief

SWAP_WINDOWS = (4, 8, 16)
"""Rows that are looked back at, two per period of the cutoff: a large change shows in few, a small one takes more."""
PUSH_ROWS = 7
"""Consecutive rows without which, whichever they are, a change must still show: the filters spread one push, or a
passage near standstill that the model does not describe, over six or so."""
LEFT_ROWS = (2, *SWAP_WINDOWS)
"""Rows that are left of a window then."""
LOOK = max(LEFT_ROWS) + PUSH_ROWS
"""Newest rows that are looked at."""
SWAP_CHANCE = 1e-9
"""Chance of a false alarm per look and window, if the noise is as it was."""
EARLY_CHANCE = 1e-6
"""The same while the noise itself is known from few rows only: then a score has heavier tails than any that counts."""
UNMASKED_SHARE = 0.5
"""Share of a row's samples that must not be masked out for it to count."""
ONSET_DEVIATIONS = 5.0
"""Standard deviations from which on a row is taken to be of another payload, once one was announced."""
SILENT = 1e-9
"""No torque is known better than this, N m."""
ADDED_WHITE_NOISE = 0.01
"""White noise that is added to the noise's autocovariance, in shares of its power."""


class Score(NamedTuple):
    """``T``, chi-square with `freedom` degrees if nothing has changed, of the newest rows."""

    value: float
    freedom: int

    @property
    def mean(self) -> float:
        """T over its expectation."""
        return self.value / max(self.freedom, 1)

    def is_alarm(self, dispersion: float, squares: float = inf) -> bool:
        """Whether T is beyond chance, for noise whose T has come out `dispersion` times its expectation so far.

        Args:
            dispersion: As above.
            squares: From how many squares the noise's power is known; T over its freedom then has Fisher's F
                distribution in the place of chi-square's.
        """
        if self.freedom == 0:
            return False
        if squares == inf:
            return self.value > dispersion * float(chdtri(self.freedom, SWAP_CHANCE))
        return squares > 0 and self.mean > dispersion * float(fdtri(self.freedom, squares, 1 - EARLY_CHANCE))


class Expectation(NamedTuple):
    """What the newest rows are compared with.

    Attributes:
        theta: Parameters, (k,).
        covariance: Theirs, friction being doubted beyond it, (k, k).
        gamma: Autocovariance of each joint's residual, (N m)², (LOOK, n).
        directions: How a change moves the parameters, (k, r).
    """

    theta: Array
    covariance: Array
    gamma: Array
    directions: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    def whiten(self, rows: Block, ago: Indices) -> Array:
        """Return ``L⁻¹ [A D  b - A theta]`` with the factor of their covariance, (m n, r + 1).

        Innovations ``e = b - A theta`` of all joints, stacked, have the covariance ``Γ + A P Aᵀ``: the noise's own
        autocovariance and what is not known of theta.

        Args:
            rows: Rows, newest first.
            ago: How many rows ago each of them was, (m,).
        """
        m, n, _ = rows.A.shape
        seen = rows.share > UNMASKED_SHARE
        A, share = (rows.A * seen[:, :, None]).reshape(m * n, -1), rows.share * seen
        spread = A @ self.covariance @ A.T
        blocks = np.einsum("tjsj->jts", spread.reshape(m, n, m, n))  # a view
        # The mean of a share of the samples has noise as the root of that share.
        size = np.sqrt(share).T
        lags = np.abs(np.subtract.outer(ago, ago))
        blocks += self.gamma.T[:, lags] * (size[:, :, None] * size[:, None, :])
        spread[np.diag_indices(m * n)] += (
            ~seen.ravel() + ADDED_WHITE_NOISE * (self.gamma[0] * share).ravel() + SILENT**2
        )
        error = (compute_residuals(rows, self.theta) * seen).reshape(-1, 1)
        data = np.concatenate([A @ self.directions, error], axis=1)
        return np.asarray(solve_triangular(np.linalg.cholesky(spread), data, lower=True, check_finite=False))


def compute_scores(rows: Block, expected: Expectation) -> list[Score]:
    """``T = max_γ log-likelihood ratio``: by how much a change γ along D explains the innovations better than none.

    Whitened by the triangular factor of their covariance they are regressed on ``A D``, whitened likewise; T is the
    part that this explains (Willsky and Jones 1976, a generalised likelihood ratio). With the newest row first, the
    factor of fewer rows is the upper left part of that of all.

    Args:
        rows: At least as many of the newest rows as the longest of `SWAP_WINDOWS`, oldest first.
        expected: What was known before them.

    Returns:
        One per window.
    """
    newest = Block(*(x[::-1][: max(SWAP_WINDOWS)] for x in rows))
    return _explain(expected.whiten(newest, np.arange(len(newest.t))), newest.b.shape[1], SWAP_WINDOWS)


def compute_scores_without_push(rows: Block, expected: Expectation) -> list[Score]:
    """Return what `compute_scores` does, of so many more rows, without those `PUSH_ROWS` that tell most of a change.

    A push, or one passage that the model does not describe, then leaves nothing; a payload leaves what the other rows
    say. Their covariance is that of the rows that stay, so that nothing of the others is in them.

    Args:
        rows: At least `LOOK` of the newest rows, oldest first.
        expected: What was known before them.

    Returns:
        One per entry of `LEFT_ROWS`.
    """
    newest, least = Block(*(x[::-1][:LOOK] for x in rows)), [Score(inf, 1)] * len(LEFT_ROWS)
    for begin in range(max(LEFT_ROWS) + 1):
        at = np.delete(np.arange(LOOK), slice(begin, begin + PUSH_ROWS))
        white = expected.whiten(Block(*(x[at] for x in newest)), at)
        for k, score in enumerate(_explain(white, newest.b.shape[1], LEFT_ROWS)):
            if LEFT_ROWS[k] >= begin and score.mean < least[k].mean:
                least[k] = score
    return least


def _explain(white: Array, n: int, counts: Sequence[int]) -> list[Score]:
    """Part of ``eᵀe`` that lies in what the columns C span, and its dimension, of ``[C e]`` of so many rows each."""
    found = []
    for count in counts:
        C, e = white[: n * count, :-1], white[: n * count, -1]
        size = np.sqrt(np.maximum(np.sum(C**2, axis=0), 1e-300))
        left, values, _ = np.linalg.svd(C / size, full_matrices=False)
        seen = values**2 > 1e-9 * max(values[0] ** 2, 1e-300)
        found.append(Score(float(np.sum((left[:, seen].T @ e) ** 2)), int(seen.sum())))
    return found


def find_onset(rows: Block, expected: Expectation, dispersion: float) -> float:
    """Return the time, s, of the first row whose torque is `ONSET_DEVIATIONS` off at any joint; else of the last."""
    own = np.einsum("tja,ab,tjb->tj", rows.A, expected.covariance, rows.A, optimize=True)
    own += (1 + ADDED_WHITE_NOISE) * expected.gamma[0] * rows.share
    error = compute_residuals(rows, expected.theta)
    off = np.any((rows.share > UNMASKED_SHARE) & (error**2 > ONSET_DEVIATIONS**2 * dispersion * own), axis=1)
    return float(rows.t[np.argmax(off) if off.any() else -1])
