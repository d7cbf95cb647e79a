"""Least squares weighted by each joint's own residual."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gimbal_pin.estimation.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve
from gimbal_pin.estimation.rows import Block
from gimbal_pin.log.log import Array

PASSES = 4


def weighted(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖² / σ_j²``, σ_j from the residuals, iterated (Gautier 1997).

    A lightly loaded axis has small torques and small errors; equal weights would let the heavy axes' errors drown
    what only that axis shows. The factors are computed once; every pass only reweights them.
    """
    factors, count = factor(blocks), effective_rows(blocks)
    rows = sum(len(block.t) for block in blocks)
    theta, information, condition, power, scale = reweighted(factors, lambda x: residual_power(factors, x, count))
    spread = covariance(blocks, theta, information, scale)
    return Estimate(theta, spread, np.sqrt(power), condition, rows, "weighted")


def reweighted(
    factors: Array, power_of: Callable[[Array], Array], prior: Array | None = None
) -> tuple[Array, Array, float, Array, Array]:
    """Solve, weigh each joint by its residual, and again; `PASSES` times and once more.

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        power_of: theta → each joint's residual power, (n,).
        prior: As for `solve`.

    Returns:
        theta, ``(AᵀWA)⁻¹`` and the condition number as from `solve`; the power, and the weights' roots, (n,).
    """
    scale: Array = np.ones(len(factors))
    for _ in range(PASSES):
        power = power_of(solve(factors, scale, prior)[0])
        scale = joint_weights(power)
    return *solve(factors, scale, prior), power, scale


def joint_weights(power: Array) -> Array:
    """``1 / σ_j`` from each joint's mean square residual, (n,).

    A joint that never moved has no residual: without a floor it would take all the weight.
    """
    return np.asarray(1.0 / np.sqrt(np.maximum(power, 1e-6 * power.max() + 1e-30)), dtype=np.float64)
