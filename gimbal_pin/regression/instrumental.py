"""Instrumental variables: consistent where the regressor itself is noisy, and least squares is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.regression.covariance import compute_coloured_covariance
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.linalg import solve_moments
from gimbal_pin.regression.solve import (
    Estimate,
    Method,
    compute_residuals,
    count_effective_rows,
    weigh_joints,
)

REWEIGHTINGS = 3
"""Solutions in turn, each weighted by the residuals of the one before."""

CORRELATED_ROWS = 4
"""Rows over which products of noises are taken to be correlated: two periods of the cutoff."""
PRODUCT_VARIANCE = 1.5
"""Variance of all products that a residual's colour does not count, over that of those of half the differences."""


def fit_instrumental(blocks: Sequence[Block], instruments: Sequence[Array]) -> Estimate:
    """``theta = (Σ ZᵀWA)⁻¹ Σ ZᵀWb``: consistent if Z moves with A and its noise has nothing to do with A's or b's.

    Least squares with a noisy A shrinks: AᵀA holds the noise's own power. ZᵀA does not. Valid instruments are columns
    of the same regressor from another source: the reference trajectory, a second sensor, other samples (Reiersøl 1941;
    Janot, Vandanjon and Gautier 2014 for robots).

    `instruments`: per block its Z, (m, n, k), filtered and masked like A.

    Raises:
        UsageError: There is not one Z of A's shape for every block.
    """
    if [Z.shape for Z in instruments] != [block.A.shape for block in blocks]:
        raise UsageError(
            "instruments",
            "do not have the shape of the regressors",
            "build them with the same rows",
        )
    return _solve_instrumental(blocks, [(Z, block.A) for Z, block in zip(instruments, blocks)])


def fit_repeated(blocks: Sequence[Block], twins: Sequence[Block]) -> Estimate:
    """Instrumental variables from two regressors of one motion with independent noise: each is the other's instrument.

    ``theta = (Σ AᵀWB + BᵀWA)⁻¹ Σ (A + B)ᵀWb``: the same whichever comes first.

    `twins` are the same rows with the regressor B in the place of A.

    Raises:
        UsageError: The two do not have the same shapes.
    """
    if [twin.A.shape for twin in twins] != [block.A.shape for block in blocks]:
        raise UsageError(
            "twins", "do not have the shape of the regressors", "build them with the same rows"
        )
    middle = [block._replace(A=(block.A + twin.A) / 2) for block, twin in zip(blocks, twins)]
    half = [(block.A - twin.A) / 2 for block, twin in zip(blocks, twins)]
    # (AᵀB + BᵀA) / 2 = MᵀM - DᵀD with the mean M and half the difference D.
    return _solve_instrumental(middle, [(block.A, block.A) for block in middle], half)


Pairs = Sequence[tuple[Array, Array]]


def _solve_instrumental(
    blocks: Sequence[Block], pairs: Pairs, noise: Sequence[Array] = ()
) -> Estimate:
    """Solve ``(Σ ZᵀWA - Σ DᵀWD) theta = Σ ZᵀWb``, W from each joint's residual in turn.

    `pairs`: per block (Z, A); `noise`: per block D, whose power is taken off. Residuals are the blocks' own.
    """
    rows = count_effective_rows(blocks)
    width = blocks[0].A.shape[2]
    weight: Array = np.ones(blocks[0].b.shape[1])
    for _ in range(REWEIGHTINGS):
        moment = compute_moments(pairs, weight) - compute_moments(
            [(D, D) for D in noise], weight, width
        )
        found = solve_moments(moment, compute_targets(blocks, [Z for Z, _ in pairs], weight))
        theta = found.theta
        squares = sum(np.sum(compute_residuals(block, theta) ** 2, axis=0) for block in blocks)
        power = squares / np.maximum(rows - len(theta) / len(rows), 1.0)
        weight = weigh_joints(power) ** 2
    gain = found.gain
    spread = compute_coloured_covariance(blocks, [Z for Z, _ in pairs], theta, gain, weight)
    spread = spread + gain @ _compute_product_covariance(noise, theta, weight) @ gain.T
    return Estimate(
        theta,
        found.mark_unseen(spread),
        np.sqrt(power),
        found.condition,
        sum(len(block.t) for block in blocks),
        Method.INSTRUMENTAL,
    )


def _compute_product_covariance(noise: Sequence[Array], theta: Array, weight: Array) -> Array:
    """Covariance that ``Σ DᵀWD theta`` and its like in ``Σ MᵀWM theta`` have by chance, (k, k).

    Noise times noise: the mean of two readings and half their difference hold as much of it, independent of each other.
    A residual's colour knows that D scatters, with ``D theta`` as it is, and so half of what the mean's products do.

    Args:
        noise: Per block D, (m, n, k).
        theta: Estimate, (k,).
        weight: W, (n,).
    """
    out = np.zeros((len(theta),) * 2)
    each = [np.einsum("tjk,j,tj->tk", D, weight, D @ theta) for D in noise]
    middle = sum((h.sum(axis=0) for h in each), 0.0) / max(sum(map(len, each)), 1)
    for h in (h - middle for h in each):
        for lag in range(min(CORRELATED_ROWS + 1, len(h))):
            lagged = h[: len(h) - lag].T @ h[lag:] * (1 - lag / (CORRELATED_ROWS + 1))
            out += lagged + lagged.T if lag else lagged
    return PRODUCT_VARIANCE * out


def compute_moments(pairs: Pairs, weight: Array, width: int = 0) -> Array:
    """``Σ ZᵀWA``, (k, k); zeros of `width` where there is no pair."""
    parts = [np.einsum("tjk,j,tjl->kl", Z, weight, A, optimize=True) for Z, A in pairs]
    return np.sum(parts, axis=0) if parts else np.zeros((width, width))


def compute_targets(blocks: Sequence[Block], instruments: Sequence[Array], weight: Array) -> Array:
    """``Σ ZᵀWb``, (k,)."""
    return np.sum(
        [np.einsum("tjk,j,tj->k", Z, weight, block.b) for Z, block in zip(instruments, blocks)],
        axis=0,
    )
