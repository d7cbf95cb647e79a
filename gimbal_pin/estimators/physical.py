"""Least squares over bodies that can exist."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.consistency import fitted
from gimbal_pin.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve, triangle
from gimbal_pin.estimators.weighted import joint_weights
from gimbal_pin.log import Array
from gimbal_pin.rows import Block, Rows, standing_for

PASSES = 3
"""Solutions in turn, each weighted by the residuals of the one before."""


def physical(blocks: Sequence[Block]) -> Estimate:
    """``argmin Σ_j ‖b_j - A_j (K φ; f)‖² / σ_j²`` over bodies φ that can exist, f in its bounds.

    The data themselves are fitted, through their triangular factor, and not an estimate moved afterwards: the global
    minimum (Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), found by `consistency.fitted`. Of what the data do
    not show, the bodies stay as near the URDF as they can. The covariance is that without the constraint, which can
    only take some of it away.
    """
    rows = standing_for(blocks)
    factors, count = factor(blocks), effective_rows(blocks)
    theta, _, condition = solve(factors, np.ones(len(factors)))
    for _ in range(PASSES):
        scale = joint_weights(residual_power(factors, theta, count))
        phi, friction = bounded(rows, factors * scale[:, None, None])
        theta = np.concatenate([rows.mixing @ phi, friction])
    power = residual_power(factors, theta, count)
    _, information, condition = solve(factors, scale)
    spread = covariance(blocks, theta, information, scale)
    length = sum(len(block.t) for block in blocks)
    return Estimate(theta, spread, np.sqrt(power), condition, length, "physical", phi)


def bounded(rows: Rows, factors: Array) -> tuple[Array, Array]:
    """Return the bodies and the other coefficients: those that want to leave their bounds stay on them.

    Friction drives nothing: its coefficients are not negative.
    """
    limits = [c for effect in rows.effects for c in effect.coefficients]
    lower, upper = (np.array([getattr(c, name) for c in limits]) for name in ("lower", "upper"))
    held = np.full(len(limits), np.nan)
    while True:
        phi, others = constrained(rows.rig.phi, rows.mixing, factors, held)
        low, high = others < lower, others > upper
        if not (low | high).any():
            return phi, others
        held[low], held[high] = lower[low], upper[high]


def constrained(start: Array, mixing: Array, factors: Array, held: Array) -> tuple[Array, Array]:
    """Return the bodies, (10 n,), and the other coefficients, that fit best the weighted factors, (n, k + 1, k + 1).

    The others are not constrained, so they are eliminated: with their columns first, what stands under their part of
    the triangle is free of them. Those that are held at a value, not NaN, go over to the torque.
    """
    width, total = len(mixing), factors.shape[2] - 1
    rows = factors.reshape(-1, total + 1).copy()
    fixed = np.isfinite(held)
    rows[:, total] -= rows[:, width:total][:, fixed] @ held[fixed]
    free = int(np.sum(~fixed))
    R = triangle(rows[:, [*(width + np.flatnonzero(~fixed)), *range(width), total]])
    end = free + width
    phi = fitted(start, R[free:end, free:end] @ mixing, R[free:end, end]).phi
    left = R[:free, end] - R[:free, free:end] @ (mixing @ phi)
    others = held.copy()
    others[~fixed] = np.linalg.lstsq(R[:free, :free], left, rcond=None)[0]
    return phi, others
