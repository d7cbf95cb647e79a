"""Least squares over bodies that can exist."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.dynamics.configurations import spread
from gimbal_pin.dynamics.regressor import regressor
from gimbal_pin.estimation.estimators.least_squares import (
    RANK,
    Estimate,
    covariance,
    effective_rows,
    factor,
    joint_weights,
    residual_power,
    solve,
    triangle,
)
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block, Design, find_base_columns, get_design
from gimbal_pin.rig.consistency import WEIGHTS, fitted

PASSES = 3
"""Solutions in turn, each weighted by the residuals of the one before."""
ELSEWHERE = 0.03
"""Weight of the states that fill the rig's limits, all together, as a share of the log's rows."""
MOST = 30.0
"""No combination of parameters counts more for them than so many times what the log says of it."""


def physical(blocks: Sequence[Block]) -> Estimate:
    """``argmin Σ_j (‖b_j - A_j (K φ; f)‖² + w ‖Y_j (K φ - β)‖²) / σ_j²`` over bodies φ that can exist, f in its bounds.

    The data themselves are fitted, through their triangular factor, and not an estimate moved afterwards: the global
    minimum (Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), by `consistency.fitted`. CVXPY with Clarabel has
    the same minimum but takes 1.3 s to import. Of what the data do not show, the bodies stay as near the URDF as they
    can. The covariance is that without the constraint, which can only take some of it away.

    β are the base parameters without the constraint, Y the regressor over states that fill the rig's limits. Where β
    can exist, the second term does nothing. Where it cannot, the data alone would reach the bodies along what they show
    least, at any price in torque elsewhere; this way there is a price. The solution is the point of a convex set next
    to β: so it is never farther from the truth than β is, in the torque of log and limits together.
    """
    rows = get_design(blocks)
    factors, count = factor(blocks), effective_rows(blocks)
    wide = everywhere(rows, factors.shape[2] - 1)
    theta, _, condition = solve(factors, np.ones(len(factors)))
    for _ in range(PASSES):
        scale = joint_weights(residual_power(factors, theta, count))
        phi, friction = bounded(rows, program(factors, wide, scale, count))
        theta = np.concatenate([rows.mixing @ phi, friction])
    power = residual_power(factors, theta, count)
    _, information, condition = solve(factors, scale)
    deviations = covariance(blocks, theta, information, scale)
    length = sum(len(block.t) for block in blocks)
    return Estimate(theta, deviations, np.sqrt(power), condition, length, "physical", phi)


def everywhere(rows: Design, width: int) -> Array:
    """Each joint's triangular factor of the base columns over states that fill the rig's limits, (n, b, width).

    The base stands; mean squares, not sums; the columns of effects are zero.
    """
    states = spread(rows.rig)
    Y = regressor(rows.rig, states.q, states.v, states.a)[:, :, find_base_columns(rows.rig, rows.reduction)]
    out = np.zeros((Y.shape[1], Y.shape[2], width))
    out[:, :, : Y.shape[2]] = [triangle(Y[:, j] / np.sqrt(len(Y))) for j in range(Y.shape[1])]
    return out


def program(factors: Array, wide: Array, scale: Array, count: Array) -> Array:
    """Rows ``[U z]`` of which `physical` minimises ``‖U theta - z‖²``, (any, k + 1).

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        wide: What `everywhere` says, (n, b, k).
        scale: Square root of each joint's weight, (n,).
        count: Rows per joint, (n,).
    """
    data = (factors * scale[:, None, None]).reshape(-1, factors.shape[2])
    weighed = (np.sqrt(ELSEWHERE * count) * scale)[:, None, None] * wide
    return np.concatenate([data, anchored(data, weighed.reshape(-1, wide.shape[2]))])


def anchored(data: Array, wide: Array) -> Array:
    """Rows ``wide (theta - theta_0)``, theta_0 being the data's own solution, in so far as the data show theta.

    In coordinates in which the data's squares are the identity, singular values beyond √MOST are cut to it: so what
    the data hardly show, and hence theta_0 does not know, is not held there.

    Args:
        data: ``[A b]``, (any, k + 1).
        wide: Columns, (any, k).

    Returns:
        ``[U U theta_0]``, (any, k + 1).
    """
    R = triangle(data)
    norms = np.linalg.norm(R[:, :-1], axis=0)
    unit = np.where(norms > 0, norms, 1.0)
    left, values, right = np.linalg.svd(R[:-1, :-1] / unit)
    seen = values > RANK * values[0]
    forth, back = values[seen, None] * right[seen] * unit, right[seen].T / values[seen] / unit[:, None]
    _, size, turned = np.linalg.svd(wide @ back, full_matrices=False)
    rows = np.minimum(size, np.sqrt(MOST))[:, None] * (turned @ forth)
    return np.column_stack([rows, rows @ (back @ (left[:, seen].T @ R[:-1, -1]))])


def bounded(rows: Design, stacked: Array, weights: Sequence[float] = WEIGHTS) -> tuple[Array, Array]:
    """Return the bodies and the other coefficients: those that want to leave their bounds stay on them.

    Friction drives nothing: its coefficients are not negative. `weights` are what `consistency.fitted` takes.
    """
    limits = [c for effect in rows.effects for c in effect.coefficients]
    lower, upper = (np.array([getattr(c, name) for c in limits]) for name in ("lower", "upper"))
    held = np.full(len(limits), np.nan)
    while True:
        phi, others = constrained(rows.rig.phi, rows.mixing, stacked, held, weights)
        low, high = others < lower, others > upper
        if not (low | high).any():
            return phi, others
        held[low], held[high] = lower[low], upper[high]


def constrained(
    start: Array, mixing: Array, stacked: Array, held: Array, weights: Sequence[float] = WEIGHTS
) -> tuple[Array, Array]:
    """Return the bodies, (10 n,), and the other coefficients, that fit best ``[U z]``, (any, k + 1).

    The others are not constrained, so they are eliminated: with their columns first, what stands under their part of
    the triangle is free of them. Those that are held at a value, not NaN, go over to the torque.
    """
    width, total = len(mixing), stacked.shape[1] - 1
    rows = stacked.copy()
    fixed = np.isfinite(held)
    rows[:, total] -= rows[:, width:total][:, fixed] @ held[fixed]
    free = int(np.sum(~fixed))
    R = triangle(rows[:, [*(width + np.flatnonzero(~fixed)), *range(width), total]])
    end = free + width
    phi = fitted(start, R[free:end, free:end] @ mixing, R[free:end, end], weights).phi
    left = R[:free, end] - R[:free, free:end] @ (mixing @ phi)
    others = held.copy()
    others[~fixed] = np.linalg.lstsq(R[:free, :free], left, rcond=None)[0]
    return phi, others
