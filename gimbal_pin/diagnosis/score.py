"""Held-out log density of models over blocks of time, and the gain of groups of columns in closed form.

A model predicts the whitened torque of n joints, ``y_j = B_j θ + e_j``, with a Gaussian prior of precision R on θ. It
is fitted to all folds but k and predicts fold k. With the squared held-out errors ``s_jk`` and the effective rows
``n_jk``, ``n_j = Σ_k n_jk``, ``σ_j² = Σ_k s_jk / n_j``, model B gains over model A, in nats,

    D = Σ_j n_j/2 log(σ_jA²/σ_jB²) = Σ_k D_k
    D_k = D/K + (1 - 1/K) (mean_i D_(i) - D_(k))
    se(D) = √K std_k(D_k)

D_(k) is the gain without fold k, and the deviation the jackknife's. A gain that rests on one event, in one fold,
has a deviation of its own size. Half of the fall of the prior's squares ``θ' R θ`` is added, which the folds share: a
cause that leaves trusted bodies as they are stated gains by that. It is a K-fold log predictive density with profiled
dispersion (Vehtari, Gelman and Gabry, Statistics and Computing 27, 2017). The standard error is too small with few or
dependent blocks (Sivula, Magnusson and Vehtari, 2020).

Axes: K folds, or K + 1 with a last one from which nothing is left out; p coefficients of the model, of which p_j act at
joint j; r rows of a fold; g groups of w columns each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from gimbal_pin.diagnosis.rows import Indices
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.log.log import Array

REWEIGHTINGS = 2
"""Number of fits: the second uses the dispersion of the first as the joints' weights."""
SINGULAR = 1e-9
"""Ridge on columns of unit norm, and share of the largest norm below which a column counts as zero."""
GROUP_RIDGE = 1e-6
"""Ridge on a candidate's columns of unit norm."""


def compute_gain(before: Array, after: Array, rows: Array) -> Array:
    """Return the gain of each fold D_k, nats, (..., K).

    Args:
        before: Squared held-out errors of model A, (K, n).
        after: Squared held-out errors of one or several models B, (..., K, n).
        rows: Effective rows, (K, n).
    """
    count = len(rows)
    # Errors of rounding's size are alike.
    old, new = (np.log(np.maximum(leave_out(x, axis=-2), 1e-12)) for x in (before, after))
    gains = 0.5 * np.sum(leave_out(rows) * (old - new), axis=-1)
    without = gains[..., :-1]
    influence = (1 - 1 / count) * (without.mean(axis=-1, keepdims=True) - without)
    return np.asarray(gains[..., -1:] / count + influence)


def compare_fits(before: BlockFit, after: BlockFit) -> Array:
    """Return the gain of one fit over another by fold, nats, (K,)."""
    gain = compute_gain(before.squared_errors, after.squared_errors, before.rows)
    return np.asarray(gain + 0.5 * (before.prior_squares - after.prior_squares) / len(gain))


def compute_standard_error(by_fold: Array) -> Array:
    """Return ``√K std_k(D_k)``, (...), of gains by fold (..., K)."""
    return np.asarray(np.sqrt(by_fold.shape[-1]) * by_fold.std(axis=-1, ddof=1))


def leave_out(parts: Array, axis: int = 0) -> Array:
    """Return the sums of all parts but each in turn, and of all, (K + 1, ...) of (K, ...)."""
    total = parts.sum(axis=axis, keepdims=True)
    return np.concatenate([total - parts, total], axis=axis)


def split_folds(rows: Array, folds: Sequence[slice]) -> Array:
    """Return rows (N, ...) by fold, (K, r, ...); shorter folds end with zeros, which change no product."""
    out = np.zeros((len(folds), max(fold.stop - fold.start for fold in folds), *rows.shape[1:]))
    for part, fold in zip(out, folds):
        part[: fold.stop - fold.start] = rows[fold]
    return out


class Pack(NamedTuple):
    """Whitened columns of groups of equal width, which do not depend on the model beside them.

    Attributes:
        columns: Joint → inner rows of all columns by fold, (K, r, g w), group by group, of unit norm over the joints.
        grams: Joint → products of each group's columns with each other by fold, (K, g, w, w).
        norms: Norms of the columns before, (g, w).
    """

    columns: Mapping[int, Array]
    grams: Mapping[int, Array]
    norms: Array


def pack_columns(
    columns: Mapping[int, Array], folds: Sequence[slice], width: int | None = None
) -> Pack:
    """Return groups of columns as a pack.

    Args:
        columns: Joint → inner whitened rows, (N, g w), groups side by side.
        folds: Slices of the folds.
        width: Columns of each group; None: all are one group.
    """
    norms = np.sqrt(sum(np.sum(x**2, axis=0) for x in columns.values()))
    norms = np.where(norms > 0, norms, 1.0)
    width = width or len(norms)
    unit = {j: split_folds(x / norms, folds) for j, x in columns.items()}
    grams = dict[int, Array]()
    for j, x in unit.items():
        grouped = x.reshape(*x.shape[:2], -1, width)
        grams[j] = grouped.transpose(0, 2, 3, 1) @ grouped.transpose(0, 2, 1, 3)
    return Pack(unit, grams, norms.reshape(-1, width))


class Gains(NamedTuple):
    """Gain of each of g groups of columns over the model without it.

    Attributes:
        by_fold: D_k, nats, (g, K).
        coefficients: Of a fit to all folds, (g, w).
        remaining: Largest share of a column's power in a group that the model's columns do not explain, (g,).
        errors: Squared held-out errors, (g, K, n).
        beside: The model's coefficients beside the group, in their deviations without it, (g, p).
    """

    by_fold: Array
    coefficients: Array
    remaining: Array
    errors: Array
    beside: Array

    @property
    def total(self) -> Array:
        """D, nats, (g,)."""
        return np.asarray(self.by_fold.sum(axis=-1))


@dataclass(frozen=True, eq=False)
class BlockFit:
    """A model fitted to all folds but each in turn, and to all.

    Attributes:
        columns: Inner whitened rows of the columns that act at each joint by fold, n of (K, r, p_j), of unit norm over
            all joints.
        places: Coefficients of these, n of (p_j,).
        norms: Norms of all columns before, (p,); infinite for columns that are zero.
        prior: Prior precision of the coefficients of unit columns, (p,).
        products: ``B_jk' B_jk``, n of (K, p_j, p_j).
        target: Inner whitened torque, (N, n).
        folds: Slices of the folds.
        rows: Effective rows, (K, n).
        weight: ``1/σ_j²``, (n,).
        inverses: Inverse normal equations of unit columns without each fold and of all folds, (K + 1, p, p).
    """

    columns: tuple[Array, ...]
    places: tuple[Indices, ...]
    norms: Array
    prior: Array
    products: tuple[Array, ...]
    target: Array
    folds: tuple[slice, ...]
    rows: Array
    weight: Array
    inverses: Array

    @cached_property
    def _targets(self) -> Array:
        """The torque by fold, (K, r, n)."""
        return split_folds(self.target, self.folds)

    @cached_property
    def solutions(self) -> Array:
        """θ without each fold and of all folds, in units of the norms, (K + 1, p)."""
        right = np.zeros((len(self.folds), len(self.norms)))
        for j, (B, at) in enumerate(zip(self.columns, self.places)):
            right[:, at] += self.weight[j] * _multiply(B, self._targets[..., j])
        return np.asarray((self.inverses @ leave_out(right)[..., None])[..., 0])

    @cached_property
    def errors(self) -> Array:
        """Held-out errors, (K, r, n)."""
        predicted = [B @ self.solutions[:-1, at, None] for B, at in zip(self.columns, self.places)]
        return np.asarray(self._targets - np.concatenate(predicted, axis=-1))

    @cached_property
    def _error_products(self) -> list[Array]:
        """``B_jk' e_jk``, n of (K, p_j)."""
        return [_multiply(B, self.errors[..., j]) for j, B in enumerate(self.columns)]

    @cached_property
    def _sides(self) -> list[Array]:
        """Each joint's columns, its torque and its held-out errors, n of (K, p_j + 2, r)."""
        return [
            np.concatenate([B, self._targets[..., [j]], self.errors[..., [j]]], axis=-1)
            .swapaxes(1, 2)
            .copy()
            for j, B in enumerate(self.columns)
        ]

    @cached_property
    def squared_errors(self) -> Array:
        """Squared held-out errors, (K, n)."""
        return np.asarray(np.sum(self.errors**2, axis=1))

    @cached_property
    def prior_squares(self) -> float:
        """``θ' R θ`` of the fit to all folds."""
        return float(self.prior @ self.solutions[-1] ** 2)

    @property
    def thetas(self) -> Array:
        """Coefficients without each fold and of a fit to all, (K + 1, p)."""
        return np.asarray(self.solutions / self.norms)

    @property
    def theta(self) -> Array:
        """Coefficients of a fit to all folds, (p,)."""
        return np.asarray(self.solutions[-1] / self.norms)

    @property
    def inverse(self) -> Array:
        """``H⁻¹``, inverse normal equations of unit columns and all folds, (p, p)."""
        return np.asarray(self.inverses[-1])

    @property
    def white_covariance(self) -> Array:
        """``H⁻¹``, (p, p): the covariance of θ if the whitened residual were white."""
        return np.asarray(self.inverse / np.outer(self.norms, self.norms))

    @property
    def covariance(self) -> Array:
        """Covariance of θ under noise whose correlation is shorter than a fold, (p, p).

        ``s² [(K-1)/K Σ_k (θ_k - θ)(θ_k - θ)' + H⁻¹ R H⁻¹]``: the jackknife over folds, and what the prior of precision
        R leaves open. ``θ - θ_k = H⁻¹ g_k``, g_k the gradient of fold k's held-out errors; gradients of the residuals
        make it too small where many coefficients meet few folds (Bell and McCaffrey, Survey Methodology 28, 2002).
        ``s = t/z`` lets 1.96 deviations hold the 95 % of Student's distribution with K - 1 degrees.
        """
        count = len(self.folds)
        gradient = np.zeros((count, len(self.norms)))
        for j, at in enumerate(self.places):
            gradient[:, at] += self.weight[j] * self._error_products[j]
        spread = gradient @ self.inverse
        scaled = spread.T @ spread * (count - 1) / count + self.inverse * self.prior @ self.inverse
        stretch = float(student.isf(0.025, count - 1)) / NORMAL_95
        return np.asarray(stretch**2 * scaled / np.outer(self.norms, self.norms))

    def refit(self, target: Array) -> BlockFit:
        """Return the same model with the same weights fitted to another whitened torque, (N, n)."""
        return replace(self, target=target)

    def measure(self, pack: Pack, ridge: float = GROUP_RIDGE) -> Gains:
        """Return what each group of a pack gains, in closed form for all fits at once.

        With the products ``a = B' W X`` of a group X with the model over the rows of a fit, its coefficients are
        ``x = (X' W X - a' H⁻¹ a + ridge)⁻¹ X' W (y - B θ)``, and those of the model fall by ``H⁻¹ a x``.

        Args:
            pack: The groups.
            ridge: Prior precision of a group's columns of unit norm.
        """
        folds = len(self.folds)
        groups, width = pack.norms.shape
        at = np.unique(np.concatenate([self.places[j] for j in pack.columns]))
        # Each joint's columns, its torque and its held-out errors times those of the groups, (K, p_j + 2, g, w).
        products = dict[int, Array]()
        weighted = np.zeros((folds, len(at) + 1, groups, width))
        gram = np.zeros((folds, groups, width, width))
        for j, X in pack.columns.items():
            products[j] = (self._sides[j] @ X).reshape(folds, -1, groups, width)
            into = np.append(np.searchsorted(at, self.places[j]), len(at))
            weighted[:, into] += self.weight[j] * products[j][:, :-1]
            gram += self.weight[j] * pack.grams[j]
        others = leave_out(weighted)
        total = leave_out(gram)
        # Of a fit's rows: a, H⁻¹ a, and what the model leaves of the torque.
        a = others[:, :-1]
        flat = a.reshape(folds + 1, len(at), -1)
        solved = (self.inverses[:, at[:, None], at] @ flat).reshape(a.shape)
        schur = total - a.transpose(0, 2, 3, 1) @ solved.transpose(0, 2, 1, 3)
        predicted = (self.solutions[:, None, at] @ flat).reshape(folds + 1, groups, width)
        right = others[:, -1] - predicted
        x = _solve_groups(schur + ridge * np.eye(width), right)
        fall = self.inverses[:, :, at] @ _multiply_groups(a, x)  # (K + 1, p, g)

        # Squares of the fold's errors e + B H⁻¹ a x - X x, from products alone.
        errors = np.empty((groups, folds, len(self.columns)))
        for j, places in enumerate(self.places):
            moved = fall[:-1, places]
            slope = self.products[j] @ moved + 2 * self._error_products[j][..., None]
            change = np.sum(moved * slope, axis=1)
            if j in products:
                added = x[:-1]
                felt = _multiply_groups(products[j], added)
                change -= 2 * (felt[:, -1] + np.sum(moved * felt[:, :-2], axis=1))
                change += np.sum(added * (pack.grams[j] @ added[..., None])[..., 0], axis=-1)
            errors[..., j] = (self.squared_errors[:, [j]] + change).T
        solutions = self.solutions[-1] - fall[-1].T
        squares = solutions**2 @ self.prior
        by_fold = compute_gain(self.squared_errors, errors, self.rows)
        share, power = (np.diagonal(y[-1], axis1=-2, axis2=-1) for y in (schur, total))
        return Gains(
            by_fold=by_fold + 0.5 * (self.prior_squares - squares)[:, None] / folds,
            coefficients=x[-1] / pack.norms,
            remaining=np.max(share / np.maximum(power, 1e-300), axis=-1),
            errors=errors,
            beside=solutions / np.sqrt(np.diag(self.inverse)),
        )


def _multiply_groups(columns: Array, x: Array) -> Array:
    """Return the products of groups of columns (K, p, g, w) with their coefficients (K, g, w), (K, p, g)."""
    if x.shape[-1] > x.shape[-2]:
        return np.asarray(np.sum(columns * x[:, None], axis=-1))
    # A sum over few neighbours in memory takes five times as long.
    return np.asarray(sum(columns[..., i] * x[:, None, :, i] for i in range(x.shape[-1])))


def _solve_groups(A: Array, b: Array) -> Array:
    """Solve positive definite systems ``A x = b`` of groups, (K, g, w, w) and (K, g, w)."""
    if b.shape[-1] > b.shape[-2]:
        return np.linalg.solve(A, b[..., None])[..., 0]
    # Elimination of all at once: a call of LAPACK for each small system takes ten times as long.
    A = np.concatenate([A, b[..., None]], axis=-1)
    for k in range(b.shape[-1]):
        pivot = A[..., [k], :] / A[..., [k], k, None]
        A -= A[..., k, None] * pivot
        A[..., [k], :] = pivot
    return np.asarray(A[..., -1])


def _multiply(columns: Array, target: Array) -> Array:
    """Return the products of columns (K, r, p) with a target (K, r) by fold, (K, p)."""
    return np.asarray((target[:, None] @ columns)[:, 0])


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
    # A column of zeros would make the normal equations singular.
    prior = np.where(np.isfinite(norms), precision / norms**2, 1.0)
    places = tuple(np.flatnonzero(np.any(B / norms, axis=0)) for B in columns)
    unit = tuple(split_folds(B[:, at] / norms[at], folds) for B, at in zip(columns, places))
    products = tuple(B.swapaxes(1, 2) @ B for B in unit)
    weight = np.ones(target.shape[1]) if weight is None else weight
    for _ in range(REWEIGHTINGS):
        normal = np.zeros((len(folds), len(norms), len(norms)))
        for j, at in enumerate(places):
            normal[:, at[:, None], at] += weight[j] * products[j]
        sums = leave_out(normal)
        ridge = prior + SINGULAR * np.trace(sums[-1]) / len(norms)
        inverses = np.linalg.inv(sums + np.diag(ridge))
        fit = BlockFit(unit, places, norms, prior, products, target, folds, rows, weight, inverses)
        squared = fit.squared_errors.sum(axis=0) / rows.sum(axis=0)
        weight = 1.0 / np.maximum(squared, 1e-12)
    return fit
