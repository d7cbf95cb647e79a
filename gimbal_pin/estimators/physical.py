"""Least squares over bodies that can exist."""

from __future__ import annotations

import numpy as np

from gimbal_pin.consistency import fitted
from gimbal_pin.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve, triangle
from gimbal_pin.estimators.weighted import joint_weights
from gimbal_pin.log import Array
from gimbal_pin.rows import Regression

PASSES = 3
"""Solutions in turn, each weighted by the residuals of the one before."""


def physical(blocks: Regression) -> Estimate:
    """``argmin Σ_j ‖b_j - A_j (K φ; f)‖² / σ_j²`` over bodies φ that can exist, friction f free.

    The data themselves are fitted, through their triangular factor, and not an estimate moved afterwards: the global
    minimum (Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), found by `consistency.fitted`. Of what the data do
    not show, the bodies stay as near the URDF as they can. The covariance is that without the constraint, which can
    only take some of it away.
    """
    rows = blocks.rows
    factors, count = factor(blocks), effective_rows(blocks)
    theta, _, condition = solve(factors, np.ones(len(factors)))
    for _ in range(PASSES):
        scale = joint_weights(residual_power(factors, theta, count))
        phi, friction = constrained(rows.rig.phi, rows.mixing, factors * scale[:, None, None])
        theta = np.concatenate([rows.mixing @ phi, friction])
    power = residual_power(factors, theta, count)
    _, information, condition = solve(factors, scale)
    spread = covariance(blocks, theta, information, scale)
    length = sum(len(block.t) for block in blocks)
    return Estimate(theta, spread, np.sqrt(power), condition, length, "physical", phi)


def constrained(start: Array, mixing: Array, factors: Array) -> tuple[Array, Array]:
    """Return the bodies, (10 n,), and the other coefficients, that fit best the weighted factors, (n, k + 1, k + 1).

    The others are not constrained, so they are eliminated: with their columns first, what stands under their part of
    the triangle is free of them.
    """
    width, total = len(mixing), factors.shape[2] - 1
    order = [*range(width, total), *range(width), total]
    R = triangle(factors.reshape(-1, total + 1)[:, order])
    others = total - width
    phi = fitted(start, R[others:total, others:total] @ mixing, R[others:total, total]).phi
    left = R[:others, total] - R[:others, others:total] @ (mixing @ phi)
    return phi, np.linalg.lstsq(R[:others, :others], left, rcond=None)[0]
