"""Held-out log density of models over blocks of time, and the gain of a group of columns in closed form.

A model predicts the whitened torque of n joints, ``y_j = B_j θ + e_j``, with a Gaussian prior of precision R on θ. It
is fitted to all folds but k and predicts fold k. With the squared held-out errors ``s_jk`` and the effective rows
``n_jk``, ``n_j = Σ_k n_jk``, ``σ_j² = Σ_k s_jk / n_j``, model B gains over model A

    D = Σ_j n_j/2 log(σ_jA²/σ_jB²) = Σ_k D_k
    D_k = D/K + (1 - 1/K) (mean_i D_(i) - D_(k))
    se(D) = √K std_k(D_k)

D_(k) is the gain without fold k, and the deviation the jackknife's. A gain that rests on one event, in one fold,
has a deviation of its own size.

nats, plus half of the fall of the prior's squares ``θ' R θ``, which the folds share: a cause that leaves trusted bodies
as they are stated gains by that. It is a K-fold log predictive density with profiled dispersion (Vehtari, Gelman and
Gabry, Statistics and Computing 27, 2017). The standard error is too small with few or dependent blocks (Sivula,
Magnusson and Vehtari, 2020).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import t as student

from gimbal_pin.diagnosis.rows import Indices
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.log.log import Array

REWEIGHTINGS = 2
"""Number of fits: the second uses the dispersion of the first as the joints' weights."""
SINGULAR = 1e-9
"""Ridge on columns of unit norm, and size below which a column counts as zero."""
NO_TORQUE = 1e-100
"""Norm below which a candidate's columns are zero: its inverse square must be a number."""
GROUP_RIDGE = 1e-6
"""Ridge on a candidate's columns of unit norm."""
WIDE_GROUP = 6
"""Columns from which a group is multiplied by itself and not in a batch."""


def compute_gain(before: Array, after: Array, rows: Array) -> Array:
    """Return the gain of each fold D_k, nats, (..., K).

    Args:
        before: Squared held-out errors of model A, (K, n).
        after: The same of one or several models B, (..., K, n).
        rows: Effective rows, (K, n).
    """
    count = len(rows)
    total = 0.5 * np.sum(rows.sum(axis=0) * _compare(before.sum(axis=0), after.sum(axis=-2)), -1)
    without = 0.5 * np.sum(
        (rows.sum(axis=0) - rows)
        * _compare(before.sum(axis=0) - before, after.sum(axis=-2)[..., None, :] - after),
        axis=-1,
    )
    influence = (1 - 1 / count) * (total[..., None] - without)
    centred = influence - influence.mean(axis=-1, keepdims=True)
    return np.asarray(total[..., None] / count + centred)


def _compare(before: Array, after: Array) -> Array:
    """Return the log of the ratio of squared errors; rounding is none."""
    return np.log(np.maximum(before, 1e-12) / np.maximum(after, 1e-12))


def compare_fits(before: BlockFit, after: BlockFit) -> Array:
    """Return the gain of one fit over another by fold, nats, (K,)."""
    gain = compute_gain(before.squared_errors, after.squared_errors, before.rows)
    return np.asarray(gain + 0.5 * (before.prior_squares - after.prior_squares) / len(gain))


def compute_standard_error(by_fold: Array) -> Array:
    """Return ``√K std_k(D_k)``, (...), of gains by fold (..., K)."""
    return np.asarray(np.sqrt(by_fold.shape[-1]) * by_fold.std(axis=-1, ddof=1))


class Batch(NamedTuple):
    """Groups of columns that have equally many of them.

    Attributes:
        width: Columns of each group.
        groups: Numbers of the groups, (g,).
        columns: Their columns in the pack.
        grams: Joint → products of each group's columns with each other by fold, (K, g, width, width).
    """

    width: int
    groups: Indices
    columns: slice
    grams: Mapping[int, Array]


@dataclass(frozen=True, eq=False)
class Pack:
    """Whitened columns of many groups and their products, which do not depend on the model beside them.

    Attributes:
        columns: Joint → inner rows of all columns, (N, c), ordered by batch, of unit norm.
        norms: Their norms before, (c,).
        batches: Groups by their number of columns.
        targets: Joint → products with the torque by fold, (K, c).
        count: Number of groups.
    """

    columns: Mapping[int, Array]
    norms: Array
    batches: tuple[Batch, ...]
    targets: Mapping[int, Array]
    count: int

    @property
    def width(self) -> int:
        """Columns of the widest group."""
        return max(batch.width for batch in self.batches)


class Gains(NamedTuple):
    """Gain of each of G groups of columns over the model without it.

    Attributes:
        total: D, nats, (G,).
        by_fold: D_k, (G, K).
        coefficients: Of a fit to all folds, (G, widest); what a narrower group lacks is 0.
        covariance: Of these, (G, widest, widest).
        remaining: Largest share of a column's power in a group that the model's columns do not explain, (G,).
        errors: Squared held-out errors, (G, K, n).
        beside: Coefficients of some columns of the model beside the group, in their deviations, (G, b).
    """

    total: Array
    by_fold: Array
    coefficients: Array
    covariance: Array
    remaining: Array
    errors: Array
    beside: Array

    @property
    def standard_error(self) -> Array:
        """se(D), (G,)."""
        return compute_standard_error(self.by_fold)


@dataclass(frozen=True, eq=False)
class BlockFit:
    """A model fitted to all folds but each in turn.

    Attributes:
        columns: Inner whitened rows of each joint's columns, of unit norm over all joints, n of (N, p).
        norms: Their norms before, (p,); infinite for columns that are zero.
        prior: Prior precision of the coefficients of these, (p,).
        target: Inner whitened torque, (N, n).
        folds: Slices of the folds.
        rows: Effective rows, (K, n).
        weight: ``1/σ_j²``, (n,).
        products: ``B_jk' B_jk``, (K, n, p, p).
        factors: Factors of the normal equations without each fold.
        solutions: θ without each fold, (K, p), in units of the norms.
        errors: Held-out errors, (N, n).
        error_products: ``B_jk' e_jk``, (K, n, p).
        whole: Factor of the normal equations of all folds.
        solution: θ of all folds, in units of the norms, (p,).
    """

    columns: tuple[Array, ...]
    norms: Array
    prior: Array
    target: Array
    folds: tuple[slice, ...]
    rows: Array
    weight: Array
    products: Array
    factors: tuple[tuple[Array, bool], ...]
    solutions: Array
    errors: Array
    error_products: Array
    whole: tuple[Array, bool]
    solution: Array

    @property
    def squared_errors(self) -> Array:
        """Squared held-out errors, (K, n)."""
        starts = [fold.start for fold in self.folds]
        return np.asarray(np.add.reduceat(self.errors**2, starts, axis=0))

    @property
    def prior_squares(self) -> float:
        """``θ' R θ`` of the fit to all folds."""
        kept = np.isfinite(self.norms)
        return float(np.sum(self.prior[kept] * self.solution[kept] ** 2))

    @property
    def theta(self) -> Array:
        """Coefficients of a fit to all folds, (p,)."""
        return np.asarray(self.solution / self.norms)

    @property
    def fold_thetas(self) -> Array:
        """Coefficients without each fold, (K, p)."""
        return np.asarray(self.solutions / self.norms)

    @property
    def covariance(self) -> Array:
        """Covariance of θ under noise whose correlation is shorter than a fold, (p, p).

        ``s² [(K-1)/K Σ_k (θ_k - θ)(θ_k - θ)' + H⁻¹ R H⁻¹]``: the jackknife over folds, and what the prior of precision
        R leaves open. ``θ - θ_k = H⁻¹ g_k``, g_k the gradient of fold k's held-out errors; gradients of the residuals
        make it too small where many coefficients meet few folds (Bell and McCaffrey, Survey Methodology 28, 2002).
        ``s = t/z`` lets 1.96 deviations hold the 95 % of Student's distribution with K - 1 degrees.
        """
        count = len(self.folds)
        gradient = np.tensordot(self.error_products, self.weight, (1, 0))
        spread = cho_solve(self.whole, gradient.T, check_finite=False)
        inverse = cho_solve(self.whole, np.eye(len(self.solution)), check_finite=False)
        scaled = spread @ spread.T * (count - 1) / count + inverse * self.prior @ inverse
        stretch = float(student.isf(0.025, count - 1)) / NORMAL_95
        return np.asarray(stretch**2 * scaled / np.outer(self.norms, self.norms))

    def refit(self, target: Array) -> BlockFit:
        """Return the same model with the same weights fitted to another whitened torque, (N, n)."""
        targets = _multiply_targets(self.columns, target, self.folds)
        right = np.tensordot(targets, self.weight, (1, 0))
        total = right.sum(axis=0)
        solutions = np.array(
            [cho_solve(L, total - part, check_finite=False) for L, part in zip(self.factors, right)]
        )
        errors = _leave_errors(self.columns, target, self.folds, solutions)
        return replace(
            self,
            target=target,
            solutions=solutions,
            errors=errors,
            error_products=_multiply_targets(self.columns, errors, self.folds),
            solution=np.asarray(cho_solve(self.whole, total, check_finite=False)),
        )

    def measure(self, pack: Pack, ridge: float = GROUP_RIDGE, beside: Sequence[int] = ()) -> Gains:
        """Return what each group of a pack gains; the Schur complement gives all fits at once.

        Args:
            pack: The groups.
            ridge: Prior precision of a group's columns of unit norm.
            beside: Columns of the model whose coefficients beside each group are wanted.
        """
        sums = _Sums.of(self, pack)
        folds, joints = self.rows.shape
        parts = [_measure_batch(self, pack, sums, batch, ridge, beside) for batch in pack.batches]
        width = pack.width
        coefficients = np.zeros((pack.count, width))
        covariance = np.zeros((pack.count, width, width))
        remaining = np.zeros(pack.count)
        errors = np.zeros((pack.count, folds, joints))
        next_to = np.zeros((pack.count, len(beside)))
        squares = np.zeros(pack.count)
        for batch, part in zip(pack.batches, parts):
            at = batch.groups
            coefficients[at, : batch.width] = part.coefficients
            covariance[at, : batch.width, : batch.width] = part.covariance
            remaining[at] = part.remaining
            errors[at] = part.errors
            next_to[at] = part.beside
            squares[at] = part.prior_squares
        by_fold = compute_gain(self.squared_errors, errors, self.rows)
        by_fold = by_fold + 0.5 * (self.prior_squares - squares)[:, None] / folds
        total = by_fold.sum(axis=-1)
        return Gains(total, by_fold, coefficients, covariance, remaining, errors, next_to)

    def project_off(self, added: Mapping[int, Array]) -> Array:
        """Return the model's coefficients that imitate an added whitened torque: joint → inner rows (N,)."""
        right = sum(self.weight[j] * (self.columns[j].T @ rows) for j, rows in added.items())
        return np.asarray(cho_solve(self.whole, right, check_finite=False)) / self.norms


def fit_blocks(
    columns: Sequence[Array],
    target: Array,
    folds: tuple[slice, ...],
    rows: Array,
    precision: Array,
    weight: Array | None = None,
) -> BlockFit:
    """Fit a model to all folds but each in turn.

    Args:
        columns: Inner whitened rows of each joint's columns, n of (N, p).
        target: Inner whitened torque, (N, n).
        folds: Slices of the folds.
        rows: Effective rows, (K, n).
        precision: Prior precision of each coefficient, in its unit^-2, (p,); the prior's mean is 0.
        weight: Start of the joints' weights ``1/σ_j²``; None: 1.
    """
    norms = np.sqrt(sum(np.sum(B**2, axis=0) for B in columns))
    norms = np.where(norms > SINGULAR * norms.max(), norms, np.inf)
    scaled = tuple(B / norms for B in columns)
    # A column of zeros would make the normal equations singular.
    prior = np.where(np.isfinite(norms), precision / norms**2, 1.0)
    products = np.array([[B[fold].T @ B[fold] for B in scaled] for fold in folds])
    start = np.ones(target.shape[1]) if weight is None else weight
    return _solve_blocks(scaled, norms, prior, products, target, folds, rows, start)


def _solve_blocks(
    scaled: tuple[Array, ...],
    norms: Array,
    prior: Array,
    products: Array,
    target: Array,
    folds: tuple[slice, ...],
    rows: Array,
    weight: Array,
) -> BlockFit:
    """Solve the normal equations of columns of unit norm without each fold."""
    targets = _multiply_targets(scaled, target, folds)
    for _ in range(REWEIGHTINGS):
        left = np.tensordot(products, weight, (1, 0))
        right = np.tensordot(targets, weight, (1, 0))
        whole = left.sum(axis=0)
        total = right.sum(axis=0)
        ridge = np.diag(prior + SINGULAR * np.trace(whole) / len(total))
        factors = tuple(cho_factor(whole - part + ridge, check_finite=False) for part in left)
        solutions = np.array(
            [cho_solve(L, total - part, check_finite=False) for L, part in zip(factors, right)]
        )
        errors = _leave_errors(scaled, target, folds, solutions)
        used_weight = weight
        squared = np.sum(errors**2, axis=0) / rows.sum(axis=0)
        weight = 1.0 / np.maximum(squared, 1e-12)
    factor = cho_factor(whole + ridge, check_finite=False)
    return BlockFit(
        columns=scaled,
        norms=norms,
        prior=prior,
        target=target,
        folds=folds,
        rows=rows,
        weight=used_weight,
        products=products,
        factors=factors,
        solutions=solutions,
        errors=errors,
        error_products=_multiply_targets(scaled, errors, folds),
        whole=factor,
        solution=np.asarray(cho_solve(factor, total, check_finite=False)),
    )


def _multiply_targets(columns: Sequence[Array], target: Array, folds: Sequence[slice]) -> Array:
    """Return the products of each joint's columns with its rows of a target by fold, (K, n, p)."""
    return np.array([[B[fold].T @ y[fold] for B, y in zip(columns, target.T)] for fold in folds])


def _leave_errors(
    columns: Sequence[Array], target: Array, folds: Sequence[slice], solutions: Array
) -> Array:
    """Return the target less each fold's prediction by the solution without it, (N, n)."""
    predicted = [
        np.stack([B[fold] @ x for B in columns], axis=1) for fold, x in zip(folds, solutions)
    ]
    return np.asarray(target - np.concatenate(predicted))


def pack_columns(
    columns: Mapping[int, Array], widths: Sequence[int], target: Array, folds: Sequence[slice]
) -> Pack:
    """Return groups of columns as a pack.

    Args:
        columns: Joint → inner whitened rows, (N, c), groups side by side.
        widths: Number of columns of each group.
        target: Inner whitened torque, (N, n).
        folds: Slices of the folds.
    """
    ends = np.cumsum(widths)
    order = list[int]()
    shapes = list[tuple[int, Indices, slice]]()
    for width in sorted({*widths}):
        groups = np.flatnonzero(np.array(widths) == width)
        first = len(order)
        order += [k for group in groups for k in range(ends[group] - width, ends[group])]
        shapes.append((width, groups, slice(first, len(order))))
    norms = np.sqrt(sum(np.sum(x**2, axis=0) for x in columns.values()))[order]
    norms = np.where(norms > NO_TORQUE, norms, 1.0)
    unit = {j: x[:, order] / norms for j, x in columns.items()}
    batches = tuple(
        Batch(
            width,
            groups,
            at,
            {j: _multiply_groups(x[:, at], width, folds) for j, x in unit.items()},
        )
        for width, groups, at in shapes
    )
    targets = {j: np.array([target[fold, j] @ x[fold] for fold in folds]) for j, x in unit.items()}
    return Pack(unit, norms, batches, targets, len(widths))


def _multiply_groups(columns: Array, width: int, folds: Sequence[slice]) -> Array:
    """Return the products of each group's columns with each other by fold, (K, g, width, width)."""
    groups = columns.shape[1] // width
    out = np.empty((len(folds), groups, width, width))
    stacked = columns.reshape(len(columns), groups, width)
    if width > WIDE_GROUP:
        for k, fold in enumerate(folds):
            out[k] = np.matmul(stacked[fold].transpose(1, 2, 0), stacked[fold].transpose(1, 0, 2))
        return out
    starts = [fold.start for fold in folds]
    for a in range(width):
        for b in range(a + 1):
            product = np.add.reduceat(stacked[:, :, a] * stacked[:, :, b], starts, axis=0)
            out[:, :, a, b] = product
            out[:, :, b, a] = product
    return out


class _Sums(NamedTuple):
    """Products of a pack's columns with a model's, the held-out errors and the torque.

    Attributes:
        base: Joint → ``B_jk' X_jk``, (K, p, c).
        left_out: Weighted products of the rows of all folds but k with the model's columns, (K, p, c).
        solved: The same after the normal equations without fold k.
        error: Joint → ``X_jk' e_jk``, (K, c).
        right: Products with what the model leaves of the other folds' torque, (K, c).
        whole: Weighted products of all rows with the model's columns, (p, c).
        whole_solved: The same after the normal equations of all folds.
        whole_right: Products with what the model leaves of all folds' torque, (c,).
    """

    base: Mapping[int, Array]
    left_out: Array
    solved: Array
    error: Mapping[int, Array]
    right: Array
    whole: Array
    whole_solved: Array
    whole_right: Array

    @staticmethod
    def of(fit: BlockFit, pack: Pack) -> _Sums:
        base = {
            j: np.array([fit.columns[j][fold].T @ x[fold] for fold in fit.folds])
            for j, x in pack.columns.items()
        }
        error = {
            j: np.array([fit.errors[fold, j] @ x[fold] for fold in fit.folds])
            for j, x in pack.columns.items()
        }
        weighted = sum(fit.weight[j] * x for j, x in base.items())
        target = sum(fit.weight[j] * x for j, x in pack.targets.items())
        whole = weighted.sum(axis=0)
        left_out = whole - weighted
        solved = np.array(
            [cho_solve(L, x, check_finite=False) for L, x in zip(fit.factors, left_out)]
        )
        right = target.sum(axis=0) - target - np.einsum("kpc,kp->kc", left_out, fit.solutions)
        whole_solved = np.asarray(cho_solve(fit.whole, whole, check_finite=False))
        whole_right = target.sum(axis=0) - whole.T @ fit.solution
        return _Sums(base, left_out, solved, error, right, whole, whole_solved, whole_right)


class _BatchGains(NamedTuple):
    """Entries of `Gains` for one batch."""

    coefficients: Array
    covariance: Array
    remaining: Array
    errors: Array
    beside: Array
    prior_squares: Array


def _measure_batch(
    fit: BlockFit, pack: Pack, sums: _Sums, batch: Batch, ridge: float, beside: Sequence[int]
) -> _BatchGains:
    """Return what the groups of a batch gain."""
    width = batch.width
    groups = len(batch.groups)

    prior = np.eye(width) * ridge
    gram = sum(fit.weight[j] * x for j, x in batch.grams.items())  # (K, g, w, w)
    total = gram.sum(axis=0)
    a = _by_group(sums.left_out, batch)  # (K, g, p, w)
    b = _by_group(sums.solved, batch)
    schur = total - gram - a.swapaxes(-1, -2) @ b + prior
    right = sums.right[:, batch.columns].reshape(-1, groups, width)
    x = _solve_small(schur, right)  # (K, g, w)
    moved = (b @ x[..., None])[..., 0]  # (K, g, p)
    squared = fit.squared_errors
    errors = np.empty((groups, *squared.shape))
    for j in range(squared.shape[1]):
        along = fit.products[:, j]
        quadratic = np.sum(moved * (moved @ along), axis=-1)
        linear = -np.sum(moved * fit.error_products[:, j, None], axis=-1)
        if j in batch.grams:
            crossed = _by_group(sums.base[j], batch)
            quadratic += np.sum(x * (batch.grams[j] @ x[..., None])[..., 0], axis=-1)
            quadratic -= 2 * np.sum(moved * (crossed @ x[..., None])[..., 0], axis=-1)
            own = sums.error[j][:, batch.columns].reshape(-1, groups, width)
            linear += np.sum(x * own, axis=-1)
        errors[:, :, j] = (squared[:, j, None] - 2 * linear + quadratic).T
    whole = _by_group(sums.whole[None], batch)[0]
    solved = _by_group(sums.whole_solved[None], batch)[0]
    schur_whole = total - whole.swapaxes(-1, -2) @ solved + prior
    right_whole = sums.whole_right[batch.columns].reshape(groups, width)
    coefficients = _solve_small(schur_whole, right_whole)
    norms = pack.norms[batch.columns].reshape(groups, width)
    left, power = (np.einsum("gww->gw", x) for x in (schur_whole - prior, total))
    remaining = np.max(left / np.maximum(power, 1e-300), axis=-1)
    inverse = np.linalg.pinv(schur_whole, hermitian=True)
    solutions = fit.solution - (solved @ coefficients[..., None])[..., 0]
    kept = np.isfinite(fit.norms)
    squares = np.sum(fit.prior[kept] * solutions[:, kept] ** 2, axis=-1)
    next_to = np.zeros((groups, len(beside)))
    if len(beside):
        unit = np.eye(len(fit.solution))[:, list(beside)]
        std = np.sqrt(np.sum(unit * cho_solve(fit.whole, unit, check_finite=False), axis=0))
        next_to = solutions[:, list(beside)] / std
    return _BatchGains(
        coefficients / norms,
        inverse / (norms[:, :, None] * norms[:, None, :]),
        remaining,
        errors,
        next_to,
        squares,
    )


def _by_group(columns: Array, batch: Batch) -> Array:
    """Return (K, p, c) as (K, g, p, width) of a batch's groups."""
    own = columns[..., batch.columns]
    folds, places, _ = own.shape
    return np.ascontiguousarray(
        own.reshape(folds, places, len(batch.groups), batch.width).transpose(0, 2, 1, 3)
    )


def _solve_small(left: Array, right: Array) -> Array:
    """Solve many small systems, (..., w, w) and (..., w)."""
    try:
        return np.asarray(np.linalg.solve(left, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        width = left.shape[-1]
        trace = np.einsum("...ww->...", left)[..., None, None] / width + 1e-300
        ridged = left + GROUP_RIDGE * np.eye(width) * trace
        return np.asarray(np.linalg.solve(ridged, right[..., None])[..., 0])
