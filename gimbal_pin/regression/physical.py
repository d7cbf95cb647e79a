"""Least squares over bodies that can exist, and with the URDF as what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.dynamics.configurations import spread_reference_states
from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.regression.consistency import BARRIER_WEIGHTS, compute_deformation_root, fit_bodies
from gimbal_pin.regression.design import Block, Design, find_base_columns, get_design
from gimbal_pin.regression.linalg import decompose, triangularise
from gimbal_pin.regression.solve import (
    Estimate,
    Method,
    compute_covariance,
    compute_residual_power,
    count_effective_rows,
    factor_rows,
    solve,
    solve_factors,
    weigh_joints,
)

PHYSICAL_PASSES = 3
"""Solutions in turn, each weighted by the residuals of the one before."""
ELSEWHERE = 0.03
"""Weight of the states that fill the rig's limits, all together, as a share of the log's rows."""
TRUST = 0.3
"""Relative standard deviation of a URDF's masses where nobody says how good it is."""
LARGEST_PRIOR_WEIGHT = 30.0
"""No combination of parameters counts more for them than so many times what the log says of it."""


def fit_physical(blocks: Sequence[Block]) -> Estimate:
    """``argmin Σ_j (‖b_j - A_j (K φ; f)‖² + w ‖Y_j (K φ - β)‖²) / σ_j²`` over bodies φ that can exist, f in its bounds.

    The data themselves are fitted, through their triangular factor, and not an estimate moved afterwards: the global
    minimum (Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), by `fit_bodies`. CVXPY with Clarabel has
    the same minimum but takes 1.3 s to import. Of what the data do not show, the bodies stay as near the URDF as they
    can. The covariance is that without the constraint, which can only take some of it away.

    β are the base parameters without the constraint, Y the regressor over states that fill the rig's limits. Where β
    can exist, the second term does nothing. Where it cannot, the data alone would reach the bodies along what they show
    least, at any price in torque elsewhere; this way there is a price. The solution is the point of a convex set next
    to β: so it is never farther from the truth than β is, in the torque of log and limits together.
    """
    rows = get_design(blocks)
    factors = factor_rows(blocks)
    count = count_effective_rows(blocks)
    wide = factor_wide_states(rows, factors.shape[2] - 1)
    theta = solve_factors(factors, np.ones(len(factors))).theta
    for _ in range(PHYSICAL_PASSES):
        scale = weigh_joints(compute_residual_power(factors, theta, count))
        phi, friction = fit_bounded_bodies(rows, build_program(factors, wide, scale, count))
        theta = np.concatenate([rows.mixing @ phi, friction])
    power = compute_residual_power(factors, theta, count)
    found = solve_factors(factors, scale)._replace(theta=theta)
    deviations = compute_covariance(blocks, found, scale)
    length = sum(len(block.t) for block in blocks)
    return Estimate(
        theta, deviations, np.sqrt(power), found.condition, length, Method.PHYSICAL, phi
    )


def fit_ridge(blocks: Sequence[Block], trust: float = TRUST) -> Estimate:
    """``argmin Σ_j ‖b_j - A_j theta‖² / σ_j² + (beta - beta_0)ᵀ P₀⁻¹ (beta - beta_0)``: `solve` with the URDF as prior.

    What the log shows well, it decides; what it does not, stays at the URDF, with the deviation that the trust leaves
    it. Friction is not held.

    Args:
        blocks: Rows.
        trust: Relative standard deviation of the URDF's masses; lengths to half of that.
    """
    check_trust(trust)
    return solve(blocks, build_urdf_prior(get_design(blocks), trust), method=Method.RIDGE)


def check_trust(trust: float) -> None:
    """Raise `UsageError` if a trust is not positive."""
    if not 0 < trust < np.inf:
        raise UsageError(
            "trust", f"is {trust:g}", "give the URDF's relative deviation, such as 0.3"
        )


def build_urdf_prior(design: Design, trust: float) -> Array:
    """Rows ``[P₀^-½ 0 P₀^-½ beta_0]``, (b, k + 1): beta_0 the URDF's base parameters, ``P₀ = K (trust² G) Kᵀ``.

    P₀ is their covariance if every body is the URDF's, stretched and sheared at random by `trust`: G as
    `compute_deformation_root` says.
    """
    rows = build_prior_rows(
        trust * design.mixing @ compute_deformation_root(design.rig.phi),
        design.mixing @ design.rig.phi,
    )
    unknown = np.zeros((len(rows), len(design.names) - len(design.mixing)))
    return np.hstack([rows[:, :-1], unknown, rows[:, -1:]])


def build_prior_rows(root: Array, mean: Array) -> Array:
    """Rows ``[U, U mean]`` of unit noise, (k, k + 1), of parameters with mean (k,) and covariance ``root rootᵀ``."""
    left, values, _ = np.linalg.svd(root, full_matrices=False)
    whiten = left.T / np.maximum(values, 1e-9 * values[0])[:, None]
    return np.column_stack([whiten, whiten @ mean])


def factor_wide_states(rows: Design, width: int) -> Array:
    """Each joint's triangular factor of the base columns over states that fill the rig's limits, (n, b, width).

    The base stands; mean squares, not sums; the columns of effects are zero.
    """
    states = spread_reference_states(rows.rig)
    Y = compute_regressor(rows.rig, states.q, states.v, states.a)[
        :, :, find_base_columns(rows.rig, rows.reduction)
    ]
    out = np.zeros((Y.shape[1], Y.shape[2], width))
    out[:, :, : Y.shape[2]] = [triangularise(Y[:, j] / np.sqrt(len(Y))) for j in range(Y.shape[1])]
    return out


def build_program(factors: Array, wide: Array, scale: Array, count: Array) -> Array:
    """Rows ``[U z]`` of which `fit_physical` minimises ``‖U theta - z‖²``, (any, k + 1).

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        wide: What `factor_wide_states` says, (n, b, k).
        scale: Square root of each joint's weight, (n,).
        count: Rows per joint, (n,).
    """
    data = (factors * scale[:, None, None]).reshape(-1, factors.shape[2])
    weighed = (np.sqrt(ELSEWHERE * count) * scale)[:, None, None] * wide
    return np.concatenate([data, anchor(data, weighed.reshape(-1, wide.shape[2]))])


def anchor(data: Array, wide: Array) -> Array:
    """Rows ``wide (theta - theta_0)``, theta_0 being the data's own solution, in so far as the data show theta.

    In coordinates in which the data's squares are the identity, singular values beyond √MOST are cut to it: so what
    the data hardly show, and hence theta_0 does not know, is not fixed there.

    Args:
        data: ``[A b]``, (any, k + 1).
        wide: Columns, (any, k).

    Returns:
        ``[U U theta_0]``, (any, k + 1).
    """
    R = triangularise(data)
    svd = decompose(R[:-1, :-1])
    forth = svd.s[:, None] * svd.Vt * svd.d
    back = svd.Vt.T / svd.s / svd.d[:, None]
    _, size, turned = np.linalg.svd(wide @ back, full_matrices=False)
    rows = np.minimum(size, np.sqrt(LARGEST_PRIOR_WEIGHT))[:, None] * (turned @ forth)
    return np.column_stack([rows, rows @ (back @ (svd.U.T @ R[:-1, -1]))])


def fit_bounded_bodies(
    rows: Design, stacked: Array, weights: Sequence[float] = BARRIER_WEIGHTS
) -> tuple[Array, Array]:
    """Return the bodies and the other coefficients: those that want to leave their bounds stay on them.

    Friction drives nothing: its coefficients are not negative. `weights` are what `fit_bodies` takes.
    """
    limits = [c for effect in rows.effects for c in effect.coefficients]
    lower, upper = (np.array([getattr(c, name) for c in limits]) for name in ("lower", "upper"))
    fixed_values = np.full(len(limits), np.nan)
    while True:
        phi, others = _fit_bodies(rows.rig.phi, rows.mixing, stacked, fixed_values, weights)
        low = others < lower
        high = others > upper
        if not (low | high).any():
            return phi, others
        fixed_values[low], fixed_values[high] = lower[low], upper[high]


def _fit_bodies(
    start: Array,
    mixing: Array,
    stacked: Array,
    fixed_values: Array,
    weights: Sequence[float] = BARRIER_WEIGHTS,
) -> tuple[Array, Array]:
    """Return the bodies, (10 n,), and the other coefficients, that fit best ``[U z]``, (any, k + 1).

    The others are not constrained, so they are eliminated: with their columns first, what stands under their part of
    the triangle is free of them. Those that are fixed at a value, not NaN, go over to the torque.
    """
    width = len(mixing)
    total = stacked.shape[1] - 1
    rows = stacked.copy()
    fixed = np.isfinite(fixed_values)
    rows[:, total] -= rows[:, width:total][:, fixed] @ fixed_values[fixed]
    free = int(np.sum(~fixed))
    R = triangularise(rows[:, [*(width + np.flatnonzero(~fixed)), *range(width), total]])
    end = free + width
    phi = fit_bodies(start, R[free:end, free:end] @ mixing, R[free:end, end], weights).phi
    left = R[:free, end] - R[:free, free:end] @ (mixing @ phi)
    others = fixed_values.copy()
    others[~fixed] = decompose(R[:free, :free]).inverse @ left
    return phi, others
