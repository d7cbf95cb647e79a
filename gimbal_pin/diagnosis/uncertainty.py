"""Covariance of a fit's coefficients: noise of any colour, the prior, and what the model misses."""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.score import BlockFit, split_folds
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.log.log import Array
from gimbal_pin.regression import build_discrepancy_columns, fit_misfit, propagate_misfit


def compute_white_covariance(fit: BlockFit) -> Array:
    """Return ``H⁻¹``, (p, p): the covariance of a fit's coefficients if its whitened residual were white."""
    return np.asarray(fit.inverse / np.outer(fit.norms, fit.norms))


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
