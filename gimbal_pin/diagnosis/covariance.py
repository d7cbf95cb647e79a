"""By how much a fit's coefficients may be off: noise, what the model misses, and when the torques act."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.engine.alignment import project_slopes, whiten_slope
from gimbal_pin.diagnosis.extended import find_estimated
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.state import State
from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Misfit, build_discrepancy_columns, fit_misfit, propagate_misfit


def compute_misfit(state: State, joint: int) -> Array:
    """By how much what a fit misses at a joint may move its coefficients, (k, f): see `propagate_misfit`."""
    A, X, one = _fit_joint_misfit(state, joint)
    return propagate_misfit(state.fit.information, A.T @ X, one)


def _fit_joint_misfit(state: State, joint: int) -> tuple[Array, Array, Misfit]:
    """A joint's weighted columns, (m, k), δ's, (m, f), and what the fit misses there."""
    evidence = state.problem.evidence
    fit = state.fit
    rows = state.fit.rows(joint)
    parts = [part.channels for part in evidence.parts]
    q, v = (np.concatenate([getattr(part, name)[:, joint] for part in parts]) for name in "qv")
    ends = np.cumsum([len(part.q) for part in parts])[:-1]
    X = evidence.whiten(np.split(build_discrepancy_columns(q, v), ends), joint)
    A = fit.stack[rows]
    X /= max(
        float(np.sqrt(np.mean(X**2))), 1e-300
    )  # `fit_misfit` knows columns of about unit size, as cosines are
    return (
        A,
        X,
        fit_misfit(A[:, A.any(axis=0)], X, fit.target[rows], float(evidence.used[joint]) * len(X)),
    )


def compute_fit_covariance(state: State) -> tuple[Array, Array]:
    """Covariance of a fit's coefficients, (k, k), and of the shifts of the joints' torques, s², (n, n).

    ``H⁻¹ (Σ_blocks g gᵀ) H⁻¹ + Σ_joints R Rᵀ + T C Tᵀ``: what is left as it is, what the fit misses at a joint, see
    `propagate_misfit`, and what the shifts leave open, ``T = H⁻¹ AᵀW db/dt``. Their own, ``C = P + Σ_joints L Lᵀ`` with
    ``L = P Dᵀ(1 - Π) Φ√S``, see `later_by`, holds what is missed, too.
    """
    fit = state.fit
    joints = range(state.problem.evidence.rig.n)
    count = len(state.fit.starts)
    (D, late) = project_slopes(state)
    misfit = list[Array]()
    P = late
    for j in joints:
        A, X, one = _fit_joint_misfit(state, j)
        misfit.append(propagate_misfit(fit.information, A.T @ X, one))
        slid = P @ D.T @ project(fit, X * np.sqrt(one.variance) / fit.scale[j], j)
        late = late + slid @ slid.T
    slopes = [fit.stack[fit.rows(j)].T @ fit.weighted(whiten_slope(state, j), j) for j in joints]
    root = np.hstack(
        [*misfit, fit.information @ np.stack(slopes, axis=1) @ np.linalg.cholesky(late)]
    )
    return fit.covariance * count / max(count - 1, 1) + root @ root.T, late


def widen_estimates(model: Model, state: State) -> Model:
    """Return the model that a state has fitted, its estimates' deviations those of `compute_fit_covariance`."""
    assert model.estimated is not None
    (covariance, late) = compute_fit_covariance(state)
    kept = find_estimated(state)
    std = tuple(np.sqrt(np.diag(late)).tolist())
    return replace(
        model,
        estimated=replace(model.estimated, covariance=covariance[np.ix_(kept, kept)], lag_std=std),
    )
