"""Weighted least squares by triangular factors: rows and what is known beforehand in, `Estimate` out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import repeat
from typing import Protocol

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.regression.covariance import compute_coloured_covariance
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.linalg import Solution, solve_rows, triangularise
from gimbal_pin.regression.recursive import PastRows
from gimbal_pin.rig.brief import brief

WEIGHT_PASSES = 4
HUBER = 1.345
"""Tuning constant: 95 % of least squares' efficiency on Gaussian residuals (Huber 1981)."""
HUBER_PASSES = 10


class Method(str, Enum):
    """How an estimate was made, by the names that the command line and files know."""

    ORDINARY = "ols"
    WEIGHTED = "weighted"
    ROBUST = "robust"
    INSTRUMENTAL = "instrumental"
    OUTPUT_ERROR = "output-error"
    RIDGE = "ridge"
    PHYSICAL = "physical"
    RECURSIVE = "recursive"
    KNOWN = "known"

    __str__ = str.__str__

    @property
    def is_simulating(self) -> bool:
        """Whether the model is simulated along the log: noise in the measured motion biases nothing then."""
        return self in (Method.INSTRUMENTAL, Method.OUTPUT_ERROR)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters from data, with what is known of their uncertainty.

    Attributes:
        theta: Parameters, SI units, (k,).
        covariance: Their covariance, (k, k); infinite variances where the data show nothing. From few rows it is wider
            than that, by Student's t over the normal quantile, so that ± 1.96 `std` hold 95 times in 100 there, too:
            see `covariance.compute_coloured_covariance`.
        residual_std: Root mean square of each joint's residual, N m, (n,).
        condition_number: Of the factor with columns scaled to unit norm.
        rows: Rows per joint.
        method: The estimator.
        phi: The bodies whose base parameters theta holds, (10 n,), where it was fitted through them; else None.
        uncertainty: What the covariance stands on.
    """

    theta: Array
    covariance: Array
    residual_std: Array
    condition_number: float
    rows: int
    method: Method
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


def factor_rows(blocks: Iterable[Block], weights: Iterable[Array] | None = None) -> Array:
    """Triangular factors R of each joint's [A b] over all blocks, (n, k + 1, k + 1); see `factor_each_block`."""
    return merge_factors(factor_each_block(blocks, weights))


def factor_each_block(
    blocks: Iterable[Block], weights: Iterable[Array] | None = None
) -> Iterator[Array]:
    """Yield per block of time the triangular factors R of each joint's [A b], (n, k + 1, k + 1).

    ``RᵀR = [A b]ᵀ[A b]``, the Gram matrix, without ever forming the product, which would square the condition number.
    They are all that least squares needs of the rows: factors of several blocks are merged, a block is left out by
    merging the others, and groups of columns are chosen from R, see `merge_factors` and `choose_columns`.

    Args:
        blocks: Rows.
        weights: Per block, a weight per row and joint, (m, n); None: one.
    """
    for block, weight in zip(blocks, repeat(None) if weights is None else weights):
        _, n, width = block.A.shape
        out = np.zeros((n, width + 1, width + 1))
        # A joint feels only what it carries: columns of zeros cost nothing.
        for j, present in enumerate(np.asarray(block.A.any(axis=0))):
            felt = np.append(np.flatnonzero(present), width)
            rows = np.column_stack([block.A[:, j][:, felt[:-1]], block.b[:, j]])
            R = triangularise(rows if weight is None else rows * weight[:, j, None])
            out[j][: len(R), felt] = R
        yield out


def merge_factors(factors: Iterable[Array]) -> Array:
    """Factors of the rows of several blocks together, (n, k + 1, k + 1), one QR on top of the last (TSQR)."""
    each = iter(factors)
    merged = next(each)
    for newer in each:
        # Rows of zeros cost nothing.
        merged = np.stack(
            [triangularise(np.vstack([R, new[new.any(axis=1)]])) for R, new in zip(merged, newer)]
        )
    return merged


def choose_columns(factors: Array, places: Sequence[int]) -> Array:
    """Factors of the same rows with some of their columns only, (n, c + 1, c + 1); the torque's is kept."""
    return np.stack([triangularise(R[:, [*places, -1]]) for R in factors])


def solve_factors(factors: Array, scale: Array, prior: Array | None = None) -> Solution:
    """Least squares over all joints, joint j's rows multiplied by ``scale[j]``, and what is known beforehand.

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        scale: Square root of each joint's weight, (n,).
        prior: Rows ``[U z]`` with ``U theta = z`` up to noise of unit size, (any, k + 1); None: none.
    """
    rows = (factors * scale[:, None, None]).reshape(-1, factors.shape[2])
    return solve_rows(rows if prior is None else np.concatenate([prior, rows]))


def weigh_and_solve(
    factors: Array, power_of: Callable[[Array], Array], prior: Array | None = None
) -> tuple[Solution, Array, Array]:
    """Solve, weigh each joint by its residual, and again; `WEIGHT_PASSES` times and once more.

    Args:
        factors: Of each joint's [A b], (n, k + 1, k + 1).
        power_of: theta → each joint's residual power, (n,).
        prior: As for `solve_factors`.

    Returns:
        The solution; the power, and the weights' roots, (n,).
    """
    scale: Array = np.ones(len(factors))
    for _ in range(WEIGHT_PASSES):
        power = power_of(solve_factors(factors, scale, prior).theta)
        scale = weigh_joints(power)
    return solve_factors(factors, scale, prior), power, scale


def weigh_joints(power: Array) -> Array:
    """``1 / σ_j`` from each joint's mean square residual, (n,).

    A joint that never moved has no residual: without a floor it would take all the weight.
    """
    return np.asarray(
        1.0 / np.sqrt(np.maximum(power, 1e-6 * power.max() + 1e-30)), dtype=np.float64
    )


def compute_gain(blocks: Sequence[Block], estimate: Estimate) -> tuple[Array, Array]:
    """Return ``G = (AᵀWA)⁻¹`` of an estimate's rows, (k, k), and the root of W, ``1 / σ_j`` or one, (n,)."""
    ordinary = estimate.method is Method.ORDINARY
    spread = estimate.residual_std
    scale = np.ones(len(spread)) if ordinary else weigh_joints(spread**2)
    return solve_factors(factor_rows(blocks), scale).gain, scale


def count_effective_rows(blocks: Sequence[Block]) -> Array:
    """Rows per joint that were not masked out, (n,)."""
    return np.sum([np.sum(block.share**2, axis=0) for block in blocks], axis=0)


def compute_residual_power(factors: Array, theta: Array, rows: Array) -> Array:
    """Mean square of each joint's residual, corrected for the parameters' share of the rows (n,), (N m)², (n,)."""
    error = factors @ np.append(theta, -1.0)
    return np.sum(error**2, axis=1) / np.maximum(rows - len(theta) / len(factors), 1.0)


def compute_residuals(block: Block, theta: Array) -> Array:
    """``b - A theta``, N m, (m, n)."""
    return block.b - block.A @ theta


def compute_covariance(
    blocks: Sequence[Block],
    solution: Solution,
    scale: Array,
    prior: Array | None = None,
    past: PastRows | None = None,
) -> Array:
    """Covariance of weighted least squares under coloured, joint-wise different residuals, (k, k).

    ``H⁻¹ (S + UᵀU) H⁻¹`` with H = AᵀWA + UᵀU and S the covariance of AᵀWe: the residual's own colour instead of the
    assumption that it is white.

    Args:
        blocks: Rows.
        solution: Of their factors.
        scale: Square root of each joint's weight, (n,).
        prior: As for `solve_factors`.
        past: As for `solve`.
    """
    gain = solution.gain
    out = compute_coloured_covariance(
        blocks, [block.A for block in blocks], solution.theta, gain, scale**2
    )
    if prior is not None:
        half = prior[:, :-1] @ gain
        out = out + half.T @ half
    if past is not None:
        out = out + gain @ np.einsum("j,jab->ab", scale**4, past.score) @ gain
    return solution.mark_unseen(out)


def solve(
    blocks: Sequence[Block],
    prior: Array | None = None,
    scale: Array | None = None,
    method: Method = Method.WEIGHTED,
    past: PastRows | None = None,
) -> Estimate:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖² / σ_j² + ‖U theta - z‖²`` by triangular factors.

    Args:
        blocks: Rows.
        prior: Rows ``[U z]`` of what is known beforehand, as for `solve_factors`.
        scale: ``1 / σ_j``, (n,); None: from the residuals, iterated (Gautier 1997). A lightly loaded axis has small
            torques and small errors; equal weights would let the heavy axes' errors drown what only that axis shows.
            The factors are computed once; every pass only reweights them.
        method: The estimator.
        past: Rows before these that are not held any longer.
    """
    factors = factor_rows(blocks)
    count = count_effective_rows(blocks)
    if past is not None:
        factors = merge_factors([past.factors[:, :, :-1], factors])
        count = count + past.count
    if scale is None:
        found, power, scale = weigh_and_solve(
            factors, lambda x: compute_residual_power(factors, x, count), prior
        )
    else:
        found = solve_factors(factors, scale, prior)
        power = compute_residual_power(factors, found.theta, count)
    spread = compute_covariance(blocks, found, scale, prior, past)
    rows = sum(len(block.t) for block in blocks) + (0 if past is None else past.rows)
    return Estimate(found.theta, spread, np.sqrt(power), found.condition, rows, method)


def fit_ordinary(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ‖b - A theta‖²`` over all joints alike."""
    return solve(blocks, scale=np.ones(blocks[0].b.shape[1]), method=Method.ORDINARY)


def fit_weighted(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖² / σ_j²``, σ_j from the residuals: `solve` without a prior."""
    return solve(blocks)


def fit_robust(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ρ((b - A theta) / σ_j)`` with Huber's ρ, by reweighted least squares.

    σ_j is the median absolute residual of joint j, over 0.6745.
    """
    used = np.concatenate([block.share for block in blocks]) > 0
    theta = fit_weighted(blocks).theta
    for _ in range(HUBER_PASSES):
        errors = [np.abs(compute_residuals(block, theta)) for block in blocks]
        middle = [
            np.median(np.append(x[rows], 0.0)) for x, rows in zip(np.concatenate(errors).T, used.T)
        ]
        sigma = np.maximum(np.array(middle) / 0.6745, 1e-12)
        weights = [
            np.sqrt(np.minimum(1.0, HUBER * sigma / np.maximum(error, 1e-300))) for error in errors
        ]
        factors = factor_rows(blocks, weights)
        theta = solve_factors(factors, 1.0 / sigma).theta
    weighted = [
        block._replace(
            A=block.A * weight[:, :, None], b=block.b * weight, share=block.share * weight
        )
        for block, weight in zip(blocks, weights)
    ]
    power = compute_residual_power(factors, theta, count_effective_rows(blocks))
    return replace(
        solve(weighted, scale=1.0 / sigma, method=Method.ROBUST), residual_std=np.sqrt(power)
    )
