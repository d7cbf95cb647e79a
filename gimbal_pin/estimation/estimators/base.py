"""What every estimator shares: factors instead of stacks, the estimate, its covariance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gimbal_pin.estimation.estimators.colour import coloured
from gimbal_pin.estimation.rows import Block
from gimbal_pin.log.log import Array

LEAF = 8192
"""Numbers in one leaf of the TSQR: it stays in the cache, and is too small for BLAS to wake threads, which on a busy
machine cost a hundred times the work they share."""
RANK = 1e-10
"""Singular values of the scaled factor under this share of the largest are directions that the data do not show."""


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

    @property
    def std(self) -> Array:
        """Standard deviations, (k,)."""
        return np.sqrt(np.diag(self.covariance))


class Estimator(Protocol):
    """Blocks of ``A theta = b`` in, `Estimate` out; the blocks can be iterated more than once.

    Most need nothing but the blocks; the others ask `rows.standing_for` what the columns stand for.
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
    each = iter(weights) if weights is not None else None
    for block in blocks:
        rows = np.concatenate([block.A, block.b[:, :, None]], axis=2)
        if each is not None:
            rows *= next(each)[:, :, None]
        width = rows.shape[2]
        if not factors:
            factors = [np.zeros((0, width))] * rows.shape[1]
        factors = [triangle(np.vstack([R, compressed(rows[:, j])])) for j, R in enumerate(factors)]
    return np.stack([np.vstack([R, np.zeros((R.shape[1] - len(R), R.shape[1]))]) for R in factors])


def compressed(rows: Array) -> Array:
    """As few rows as there are columns that are not zero, with the same RᵀR: a joint feels only what it carries."""
    present = np.asarray(rows.any(axis=0))
    present[-1] = True  # a joint without any torque still has that column
    R = triangle(rows[:, present])
    out = np.zeros((len(R), rows.shape[1]))
    out[:, present] = R
    return out


def triangle(matrix: Array) -> Array:
    """The triangular factor R of ``matrix = Q R``, (k, k) or shorter; a tall matrix is cut into leaves (TSQR)."""
    width = matrix.shape[1]
    leaf = max(LEAF // width, 2 * width)
    while len(matrix) > leaf:
        whole = len(matrix) // leaf * leaf
        leaves = np.asarray(np.linalg.qr(matrix[:whole].reshape(-1, leaf, width), mode="r"))
        matrix = np.concatenate([leaves.reshape(-1, width), matrix[whole:]])
    return np.array(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


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
