"""Least squares on whitened rows, the joints weighted by what is left at them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief

FIT_PASSES = 4
LUCK = 0.5
"""Least dispersion that is believed: what fits better than its sensors allow is luck, not knowledge."""
CRITICAL_Z = 1.96
"""Deviations from which two models are told apart (Vuong, Econometrica 57, 1989; 95 %)."""


@dataclass(frozen=True, eq=False)
class Fit:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖²/φ_j`` on rows of unit noise.

    Attributes:
        theta: Coefficients, (k,).
        stack: Weighted A, (rows n, k).
        target: Weighted b, (rows n,).
        axes: ``A axes`` are orthonormal columns that span the weighted A, (k, r).
        residual: Weighted residual, (rows n,).
        scale: ``1/√φ_j``, (n,); the dispersion φ is residual power over predicted noise power.
        information: ``(AᵀWA)⁻¹``, (k, k).
        block: Block of each weighted row, (rows n,).
        prior: Precision of what is known of theta beside the rows, (k, k); 0: nothing.
    """

    theta: Array
    stack: Array
    target: Array
    axes: Array
    residual: Array
    scale: Array
    information: Array
    block: Array
    prior: Array | float = 0.0

    __repr__ = brief

    @property
    def dispersion(self) -> Array:
        """Residual power over predicted noise power, per joint, (n,)."""
        return 1.0 / self.scale**2

    @property
    def covariance(self) -> Array:
        """``H⁻¹ (Σ_blocks g gᵀ + prior) H⁻¹`` of theta, (k, k): what is left counts as it is, coloured or not."""
        scores = self.by_block(self.stack * self.residual[:, None])
        return np.asarray(self.information @ (scores.T @ scores + self.prior) @ self.information)

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(self.residual @ self.residual)

    @cached_property
    def power(self) -> Array:
        """Weighted sum of squares of the target, per joint, (n,)."""
        return np.sum(self.target.reshape(-1, len(self.scale)) ** 2, axis=0)

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """First row of each block, (blocks,)."""
        return np.flatnonzero(np.diff(self.block, prepend=-1))

    @cached_property
    def basis(self) -> Array:
        """Orthonormal columns that span the weighted A, (rows n, r)."""
        return np.asarray(self.stack @ self.axes)

    @cached_property
    def felt(self) -> list[tuple[Array, Array]]:
        """Columns of the weighted A that are not zero at each joint, (rows, s), and their axes, (s, r)."""
        own = [self.stack[self.rows(j)] for j in range(len(self.scale))]
        return [
            (np.asfortranarray(x[:, there]), self.axes[there])
            for x in own
            for there in [np.any(x != 0, axis=0)]
        ]

    def rows(self, joint: int | None) -> slice:
        """Weighted rows of a joint; None: of all."""
        return slice(None) if joint is None else slice(joint, None, len(self.scale))

    def stacked(self, values: Array) -> Array:
        """Weight (rows, n, c) and stack it to (rows n, c)."""
        return (values * self.scale[:, None]).reshape(-1, values.shape[-1])

    def weighted(self, own: Array, joint: int | None) -> Array:
        """Weight columns of a joint, (rows, c), or of all, (rows, n, c): the rows of `rows(joint)`."""
        return self.stacked(own) if joint is None else own * self.scale[joint]

    def along(self, weighted: Array, joint: int | None) -> Array:
        """Components of weighted columns of a joint along the fitted ones, (k, c)."""
        columns, axes = (self.stack, self.axes) if joint is None else self.felt[joint]
        return np.asarray(axes.T @ (columns.T @ weighted))

    def by_block(self, values: Array) -> Array:
        """Sum rows (rows n, c) over each block, (blocks, c)."""
        return np.add.reduceat(values, self.starts, axis=0)


def fit(
    A: Array, b: Array, used: Array, block: Array, scale: Array | None = None, luck: float = LUCK
) -> Fit:
    """Fit b (rows, n) by A (rows, n, k), the joints' dispersions iterated unless `scale` is given.

    Args:
        A: Whitened columns.
        b: Whitened torque.
        used: Share of the rows that count, per joint, (n,).
        block: Block of each row, (rows,).
        scale: ``1/√φ``, (n,), to keep.
        luck: Least dispersion that is believed.
    """
    rows, n, k = A.shape
    weight = np.ones(n) if scale is None else scale
    R = triangles(A, b)
    for _ in range(FIT_PASSES if scale is None else 0):
        theta = least(R, weight)
        power = np.sum((R[..., k] - R[..., :k] @ theta) ** 2, axis=0) / np.maximum(
            rows * used - k / n, 1.0
        )
        weight = 1.0 / np.sqrt(np.maximum(power, luck))
    stack = (A * weight[:, None]).reshape(-1, k)
    target = (b * weight).ravel()
    theta = least(R, weight)
    factor = (R[..., :k] * weight[:, None]).reshape(-1, k)
    size = np.linalg.norm(factor, axis=0)
    unit = np.where(size > 0.0, size, 1.0)
    _, values, right = np.linalg.svd(factor / unit, full_matrices=False)
    seen = values > 1e-10 * values[0]
    axes = (right[seen].T / values[seen]) / unit[:, None]
    return Fit(
        theta,
        stack,
        target,
        axes,
        target - stack @ theta,
        weight,
        axes @ axes.T,
        np.repeat(block, n),
    )


def least(R: Array, weight: Array) -> Array:
    """Least squares of what `triangles` returns, the joints weighted, (k,)."""
    rows = (R * weight[:, None]).reshape(-1, R.shape[-1])
    return np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-10)[0])


def refit(now: Fit, own: Array, joint: int, used: Array) -> Fit:
    """Fit whitened columns at one joint, (rows, c), beside those of a fit, the joints weighted as there."""
    n = len(now.scale)
    stack, target = (
        x.reshape(len(own), n, -1) / now.scale[:, None] for x in (now.stack, now.target)
    )
    beside = np.zeros((len(own), n, own.shape[1]))
    beside[:, joint] = own
    return fit(
        np.concatenate([stack, beside], axis=2), target[:, :, 0], used, now.block[::n], now.scale
    )


def triangles(A: Array, b: Array) -> Array:
    """Triangular factor of each joint's ``[A_j b_j]``, (r, n, k + 1): the same sums of squares in as few rows."""
    return np.stack(
        [np.linalg.qr(np.column_stack([x, y]), mode="r") for x, y in zip(A.swapaxes(0, 1), b.T)],
        axis=1,
    )


def project(now: Fit, own: Array, joint: int | None) -> Array:
    """Weight and stack columns of a joint, (rows, c), or of all, (rows, n, c), without what the fitted ones explain.

    (rows n, c), rows next in memory.
    """
    weighted = now.weighted(own, joint)
    rest = (-now.along(weighted, joint).T @ now.basis.T).T
    rest[now.rows(joint)] += weighted
    return rest
