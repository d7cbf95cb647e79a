"""Standard deviations of a finding's figures: clustered over blocks of time and bins of the state, shapes included.

A formula that is nearly right errs the same way whenever the joint is back at an angle, or runs at a rate, again. Over
blocks of time such errors cancel, and their scatter says nothing of them; over bins of the state they add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import find_settled
from gimbal_pin.diagnosis.fit import CRITICAL_Z, project
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, refit_without, width
from gimbal_pin.effects import Cause, RigEffect, Signal
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array

Labels = NDArray[np.intp]
UNCHANGED_SHARE = 1e-9
"""Change of a column, as a share of it, up to which that shape parameter changes nothing."""


def label_clusters(evidence: Evidence) -> tuple[Labels, ...]:
    """Cluster of every row, (rows n,): its block of time, and its own joint's bin of the angle and of the rate's size.

    Time holds all joints together; a bin of the state is one joint's own.
    """
    rows = [
        (part.channels, np.arange(part.rows) * len(part.gate) // part.rows)
        for part in evidence.parts
    ]
    angle, rate = (
        np.concatenate([getattr(channels, name)[at] for channels, at in rows]) for name in "qv"
    )
    return np.repeat(evidence.block, evidence.rig.n), bin_rows(angle), bin_rows(np.abs(rate))


def bin_rows(x: Array, count: int = 10) -> Labels:
    """Bin of every row at its own joint, over the quantiles of x, (rows, n) → (rows n,): as many rows in each."""
    inner = np.linspace(0.0, 1.0, count + 1)[1:-1]
    each = [j * count + np.searchsorted(np.quantile(own, inner), own) for j, own in enumerate(x.T)]
    return np.stack(each, axis=1).ravel()


def cluster_covariance(
    basis: Array, residual: Array, labels: Sequence[Labels], width: int
) -> Array:
    """``V_1 + Σ_k (V_k - V_1)₊`` of the first coordinates in an orthonormal basis, (width, width).

    Clustering in several ways at once (Cameron, Gelbach and Miller, Robust inference with multiway clustering, J. Bus.
    Econ. Stat. 29, 2011); of each beyond the first counts the positive part of what it adds.

    Args:
        basis: Orthonormal columns that span the model, those asked for first, (rows, k).
        residual: What the model leaves, (rows,).
        labels: Ways to cluster the rows, (rows,) each.
        width: How many coordinates are asked for.
    """
    first, *others = (compute_clustered(basis, residual, label, width) for label in labels)
    return first + sum((keep_excess(other, first) for other in others), np.zeros_like(first))


def compute_clustered(basis: Array, residual: Array, label: Labels, width: int) -> Array:
    """``G/(G-1) Σ_g d_g d_gᵀ`` with ``d_g = (I - U_gᵀU_g)^(-1/2) U_gᵀ r_g``, U_g the basis' rows in cluster g.

    CR2 (Bell and McCaffrey, Survey Methodology 28, 2002; Imbens and Kolesár, Rev. Econ. Stat. 98, 2016): a plain
    sandwich is too small where few clusters hold a parameter, as the fit then leaves little in them. Of a direction of
    which less than a hundredth shows outside a cluster, nothing is left there that would tell.
    """
    order = np.argsort(label, kind="stable")
    ends = np.flatnonzero(np.diff(label[order])) + 1
    moved = []
    for own, left in zip(np.split(basis[order], ends), np.split(residual[order], ends)):
        known, turned = np.linalg.eigh(own.T @ own)
        moved.append(
            turned[:width] @ ((turned.T @ (own.T @ left)) / np.sqrt(np.maximum(1.0 - known, 0.01)))
        )
    return np.asarray(len(moved) / max(len(moved) - 1, 1) * np.transpose(moved) @ moved)


def keep_excess(other: Array, first: Array) -> Array:
    """Positive part of ``other - first``, in units of the deviations of `first`."""
    unit = np.sqrt(np.maximum(np.diag(first), 1e-300))
    values, vectors = np.linalg.eigh((other - first) / np.outer(unit, unit))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(unit, unit))


def estimate_figures(state: State, cause: Cause) -> tuple[Parameter, ...]:
    """The cause's parameters as a person reads them, with standard deviations.

    The covariance is `cluster_covariance`'s, with the columns of the cause's coefficients and the slopes of its shape
    parameters; the base columns are refitted with them. What the log does not hold, as of two shape parameters of which
    only the product matters, has none.
    """
    final, values = find_settled(state, cause)
    spread = compute_figures_covariance(state, cause)
    turned = [
        shape.name
        for shape in cause.shapes
        if isinstance(cause, RigEffect) and getattr(cause, shape.name)
    ]
    shapes = dict(
        zip(turned or shape_names(cause), np.sqrt(np.diag(spread)[len(values) :]).tolist())
    )
    shown = final.shown(values, spread[: len(values), : len(values)])
    return tuple(replace(p, std=shapes.get(p.name, p.std)) for p in shown)


def is_size_known(state: State, cause: Cause) -> bool:
    """Whether a cause's size differs from zero by two deviations: ``θᵀ P θ > z²``, P the precision at its shape.

    The size is what a torque effect's coefficients are, and how far a rig is turned; of a drive, which has no size
    beside its shape, that shape is. A drift that hardly bends trades its size for its time, and is there nevertheless.
    """
    spread = compute_figures_covariance(state, cause)
    held = ~np.isnan(np.diag(spread))
    unit = np.sqrt(np.diag(spread)[held])
    if isinstance(cause, Signal):
        values = np.array([getattr(cause, name) for name in shape_names(cause)])[held]
        return bool(np.any(np.abs(values) > CRITICAL_Z * unit))
    precision = np.linalg.pinv(spread[np.ix_(held, held)] / np.outer(unit, unit), hermitian=True)
    size = state.coefficients(cause)[held[: width(cause)]]
    scaled = size / unit[: len(size)]
    return bool(scaled @ precision[: len(size), : len(size)] @ scaled > CRITICAL_Z**2)


def compute_figures_covariance(state: State, cause: Cause) -> Array:
    """Covariance of a cause's coefficients, then of its shape parameters; nan for what the log does not hold.

    It holds a direction of the projected slopes of 1e-5 of the largest, and a parameter that has less than a tenth of a
    direction which it does not.
    """
    base = refit_without(state, cause)
    if isinstance(
        cause, Signal
    ):  # what it changes is the torque before it, by as much as its shape says
        columns = compute_tangent(base, cause, np.ones(1))[..., 1:]
    else:
        columns = compute_tangent(state, cause, state.coefficients(cause))
    rest = project(base.fit, columns, None)
    size, whole = (np.linalg.norm(x, axis=0) for x in (rest, base.fit.stacked(columns)))
    shown = size > UNCHANGED_SHARE * whole  # the base columns leave more than rounding of it
    unit = np.where(shown, size, 1.0)
    own, sizes, turned = np.linalg.svd(np.where(shown, rest / unit, 0.0), full_matrices=False)
    held = sizes > 1e-5 * sizes[0]
    basis = np.hstack([own[:, held], base.fit.basis])
    spread = cluster_covariance(
        basis, state.fit.residual, label_clusters(state.problem.evidence), int(held.sum())
    )
    back = turned[held].T / sizes[held] / unit[:, None]
    free = np.any(np.abs(turned[~held]) > 0.1, axis=0)
    return np.where(free[:, None] | free, np.nan, back @ spread @ back.T)


def compute_tangent(state: State, cause: Cause, weights: Array) -> Array:
    """Whitened columns of a cause, then slopes of its torque by its shape parameters, (rows, n, c).

    Args:
        state: What the columns are built at.
        cause: The cause.
        weights: Its coefficients, with which its torque changes with its shape.
    """
    now = state.columns(cause).values
    upper = {shape.name: shape.upper for shape in cause.shapes}
    columns = [now]
    for name in shape_names(cause):
        value = getattr(cause, name)
        step = 0.02 * abs(value)
        other = cause.altered(
            **{name: value + step if value + step <= upper[name] else value - step}
        )
        slope = state.columns(other).values - now
        slope = np.where(np.abs(slope) > UNCHANGED_SHARE * np.max(np.abs(now)), slope, 0.0)
        columns.append((slope @ weights)[:, :, None] / (getattr(other, name) - value))
    return np.concatenate(columns, axis=2)
