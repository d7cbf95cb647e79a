"""Recursive least squares in square-root form: rows in, the batch's weighted estimate and covariance out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.solve import Estimate, Method, Solution, weigh_and_solve
from gimbal_pin.rig.brief import brief

LAGS = 8
"""Rows over which residuals may be correlated: four periods of the cutoff."""
TRUSTED = 40
"""Rows for which the noise that was known beforehand counts."""
LEAST = 1e-9
"""Least eigenvalue of a correlation that counts as one."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the rows: ``U theta = z`` up to noise of unit size, and each joint's noise.

    Attributes:
        equations: ``[U z]``, (any, k + 1).
        gamma: Autocovariance of each joint's residual, (N m)², (LAGS + 1, n); zero where it is not known.
        count: For how many rows that counts.
    """

    equations: Array
    gamma: Array
    count: float


@dataclass(frozen=True, eq=False)
class Moments:
    """All that is kept of the rows so far: as much memory after an hour as after a second.

    A row is ``x = [A b share]`` of one joint. The factor is R of ``Q R = [√w x]``, QR of [R; new rows] being the next
    one: R never holds the squares of the rows, nor squares the condition number. The products at lags
    serve the covariance alone.

    Attributes:
        factors: R of each joint, (n, k + 2, k + 2).
        products: ``Σ w_t w_{t+l} x_t x_{t+l}ᵀ`` at the lags l, (LAGS + 1, n, k + 2, k + 2).
        tail: The newest rows before this one, oldest first, with their weights, (at most LAGS, n, k + 2).
        rows: How many rows went in.
    """

    factors: Array
    products: Array
    tail: Array
    rows: int = 0

    __repr__ = brief

    @staticmethod
    def empty(n: int, width: int) -> Moments:
        """Return the moments of no rows, for n joints and `width` parameters."""
        size = (n, width + 2, width + 2)
        return Moments(np.zeros(size), np.zeros((LAGS + 1, *size)), np.zeros((0, n, width + 2)))

    @property
    def of_rows(self) -> Array:
        """Factors of [A b], (n, k + 1, k + 1)."""
        return self.factors[:, :-1, :-1]

    @property
    def count(self) -> Array:
        """Weighted rows that were not masked out, per joint, (n,)."""
        return np.asarray(np.sum(self.factors[:, :, -1] ** 2, axis=1))

    def break_off(self) -> Moments:
        """Return them for rows that follow after a gap: no residual is correlated across it."""
        return replace(self, tail=self.tail[:0])

    def with_rows(self, rows: Array, fading: Array | None = None) -> Moments:
        """Return the moments with more rows: ``R ← qr([√λ R; x])``, one QR for all of them.

        Args:
            rows: ``[A b share]``, (m, n, k + 2), of consecutive times.
            fading: λ, by which each row multiplies the weight of those before it, (m, n); None: one.
        """
        if not len(rows):
            return self
        fades = np.ones(rows.shape[:2]) if fading is None else fading
        later = np.concatenate([np.cumprod(fades[::-1], axis=0)[::-1], np.ones((1, rows.shape[1]))])
        whole, weights = later[0], later[1:]
        roots = np.sqrt(weights)[:, :, None] * rows
        stacked = np.concatenate([np.sqrt(whole)[:, None, None] * self.factors, roots.swapaxes(0, 1)], axis=1)
        factors = np.asarray(np.linalg.qr(stacked, mode="r"))
        history = np.concatenate([whole[:, None] * self.tail, weights[:, :, None] * rows])
        products = whole[:, None, None] ** 2 * self.products
        for at in range(len(self.tail), len(history)):
            lagged = history[max(at - LAGS, 0) : at + 1][::-1]
            products[: len(lagged)] += lagged[:, :, :, None] * history[at][:, None, :]
        return Moments(factors, products, history[-LAGS:], self.rows + len(rows))

    def to_block(self) -> Block:
        """Return rows that have the same mean squares and products as all those that went in, oldest unknown.

        They are the factors, scaled: what is computed from means over rows (accuracy, visibility) is the same on them.
        """
        size = self.factors.shape[1]
        rows = self.factors.swapaxes(0, 1) * np.sqrt(size / max(self.rows, 1))
        nowhere = np.zeros(rows.shape[:2])
        return Block(np.zeros(size), rows[:, :, :-2], rows[:, :, -2], nowhere, nowhere, rows[:, :, -1])


@dataclass(frozen=True, eq=False)
class Known:
    """An estimate with the noise that it was weighted by.

    Attributes:
        estimate: Parameters and covariance.
        gamma: Autocovariance of each joint's residual, (N m)², (LAGS + 1, n); a positive sequence.
    """

    estimate: Estimate
    gamma: Array

    __repr__ = brief

    @cached_property
    def spread(self) -> Array:
        """The covariance, positive definite: that of coloured residuals need not be one to rounding and beyond."""
        unit = np.sqrt(np.maximum(np.diag(self.estimate.covariance), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(self.estimate.covariance / unit / unit[:, None])
        return np.asarray((vectors * np.maximum(values, LEAST)) @ vectors.T * np.outer(unit, unit))


def solve_recursive(moments: Moments, prior: Prior | None = None) -> Known:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖² / σ_j² + ‖z - U theta‖²``: exactly `regression.solve` of all rows.

    Its covariance is that of the same rows, summed as they came instead of from all of them.
    """
    factors, count = moments.of_rows, moments.count
    width = factors.shape[2] - 1

    def power_of(theta: Array) -> Array:
        squares = np.sum((factors @ np.append(theta, -1.0)) ** 2, axis=1)
        if prior is None:
            return np.asarray(squares / np.maximum(count - width / len(factors), 1.0))
        return np.asarray((squares + prior.count * prior.gamma[0]) / np.maximum(count + prior.count, 1.0))

    equations = None if prior is None else prior.equations
    found, power, scale = weigh_and_solve(factors, power_of, equations)
    theta = found.theta
    total, pairs = _sum_lagged_residuals(moments, theta, prior)
    freedom = np.ones(len(count)) if prior else count / np.maximum(count - width / len(count), 1.0)
    products = _symmetrise_products(moments, width)
    positive = total / np.maximum(pairs[0], 1.0)
    for gamma in (total / np.maximum(pairs, 1.0), positive):
        score = np.einsum("lj,ljab->ab", gamma * freedom * scale**4 * taper_lags()[:, None], products)
        if equations is not None:
            score = score + equations[:, :-1].T @ equations[:, :-1]
        covariance = _sandwich_score(found, score)
        # Few rows can have an autocovariance that is none, each lag being divided by its own number of pairs.
        if (np.diag(covariance) > 0).all():
            break
    return Known(Estimate(theta, covariance, np.sqrt(power), found.condition, moments.rows, Method.RECURSIVE), positive)


def _sum_lagged_residuals(moments: Moments, theta: Array, prior: Prior | None) -> tuple[Array, Array]:
    """Sum of each joint's residual times itself at every lag, (N m)², and the number of pairs, (LAGS + 1, n) each."""
    error = np.append(theta, -1.0)
    total = np.einsum("ljab,a,b->lj", moments.products[:, :, :-1, :-1], error, error, optimize=True)
    pairs = moments.products[:, :, -1, -1]
    if prior is not None:
        total, pairs = total + prior.count * prior.gamma, pairs + prior.count
    return np.asarray(total), np.asarray(pairs)


def _symmetrise_products(moments: Moments, width: int) -> Array:
    """``Σ A_t A_{t+l}ᵀ``, and its transpose where l > 0, (LAGS + 1, n, k, k)."""
    products = moments.products[:, :, :width, :width]
    lagged = products[1:]
    return np.concatenate([products[:1], lagged + lagged.swapaxes(2, 3)])


def loosen_prior(known: Known, directions: Array) -> Prior:
    """Return what stays known if the parameters may move anywhere along some directions.

    ``U (theta - D gamma) = z`` with UᵀU the inverse covariance; an orthogonal transformation that clears ``U D`` below
    its first rows leaves equations without gamma.

    Args:
        known: What was known; its covariance is finite.
        directions: D, (k, r).
    """
    theta, spread = known.estimate.theta, known.spread
    unit = np.sqrt(np.diag(spread))
    U = np.linalg.inv(np.linalg.cholesky(spread / np.outer(unit, unit))) / unit
    r = directions.shape[1]
    R = np.asarray(np.linalg.qr(np.column_stack([U @ directions, U, U @ theta]), mode="r"))
    return Prior(R[r:, r:], known.gamma, TRUSTED)


def taper_lags() -> Array:
    """Weight of each lag's autocovariance, falling to zero beyond `LAGS` (Bartlett), (LAGS + 1,)."""
    return np.asarray(1.0 - np.arange(LAGS + 1) / (LAGS + 1), dtype=np.float64)


def _sandwich_score(found: Solution, score: Array) -> Array:
    """``H⁻¹ S H⁻¹``, with infinite variances where H⁻¹ has them, (k, k).

    S is that of Newey and West 1987: its sums over lags are all that constant memory allows. The batch fits each
    residual's colour instead.
    """
    out = found.gain @ score @ found.gain
    blind = ~np.isfinite(np.diag(found.information))
    out[blind, blind] = np.inf
    return out
