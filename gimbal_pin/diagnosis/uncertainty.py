"""Covariance of a fit's coefficients: noise of any colour, the prior, and what the model misses."""

from __future__ import annotations

from dataclasses import replace
from math import log, sqrt

import numpy as np

from gimbal_pin.diagnosis.candidates import REFINEMENTS, Candidate, vary_shape
from gimbal_pin.diagnosis.commands import Drive, compute_slopes
from gimbal_pin.diagnosis.problem import build_precision
from gimbal_pin.diagnosis.score import BlockFit, fit_blocks, split_folds
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array
from gimbal_pin.regression import build_discrepancy_columns, fit_misfit, propagate_misfit

SHAPE_STEP = 1.01
"""Factor of the shape parameter by which its derivative is computed: a central difference errs by 1e-4 of it."""
LARGEST_VARIANCE = 100.0
"""Largest variance of a shape's logarithm: beyond it its exponential may overflow, and the bounds count anyway."""


def compute_covariance(search: Search, solution: Solution) -> Array:
    """Return the covariance of a model's coefficients by noise, prior and misfit, (p, p).

    The misfit, ``Σ_j R_j R_j'``, is what the model misses at each joint as a function of its motion. It comes back
    whenever the motion does, so no number of folds averages it away: see `propagate_misfit`.
    """
    problem = search.problem
    rows = problem.rows
    fit = solution.fit
    ends = np.cumsum([len(part.time) for part in rows.stretches])[:-1]
    q = rows.join("q")
    v = rows.join("v")
    used = rows.count_effective_rows().sum(axis=0)
    covariance = np.zeros_like(fit.inverse)
    for j, (columns, places) in enumerate(zip(fit.columns, fit.places)):
        A = columns.reshape(-1, len(places))
        signals = np.split(build_discrepancy_columns(q[:, j], v[:, j]), ends)
        white = search.whitening.apply(rows, rows.project(signals, j), j)
        X = split_folds(white, fit.folds).reshape(len(A), -1)
        y = split_folds(fit.target[:, j], fit.folds).ravel()
        X /= max(float(np.sqrt(np.mean(X**2))), 1e-300)  # `fit_misfit` tries sizes of unit columns
        missed = fit_misfit(A, X, y, float(used[j]))
        moved = propagate_misfit(fit.inverse[:, places], fit.weight[j] * (A.T @ X), missed)
        covariance += moved @ moved.T
    return np.asarray(fit.covariance + covariance / np.outer(fit.norms, fit.norms))


def compute_shape_covariance(
    search: Search, solution: Solution, cause: Candidate, covariance: Array
) -> Array | None:
    """Return the covariance of a cause's coefficients b and of its shape parameter s, (k + 1, k + 1).

    To first order another shape adds the column ``∂(X(s) b)/∂s``, whose coefficient is the change of s. With its
    variance v and the slope ``g = ∂b/∂s`` of a fit that has this column, that of b is ``P + v g g'``.

    Args:
        search: The search.
        solution: The model.
        cause: One of its causes.
        covariance: Covariance P of b where the shape is known, (k, k).

    Returns:
        None for a cause whose shape is not refined by one number.
    """
    name = REFINEMENTS.get(cause.name, ("", 0.0))[0]
    problem = search.problem
    joint = cause.joint
    if not name or joint is None:
        return None
    varied = vary_shape(cause, SHAPE_STEP, problem.ranges[joint])
    if len(varied) < 2:
        return None
    theta = solution.fit.theta
    places = solution.find_places([cause], problem)
    low, high = (
        search.build_columns(x, solution.torque, theta).rows[joint] @ theta[places] for x in varied
    )
    span = getattr(varied[1].cause, name) - getattr(varied[0].cause, name)
    column = (high - low)[:, None] / span
    fit = _fit_with_slopes(search, solution, joint, column, np.zeros(1))
    white = fit.white_covariance[:, -1]
    slope = white[np.append(places, True)] / white[-1]
    shaped = fit.covariance[-1, -1] * np.outer(slope, slope)
    shaped[:-1, :-1] += covariance
    return np.asarray(shaped)


def size_drive(search: Search, solution: Solution, drive: Drive) -> tuple[Parameter, ...]:
    """Return a drive's shape parameters with their deviations.

    To first order another shape adds the columns ``∂g/∂log s``, g the torque that acts. Before the log is seen, log s
    is as uncertain as its bounds; s itself, log-normal, is no more so after it. So two shapes of which the log shows
    nothing but the product are both unknown.
    """
    slopes = compute_slopes(search, solution, drive)
    shown = drive.signal.shown()
    shapes = [p for p in shown if p.name in slopes]
    precision = [12.0 / log(p.upper / p.lower) ** 2 if p.lower > 0 else 0.0 for p in shapes]
    columns = np.column_stack([slopes[p.name] for p in shapes])
    joint = drive.hit.candidate.joint or 0
    fit = _fit_with_slopes(search, solution, joint, columns, np.array(precision))
    variances = np.minimum(np.diag(fit.covariance)[-len(shapes) :], LARGEST_VARIANCE)
    relative = np.sqrt(np.expm1(variances) * np.exp(variances)).tolist()
    sized = {
        p.name: replace(p, std=min(x * p.value, (p.upper - p.lower) / sqrt(12.0)))
        for p, x in zip(shapes, relative)
    }
    return tuple(sized.get(p.name, p) for p in shown)


def _fit_with_slopes(
    search: Search, solution: Solution, joint: int, slopes: Array, precision: Array
) -> BlockFit:
    """Return the fit of a model with more columns at a joint, (N, k), the last of its own."""
    rows = search.problem.rows
    base = [np.column_stack([B, np.zeros((len(B), len(precision)))]) for B in solution.base]
    base[joint][:, -len(precision) :] = slopes
    return fit_blocks(
        [search.whitening.apply(rows, B, j) for j, B in enumerate(base)],
        solution.fit.target,
        rows.folds,
        rows.count_effective_rows(),
        np.append(build_precision(search.problem, solution.columns), precision),
        solution.fit.weight,
    )
