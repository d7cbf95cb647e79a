"""Least squares weighted by each joint's own residual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve
from gimbal_pin.log import Array
from gimbal_pin.rows import Block

PASSES = 4


def weighted(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖² / σ_j²``, σ_j from the residuals, iterated (Gautier 1997).

    A lightly loaded axis has small torques and small errors; equal weights would let the heavy axes' errors drown
    what only that axis shows. The factors are computed once; every pass only reweights them.
    """
    factors = factor(blocks)
    rows = sum(len(block.t) for block in blocks)
    scale: Array = np.ones(len(factors))
    for _ in range(PASSES):
        theta, information, condition = solve(factors, scale)
        power = residual_power(factors, theta, effective_rows(blocks))
        scale = joint_weights(power)
    theta, information, condition = solve(factors, scale)
    spread = covariance(blocks, theta, information, scale)
    return Estimate(theta, spread, np.sqrt(power), condition, rows, "weighted")


def joint_weights(power: Array) -> Array:
    """``1 / σ_j`` from each joint's mean square residual, (n,).

    A joint that never moved has no residual: without a floor it would take all the weight.
    """
    return np.asarray(1.0 / np.sqrt(np.maximum(power, 1e-6 * power.max() + 1e-30)), dtype=np.float64)
