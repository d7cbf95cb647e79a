"""Deviations by repetition: the same motion, the residuals' blocks in another order."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.regression import (
    Block,
    DesignBlocks,
    Estimate,
    Estimator,
    compute_residuals,
    count_effective_rows,
    join_blocks,
)

LEAST_ROW_SHARE = 0.3
"""A row's residual is drawn from where at least this share of its samples was not masked out."""
FEWEST_ESTIMATES = 20
"""Fewest estimates that tell a deviation."""
LONGEST_DRAWN_BLOCK, FEWEST_DRAWN_BLOCKS = 2.0, 5
"""Length of a block where none is given, s, or shorter where fewer than so many would fit."""


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """``cov(theta*)`` over estimates from ``b* = A theta + e*``, an `Estimator` around another one.

    e* are blocks of the residual drawn with replacement (Künsch 1989), all joints of a time together: neither the
    residual's colour nor what joints share is modelled. Blocks must be longer than the residual remembers, and the log
    many blocks long. Over 60 simulated logs with slow noise 95 % intervals held the truth 89 times in 100, those by the
    residual's colour 95: blocks lack what the fit took out of the residual and what correlates across their ends.

    Attributes:
        estimator: Estimator of rows; those that simulate the log itself have no rows to draw for.
        rng: Source of the draws.
        count: Number of estimates.
        seconds: Length of a block, s; None: 2 s, or a fifth of the log's rows where that is less.
    """

    estimator: Estimator
    rng: np.random.Generator
    count: int = 200
    seconds: float | None = None

    def __post_init__(self) -> None:
        """Check the count and the length."""
        if self.count < FEWEST_ESTIMATES:
            raise UsageError(
                "bootstrap", f"of {self.count} estimates tells no deviation", f"give at least {FEWEST_ESTIMATES}"
            )
        if self.seconds is not None and not 0 < self.seconds < np.inf:
            raise UsageError("bootstrap", f"in blocks of {self.seconds:g} s", "give a positive length")

    def __call__(self, blocks: Sequence[Block]) -> Estimate:
        """Estimate theta; the covariance is that of the repetitions."""
        found = self.estimator(blocks)
        if found.method.is_simulating:
            what = f"draws rows anew, and {found.method} simulates the log they come from"
            raise UsageError("the bootstrap", what, "use it with another estimator, or that one's own deviations")
        starts, length, step = self.place_blocks(blocks)
        residual, count = _scale_residuals(blocks, found.theta), sum(len(block.t) for block in blocks)
        ends, thetas = np.cumsum([len(block.t) for block in blocks])[:-1], []
        for _ in tqdm(range(self.count), "bootstrap", unit="estimate", disable=None, leave=False, delay=2):
            first = self.rng.choice(starts, -(-count // length))
            drawn = residual[(first[:, None] + np.arange(length)).ravel()[:count]]
            made = tuple(
                block._replace(b=block.A @ found.theta + own * block.share)
                for block, own in zip(blocks, np.split(drawn, ends))
            )
            again = DesignBlocks(blocks.design, made) if isinstance(blocks, DesignBlocks) else made
            thetas.append(self.estimator(again).theta)
        blind = ~np.isfinite(np.diag(found.covariance))
        covariance = np.atleast_2d(np.cov(np.transpose(thetas)))
        covariance[blind, blind] = np.inf
        return replace(found, covariance=covariance, uncertainty=f"bootstrap, {self.count} of {length * step:.2g} s")

    def place_blocks(self, blocks: Sequence[Block]) -> tuple[Array, int, float]:
        """Return the rows at which a block may start, its rows, and their interval, s; `DataError` if few fit in."""
        whole = join_blocks(blocks)
        step = min((float(np.median(np.diff(part.t))) for part in whole if len(part.t) > 1), default=np.inf)
        edges = np.cumsum([0, *(len(part.t) for part in whole)])
        rows = int(edges[-1])
        length = max(
            1,
            min(round(LONGEST_DRAWN_BLOCK / step), rows // FEWEST_DRAWN_BLOCKS)
            if self.seconds is None
            else round(self.seconds / step),
        )
        starts = np.concatenate([np.arange(a, max(b - length + 1, a)) for a, b in itertools.pairwise(edges)])
        if rows < FEWEST_DRAWN_BLOCKS * length or not len(starts):
            what = f"holds fewer than {FEWEST_DRAWN_BLOCKS} blocks of {length * step:.2g} s"
            raise DataError("the log", what, "record more, or draw shorter blocks")
        return starts, length, step


def _scale_residuals(blocks: Sequence[Block], theta: Array) -> Array:
    """Residual per unmasked row, N m, (m, n): as large in total as what the fit left, and what it took."""
    error, share = (
        np.concatenate(x) for x in zip(*((compute_residuals(block, theta), block.share) for block in blocks))
    )
    usable = share >= LEAST_ROW_SHARE
    residual = np.where(usable, error / np.where(usable, share, 1.0), 0.0)
    count = count_effective_rows(blocks)
    free = np.sum(error**2, axis=0) / np.maximum(count - len(theta) / len(count), 1.0)
    size = np.mean(residual**2, axis=0)
    return np.asarray(residual * np.sqrt(free / np.where(size > 0, size, 1.0)))
