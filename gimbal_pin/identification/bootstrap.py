"""Deviations by repetition: the same motion, the residuals' blocks in another order."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
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

LEAST_SHARE = 0.3
"""A row's residual is drawn from where at least this share of its samples was not masked out."""
LEAST = 20
"""Fewest estimates that tell a deviation."""
LONGEST, FEWEST = 2.0, 5
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
        if self.count < LEAST:
            raise UsageError("bootstrap", f"of {self.count} estimates tells no deviation", f"give at least {LEAST}")
        if self.seconds is not None and not 0 < self.seconds < np.inf:
            raise UsageError("bootstrap", f"in blocks of {self.seconds:g} s", "give a positive length")

    def __call__(self, blocks: Sequence[Block]) -> Estimate:
        """Estimate theta; the covariance is that of the repetitions."""
        found = self.estimator(blocks)
        if found.method in ("instrumental", "output-error"):
            what = f"draws rows anew, and {found.method} simulates the log they come from"
            raise UsageError("the bootstrap", what, "use it with another estimator, or that one's own deviations")
        runs = range(self.count)
        bar = tqdm(runs, desc="bootstrap", unit="estimate", disable=None, leave=False, delay=2)
        drawn = ResidualBlocks.of(blocks, found.theta, self.seconds)
        thetas = np.array([self.estimator(drawn.again(blocks, found.theta, self.rng)).theta for _ in bar])
        blind = ~np.isfinite(np.diag(found.covariance))
        covariance = np.atleast_2d(np.cov(thetas.T))
        covariance[blind, blind] = np.inf
        return replace(found, covariance=covariance, uncertainty=f"bootstrap, {self.count} of {drawn.seconds:.2g} s")


@dataclass(frozen=True, eq=False)
class ResidualBlocks:
    """Residuals of unmasked rows, and the places where a block of them may start.

    Attributes:
        residual: Residual per unmasked row, N m, (m, n); as large in total as what the fit left, and what it took.
        starts: Rows at which a block may start, (s,).
        length: Rows of a block.
        seconds: The same, s.
    """

    residual: Array
    starts: Array
    length: int
    seconds: float

    @staticmethod
    def of(blocks: Sequence[Block], theta: Array, seconds: float | None) -> ResidualBlocks:
        """Take the residuals of an estimate; `DataError` if too few blocks fit in."""
        whole = join_blocks(blocks)
        step = min((float(np.median(np.diff(part.t))) for part in whole if len(part.t) > 1), default=np.inf)
        rows = sum(len(part.t) for part in whole)
        length = max(1, min(round(LONGEST / step), rows // FEWEST) if seconds is None else round(seconds / step))
        edges = np.cumsum([0, *(len(part.t) for part in whole)])
        starts = np.concatenate([np.arange(a, max(b - length + 1, a)) for a, b in itertools.pairwise(edges)])
        if rows < FEWEST * length or not len(starts):
            what = f"holds fewer than {FEWEST} blocks of {length * step:.2g} s"
            raise DataError("the log", what, "record more, or draw shorter blocks")
        error, share = (
            np.concatenate(x) for x in zip(*((compute_residuals(part, theta), part.share) for part in whole))
        )
        usable = share >= LEAST_SHARE
        residual = np.where(usable, error / np.where(usable, share, 1.0), 0.0)
        count = count_effective_rows(blocks)
        free = np.sum(error**2, axis=0) / np.maximum(count - len(theta) / len(count), 1.0)
        size = np.mean(residual**2, axis=0)
        return ResidualBlocks(residual * np.sqrt(free / np.where(size > 0, size, 1.0)), starts, length, length * step)

    def again(self, blocks: Sequence[Block], theta: Array, rng: np.random.Generator) -> Sequence[Block]:
        """Return the blocks with other residuals."""
        made = tuple(self.filled(blocks, theta, rng))
        return DesignBlocks(blocks.design, made) if isinstance(blocks, DesignBlocks) else made

    def filled(self, blocks: Sequence[Block], theta: Array, rng: np.random.Generator) -> Iterator[Block]:
        """Yield blocks whose torque is the fit's and residuals from other times."""
        total = sum(len(block.t) for block in blocks)
        first = rng.choice(self.starts, -(-total // self.length))
        picked = (first[:, None] + np.arange(self.length)).ravel()
        at = 0
        for block in blocks:
            own = self.residual[picked[at : at + len(block.t)]]
            yield block._replace(b=block.A @ theta + own * block.share)
            at += len(block.t)
