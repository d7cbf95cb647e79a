"""Covariance of a fit's coefficients: noise of any colour, the prior, and what the model misses."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve

from gimbal_pin.diagnosis.score import BlockFit
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.log.log import Array
from gimbal_pin.regression import build_discrepancy_columns, fit_misfit, propagate_misfit


def compute_white_covariance(fit: BlockFit) -> Array:
    """Return ``H⁻¹``, (p, p): the covariance of a fit's coefficients if its whitened residual were white."""
    inverse = cho_solve(fit.whole, np.eye(len(fit.solution)), check_finite=False)
    return np.asarray(inverse / np.outer(fit.norms, fit.norms))


def compute_covariance(search: Search, solution: Solution) -> Array:
    """Return the covariance of a model's coefficients by noise, prior and misfit, (p, p).

    The misfit, ``Σ_j R_j R_j'``, is what the model misses at each joint as a function of its motion. It comes back
    whenever the motion does, so no number of folds averages it away: see `propagate_misfit`.
    """
    problem = search.problem
    rows = problem.rows
    fit = solution.fit
    inverse = cho_solve(fit.whole, np.eye(len(fit.solution)), check_finite=False)
    ends = np.cumsum([len(part.time) for part in rows.stretches])[:-1]
    q = rows.join("q")
    v = rows.join("v")
    used = rows.count_effective_rows().sum(axis=0)
    covariance = np.zeros_like(inverse)
    for j, A in enumerate(fit.columns):
        signals = np.split(build_discrepancy_columns(q[:, j], v[:, j]), ends)
        X = search.whitening.apply(rows, rows.project(signals, j), j)
        X /= max(float(np.sqrt(np.mean(X**2))), 1e-300)  # `fit_misfit` tries sizes of unit columns
        missed = fit_misfit(A[:, A.any(axis=0)], X, fit.target[:, j], float(used[j]))
        moved = propagate_misfit(inverse, fit.weight[j] * (A.T @ X), missed)
        covariance += moved @ moved.T
    return np.asarray(fit.covariance + covariance / np.outer(fit.norms, fit.norms))
