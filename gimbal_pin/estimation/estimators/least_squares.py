"""Least squares by triangular factors: ordinary, weighted by joint, robust, and with the URDF as prior."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqrf

from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.bodies import TRUST
from gimbal_pin.estimation.estimators.colour import coloured
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block, Design, get_design
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.consistency import spread

LEAF = 8192
"""Numbers in one leaf of the TSQR: it stays in the cache, and is too small for BLAS to wake threads, which on a busy
machine cost a hundred times the work they share."""
RANK = 1e-10
"""Singular values of the scaled factor under this share of the largest are directions that the data do not show."""
PASSES = 4
HUBER = 1.345
"""Tuning constant: 95 % of least squares' efficiency on Gaussian residuals (Huber 1981)."""
HUBER_PASSES = 10


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters from data, with what is known of their uncertainty.

    Attributes:
        theta: Parameters, SI units, (k,).
        covariance: Their covariance, (k, k); infinite variances where the data show nothing. From few rows it is wider
            than that, by Student's t over the normal quantile, so that ± 1.96 `std` hold 95 times in 100 there, too:
            see `components.widened`.
        residual_std: Root mean square of each joint's residual, N m, (n,).
        condition_number: Of the factor with columns scaled to unit norm.
        rows: Rows per joint.
        method: The estimator's name.
        phi: The bodies whose base parameters theta holds, (10 n,), where it was fitted through them; else None.
        uncertainty: What the covariance stands on.
    """

    theta: Array
    covariance: Array
    residual_std: Array
    condition_number: float
    rows: int
    method: str
    phi: Array | None = None
    uncertainty: str = "coloured residuals"

    __repr__ = brief

    @property
    def std(self) -> Array:
        """Standard deviations, (k,)."""
        return np.sqrt(np.diag(self.covariance))


class Estimator(Protocol):
    """Blocks of ``A theta = b`` in, `Estimate` out; the blocks can be iterated more than once.

    Most need nothing but the blocks; the others ask `design.get_design` what the columns stand for.
    """

    def __call__(self, blocks: Sequence[Block]) -> Estimate:
        """Estimate theta."""


def factor(blocks: Iterable[Block], weights: Iterable[Array] | None = None) -> Array:
    """Triangular factors R of each joint's [A b], one QR per block on top of the last (TSQR).

    ``RᵀR = [A b]ᵀ[A b]`` without ever forming the product, which would square the condition number, and without
    holding more than one block.

    Args:
        blocks: Rows.
        weights: Per block, a weight per row and joint, (m, n); None: one.

    Returns:
        (n, k + 1, k + 1).
    """
    factors: list[Array] = []
    for block, weight in zip(blocks, repeat(None) if weights is None else weights):
        n, width = block.A.shape[1], block.A.shape[2] + 1
        factors = factors or [np.zeros((0, width))] * n
        # A joint feels only what it carries: columns of zeros cost nothing.
        felt: NDArray[np.bool_] = np.asarray(block.A.any(axis=0))
        for j, present in enumerate(felt):
            rows = np.column_stack([block.A[:, j][:, np.flatnonzero(present)], block.b[:, j]])
            R = triangle(rows if weight is None else rows * weight[:, j, None])
            full = np.zeros((len(R), width))
            full[:, np.append(present, True)] = R
            factors[j] = triangle(np.vstack([factors[j], full])) if len(factors[j]) else full
    return np.stack([np.vstack([R, np.zeros((R.shape[1] - len(R), R.shape[1]))]) for R in factors])


def triangle(matrix: Array) -> Array:
    """The triangular factor R of ``matrix = Q R``, (k, k) or shorter, leaf by leaf (TSQR)."""
    width = matrix.shape[1]
    leaf, R = max(LEAF // width, 2 * width), np.zeros((0, width))
    for begin in range(0, max(len(matrix), 1), leaf):
        rows = matrix[begin : begin + leaf]
        R = np.triu(dgeqrf(np.vstack([R, rows]) if begin else rows, lwork=32 * width)[0][:width])
    return R


def solve(factors: Array, scale: Array, prior: Array | None = None) -> tuple[Array, Array, float]:
    """Least squares over all joints, joint j's rows multiplied by ``scale[j]``, and what is known beforehand.

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        scale: Square root of each joint's weight, (n,).
        prior: Rows ``[U z]`` with ``U theta = z`` up to noise of unit size, (any, k + 1); None: none.

    Returns:
        theta (k,); ``(AᵀWA)⁻¹`` (k, k), infinite where a direction is not seen; the condition number.
    """
    rows = (factors * scale[:, None, None]).reshape(-1, factors.shape[2])
    stacked = triangle(rows if prior is None else np.concatenate([prior, rows]))
    R, y = stacked[:-1, :-1], stacked[:-1, -1]
    norms = np.linalg.norm(R, axis=0)
    unit = np.where(norms > 0, norms, 1.0)
    left, values, right = np.linalg.svd(R / unit)
    seen = values > RANK * values[0]
    inverse = np.where(seen, 1.0 / np.where(seen, values, 1.0), 0.0)
    theta = right.T @ (inverse * (left.T @ y)) / unit
    information = (right.T * inverse**2) @ right / np.outer(unit, unit)
    blind = (np.abs(right[~seen]) > 1e-6).any(axis=0) if (~seen).any() else np.zeros(len(theta), bool)
    information[blind, :] = information[:, blind] = 0.0
    information[blind, blind] = np.inf
    return theta, information, float(values[0] / values[-1]) if seen.all() else float("inf")


def effective_rows(blocks: Sequence[Block]) -> Array:
    """Rows per joint that were not masked out, (n,)."""
    return np.sum([np.sum(block.share**2, axis=0) for block in blocks], axis=0)


def residual_power(factors: Array, theta: Array, rows: Array) -> Array:
    """Mean square of each joint's residual, corrected for the parameters' share of the rows (n,), (N m)², (n,)."""
    error = factors @ np.append(theta, -1.0)
    return np.sum(error**2, axis=1) / np.maximum(rows - len(theta) / len(factors), 1.0)


def residuals(block: Block, theta: Array) -> Array:
    """``b - A theta``, N m, (m, n)."""
    return block.b - block.A @ theta


def covariance(blocks: Sequence[Block], theta: Array, information: Array, scale: Array) -> Array:
    """Covariance of weighted least squares under coloured, joint-wise different residuals, (k, k).

    ``H⁻¹ S H⁻¹`` with H = AᵀWA and S the covariance of AᵀWe: the residual's own colour instead of the assumption that
    it is white.

    Args:
        blocks: Rows.
        theta: Estimate, (k,).
        information: H⁻¹, (k, k), from `solve`.
        scale: Square root of each joint's weight, (n,).
    """
    finite = np.where(np.isfinite(information), information, 0.0)
    out = coloured(blocks, [block.A for block in blocks], theta, finite, scale**2)
    blind = ~np.isfinite(np.diag(information))
    out[blind, blind] = np.inf
    return out


def ols(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ‖b - A theta‖²`` over all joints alike, by triangular factors."""
    factors = factor(blocks)
    equal = np.ones(len(factors))
    theta, information, condition = solve(factors, equal)
    rows = sum(len(block.t) for block in blocks)
    power = residual_power(factors, theta, effective_rows(blocks))
    return Estimate(theta, covariance(blocks, theta, information, equal), np.sqrt(power), condition, rows, "ols")


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


def robust(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ρ((b - A theta) / σ_j)`` with Huber's ρ, by reweighted least squares.

    σ_j is the median absolute residual of joint j, over 0.6745.
    """
    theta = weighted(blocks).theta
    for _ in range(HUBER_PASSES):
        spread = [np.abs(residuals(block, theta)) for block in blocks]
        used = np.concatenate([block.share for block in blocks]) > 0
        middle = [np.median(np.append(x[rows], 0.0)) for x, rows in zip(np.concatenate(spread).T, used.T)]
        scale = np.maximum(np.array(middle) / 0.6745, 1e-12)
        weights = [np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(error, 1e-300))) for error in spread]
        factors = factor(blocks, weights)
        theta, information, condition = solve(factors, 1.0 / scale)
    rows = sum(len(block.t) for block in blocks)
    reweighted = [
        block._replace(A=block.A * weight[:, :, None], b=block.b * weight, share=block.share * weight)
        for block, weight in zip(blocks, weights)
    ]
    out = covariance(reweighted, theta, information, 1.0 / scale)
    return Estimate(
        theta, out, np.sqrt(residual_power(factors, theta, effective_rows(blocks))), condition, rows, "robust"
    )


@dataclass(frozen=True)
class Ridge:
    """``argmin Σ_j ‖b_j - A_j theta‖² / σ_j² + (beta - beta_0)ᵀ P₀⁻¹ (beta - beta_0)``, an `Estimator`.

    beta_0 are the URDF's base parameters and ``P₀ = K (trust² G) Kᵀ`` their covariance if every body is the URDF's,
    stretched and sheared at random by `trust`: G as `consistency.spread` says. What the log shows well, it decides;
    what it does not, stays at the URDF, with the deviation that the trust leaves it. Friction is not held.

    Attributes:
        trust: Relative standard deviation of the URDF's masses, 1; lengths to half of that.
    """

    trust: float = TRUST

    def __post_init__(self) -> None:
        """Check the trust."""
        if not 0 < self.trust < np.inf:
            raise UsageError("trust", f"is {self.trust:g}", "give the URDF's relative deviation, such as 0.3")

    def __call__(self, blocks: Sequence[Block]) -> Estimate:
        """Estimate theta."""
        factors, rows = factor(blocks), effective_rows(blocks)
        belief = self.belief(get_design(blocks), factors.shape[2])
        scale: Array = np.ones(len(factors))
        theta, _, _ = solve(factors, scale)
        for _ in range(PASSES):
            scale = joint_weights(residual_power(factors, theta, rows))
            stacked = np.concatenate([factors * scale[:, None, None], belief[None]])
            theta, information, condition = solve(stacked, np.ones(len(stacked)))
        power = residual_power(factors, theta, rows)
        half = belief[:, :-1] @ np.where(np.isfinite(information), information, 0.0)
        out = covariance(blocks, theta, information, scale) + half.T @ half
        return Estimate(theta, out, np.sqrt(power), condition, sum(len(block.t) for block in blocks), "ridge")

    def belief(self, rows: Design, width: int) -> Array:
        """``[P₀^-½ 0 P₀^-½ beta_0]`` as rows under the data's factors, (k + 1, k + 1)."""
        root = rows.mixing @ spread(rows.rig.phi) * self.trust
        left, values, _ = np.linalg.svd(root, full_matrices=False)
        whiten = left.T / np.maximum(values, 1e-9 * values[0])[:, None]
        out = np.zeros((width, width))
        out[: len(left), : len(left)] = whiten
        out[: len(left), -1] = whiten @ (rows.mixing @ rows.rig.phi)
        return out
