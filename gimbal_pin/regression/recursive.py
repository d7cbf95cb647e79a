"""What is kept of rows that are not held any longer, and what is known before the first: as much after an hour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.regression.covariance import compute_score_covariance
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.linalg import triangularise, whiten
from gimbal_pin.regression.noise import Autoregression, join_blocks
from gimbal_pin.rig.brief import brief


@dataclass(frozen=True, eq=False)
class PastRows:
    """Rows ``x = [A b share]`` as least squares needs them: their triangular factors, and the covariance of ``Aᵀe``.

    The factor R of each joint's rows is updated by ``R ← qr([R; x])``: it never holds the squares of the rows, nor
    squares the condition number (Lawson and Hanson 1974, ch. 27).

    Attributes:
        factors: R of each joint, (n, k + 2, k + 2).
        score: Covariance of each joint's Aᵀe under the colour that its residual e had, (n, k, k).
        rows: How many rows went in.
    """

    factors: Array
    score: Array
    rows: int = 0

    __repr__ = brief

    @staticmethod
    def empty(n: int, width: int) -> PastRows:
        """Return that of no rows, for n joints and `width` parameters."""
        return PastRows(np.zeros((n, width + 2, width + 2)), np.zeros((n, width, width)))

    @property
    def count(self) -> Array:
        """Rows that were not masked out, per joint, (n,)."""
        return np.asarray(np.sum(self.factors[:, :, -1] ** 2, axis=1))

    def fade(self, weight: Array) -> PastRows:
        """Return it with each joint's rows counting less, (n,)."""
        root = np.sqrt(weight)[:, None, None]
        return PastRows(root * self.factors, root**4 * self.score, self.rows)

    def add(
        self, blocks: Sequence[Block], processes: Sequence[Autoregression] | None = None
    ) -> PastRows:
        """Return it with more rows; without their residuals' processes the score's covariance stays as it is."""
        if not blocks:
            return self
        rows = np.concatenate(
            [np.dstack([block.A, block.b, block.share]) for block in blocks]
        ).swapaxes(0, 1)
        factors = np.asarray(np.linalg.qr(np.concatenate([self.factors, rows], axis=1), mode="r"))
        score = self.score
        if processes is not None:
            columns = [block.A for block in join_blocks(blocks)]
            score = score + compute_score_covariance(columns, processes, np.ones(len(score)))
        return PastRows(factors, score, self.rows + rows.shape[1])

    def to_block(self) -> Block:
        """Return rows that have the same mean squares and products as all those that went in, oldest unknown.

        They are the factors, scaled: what is computed from means over rows (accuracy, visibility) is the same on them.
        """
        size = self.factors.shape[1]
        rows = self.factors.swapaxes(0, 1) * np.sqrt(size / max(self.rows, 1))
        nowhere = np.zeros(rows.shape[:2])
        return Block(
            np.zeros(size),
            rows[:, :, :-2],
            rows[:, :, -2],
            nowhere,
            nowhere,
            rows[:, :, -1],
            nowhere,
            nowhere,
        )


def loosen_prior(theta: Array, covariance: Array, directions: Array) -> Array:
    """``[U z]`` with ``U theta = z`` up to unit noise: what stays known if theta may move anywhere along D, (any, k+1).

    ``U (theta - D gamma) = z`` with UᵀU the inverse covariance; an orthogonal transformation that clears ``U D`` below
    its first rows leaves equations without gamma.

    Args:
        theta: Parameters, (k,).
        covariance: Their covariance, finite, (k, k).
        directions: D, (k, r).
    """
    U = whiten(covariance)
    r = directions.shape[1]
    return triangularise(np.column_stack([U @ directions, U, U @ theta]))[r:, r:]
