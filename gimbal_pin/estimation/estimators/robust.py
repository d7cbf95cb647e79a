"""Huber's estimator: outlying rows count less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.estimation.estimators.base import (
    Estimate,
    covariance,
    effective_rows,
    factor,
    residual_power,
    residuals,
    solve,
)
from gimbal_pin.estimation.estimators.weighted import weighted
from gimbal_pin.estimation.rows import Block
from gimbal_pin.log.log import Array

HUBER = 1.345
"""Tuning constant: 95 % of least squares' efficiency on Gaussian residuals (Huber 1981)."""
PASSES = 10


def robust(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ρ((b - A theta) / σ_j)`` with Huber's ρ, by reweighted least squares.

    σ_j is the median absolute residual of joint j, over 0.6745.
    """
    theta = weighted(blocks).theta
    for _ in range(PASSES):
        spread = [np.abs(residuals(block, theta)) for block in blocks]
        scale = np.maximum(np.median(np.concatenate(spread), axis=0) / 0.6745, 1e-12)
        weights = [np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(error, 1e-300))) for error in spread]
        factors = factor(blocks, weights)
        theta, information, condition = solve(factors, 1.0 / scale)
    rows = sum(len(block.t) for block in blocks)
    reweighted = [reweigh(block, weight) for block, weight in zip(blocks, weights)]
    out = covariance(reweighted, theta, information, 1.0 / scale)
    return Estimate(
        theta, out, np.sqrt(residual_power(factors, theta, effective_rows(blocks))), condition, rows, "robust"
    )


def reweigh(block: Block, weight: Array) -> Block:
    """Return the block with its rows multiplied by `weight`, (m, n)."""
    return block._replace(A=block.A * weight[:, :, None], b=block.b * weight, share=block.share * weight)
