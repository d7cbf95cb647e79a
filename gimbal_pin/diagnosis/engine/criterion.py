"""By how much one model is better than another: a criterion, what supports it, and what it predicts of unseen blocks.

``C = Σ_j N_j log φ_j + k log N``: twice the negative log likelihood of rows of unit noise, up to a constant, with the
penalty of Schwarz (Ann. Statist. 6, 1978); N_j are joint j's rows, k what the causes have free, φ_j is the dispersion
``⟨|R(f)|²/ρ(f)⟩`` of its residual. A drive's signal changes the measured torque, or what the model makes of the
measured motion, and the noise in it: ρ is the share of a noise's power that it passes on at each frequency. Without
that any low-pass would explain half of any noise, and any spring the noise of an acceleration.

Beside likely, a model must be possible, explain more than another's error of form, and predict blocks that its fit has
not seen: a cause that one event made fits that event as well as any, and predicts nothing of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft
from scipy.ndimage import uniform_filter1d

from gimbal_pin.diagnosis.engine.discrepancy import unseen
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.shapes import free, same, shape_names
from gimbal_pin.diagnosis.state import (
    AVERAGED_FREQUENCIES,
    Problem,
    State,
    apply_signal,
    solve_causes,
    solve_consistently,
    width,
)
from gimbal_pin.diagnosis.uncertainty import compute_tangent
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.identification import given_beta
from gimbal_pin.log.log import Array
from gimbal_pin.regression import FORM_ERROR

OF_CAUSE = 0.17
"""Plausible error of a cause's form, as a share of what only it explains; of the rigid model's, `FORM_ERROR`."""
LIGHTEST = 1 / 3
"""Share of the given inertia about a joint's axis that what its drive passes on must move at least: no URDF is further
off than that."""


def rows(state: State) -> Array:
    """Return how many rows of each joint tell, (n,)."""
    evidence = state.problem.evidence
    return np.asarray(evidence.rows * np.maximum(evidence.used, 1e-3))


def criterion(state: State) -> float:
    """Return ``Σ_j N_j log φ_j + k log N``."""
    return float(rows(state) @ np.log(state.dispersion) + penalty(state))


def penalty(state: State) -> float:
    """Return ``k log N``."""
    return float(np.log(rows(state).max())) * sum(free(cause) for cause in state.causes)


def by_block(state: State, other: State) -> Array:
    """Return by how much a model's log likelihood is above another's in each block, (blocks,).

    ``Σ_j (r'_j² - r_j²)/2 φ_j``, both residuals over the noise as their drives pass it on.
    """
    known = state.dispersion
    size, than = (np.sqrt(one.dispersion / known) for one in (state, other))
    count = len(state.fit.residual) // len(known)
    difference = (np.tile(than, count) * other.fit.residual) ** 2 - (
        np.tile(size, count) * state.fit.residual
    ) ** 2
    return state.fit.by_block(difference[:, None])[:, 0] / 2


def compare_models(state: State, other: State) -> tuple[float, float]:
    """Return ``log p(y|M)/p(y|M')`` of two models under the noise that the first leaves, and its deviation by blocks.

    ``δ = Σ_b d_b + (k' - k) log(N)/2``, ``s² = B var d``. A few blocks may tell most, and then s is large.
    """
    told = by_block(state, other)
    return float(told.sum()) + (penalty(other) - penalty(state)) / 2, float(
        np.sqrt(len(told)) * told.std(ddof=1)
    )


def fitted(problem: Problem, causes: Sequence[Cause], before: State) -> State:
    """Refit everything with these causes until what reads the model's torque agrees with it."""
    return solve_consistently(solve_causes(problem, causes, before))


def leave_cause_out(state: State, cause: Cause) -> State:
    """Refit without a cause: once, as what a cause adds is asked for whenever another is weighed."""
    if cause not in state.lacking:
        state.lacking[cause] = fitted(
            state.problem, [one for one in state.causes if one is not cause], state
        )
    return state.lacking[cause]


def exceeds_form_error(state: State, other: State) -> bool:
    """Whether a model explains more of any joint's torque than an error of the other's form could.

    ``Σ (|R'|² - |R|²)/(1 + s) > Σ s/(1 + s)`` over frequencies, R' and R the two residuals in units of the noise and
    ``s = FORM_ERROR² |T|² + OF_CAUSE² Σ_k |T_k|²`` the power of such an error: T is the torque that the other model
    predicts, T_k what only its cause k explains, unless the model has but other pieces of it. Nature has more forms
    than a library, of the rigid model and of every cause.
    """
    n = len(other.fit.scale)
    total = other.problem.evidence.whiten_all(other.torque)
    before, after = (one.fit.residual.reshape(-1, n) / one.fit.scale for one in (other, state))
    pieced = [one for one in state.causes if one.pieces]
    whole = [
        one
        for one in other.causes
        if not any(same(one, x) and one.pieces != x.pieces for x in pieced)
    ]
    lacking = (leave_cause_out(other, cause).fit for cause in whole)
    missed = (fit.residual.reshape(-1, n) / fit.scale - before for fit in lacking)
    signals = [(FORM_ERROR, total), *((OF_CAUSE, one) for one in missed)]
    return bool(np.any(compare_with_form_error(other.problem.evidence, before, after, signals) > 1))


def compare_with_form_error(
    evidence: Evidence, before: Array, after: Array, signals: Sequence[tuple[float, Array]]
) -> Array:
    """``Σ (|R'|² - |R|²)/(1 + s) / Σ s/(1 + s)``, (n,): what two residuals differ by over an error of form.

    Args:
        evidence: The logs.
        before: R', in units of the noise, (rows, n).
        after: R.
        signals: A share each and the torque, (rows, n), of which an error is that share: s is the sum of their powers.
    """
    gained = np.zeros(before.shape[1])
    allowed = np.zeros(before.shape[1])
    first = 0
    for part in evidence.parts:
        rows = slice(first, first + part.rows)
        first += part.rows
        error = sum(
            share**2 * power_of(signal[rows], AVERAGED_FREQUENCIES) for share, signal in signals
        )
        gained += np.sum((power_of(before[rows]) - power_of(after[rows])) / (1 + error), axis=0)
        allowed += np.sum(error / (1 + error), axis=0)
    return np.asarray(gained / np.maximum(allowed, 1e-300))


def power_of(rows: Array, width: int = 1) -> Array:
    """Return the power of some rows, (rows, n), at each frequency, (f, n), averaged over so many to either side."""
    power = np.abs(fft.rfft(rows, axis=0)) ** 2 / len(rows)
    return np.asarray(uniform_filter1d(power, 2 * width - 1, axis=0))


def unsupported(state: State) -> list[Cause]:
    """Return causes that ask for what no rig has: a size beyond its bounds, or a drive that moves next to nothing."""
    return [cause for cause in state.causes if not supported(state, cause)]


def supported(state: State, cause: Cause) -> bool:
    """Whether a chosen cause's coefficients, and what a person reads of them, lie within their bounds.

    A drive that passes on next to nothing of the torque explains all of it, with a link of next to no inertia.
    """
    if isinstance(cause, Effect):
        values = tuple(state.coefficients(cause).tolist())
        bounded = [*zip(cause.coefficients, values), *((p, p.value) for p in cause.shown(values))]
        return all(p.lower <= x <= p.upper for p, x in bounded)
    if isinstance(cause, Signal):
        problem = state.problem
        j = state.problem.evidence.rig.joint_index(cause.joint)
        row = problem.motion.inertia[j]
        b = len(problem.reduction.independent)
        std = float(np.sqrt(row @ state.fit.information[:b, :b] @ row))
        given = float(row @ given_beta(problem.evidence.rig, problem.reduction))
        return float(row @ state.fit.theta[:b]) + 2 * std > LIGHTEST * given
    return True


def compute_cause_torque(state: State, cause: Cause) -> Array:
    """Return the torque that a chosen cause adds to a model, or takes off the measured one, whitened, (rows, n)."""
    if not isinstance(cause, Signal):
        return np.asarray(state.columns(cause).values @ state.coefficients(cause))
    others = [one for one in state.causes if one is not cause]
    with_, without_ = (pass_through_drives(state, causes) for causes in (state.causes, others))
    return state.problem.evidence.whiten_all([x - y for x, y in zip(without_, with_)])


def pass_through_drives(state: State, causes: Sequence[Cause]) -> list[Array]:
    """Return what the drives' signals among some causes make of the measured torques, N m, (m, n) per part."""
    torque = state.problem.evidence.torque
    for cause in causes:
        if isinstance(cause, Signal):
            torque = apply_signal(
                state.problem.evidence, cause, torque, state.bearing_for(cause, torque)
            )
    return torque


def overfit(state: State) -> Array:
    """Return each joint's residual on blocks that were left out over that of the fit to all, power over power, (n,)."""
    fit = state.fit
    columns = [fit.stacked(tangents(state, cause)) for cause in state.causes if shape_names(cause)]
    error = unseen(
        np.concatenate([fit.stack, *columns], axis=1),
        fit.stack[:, :0],
        fit.target,
        fit.block,
        (1.0,),
    )
    joints = [fit.rows(j) for j in range(len(fit.scale))]
    power = [(float(error[k] @ error[k]), float(fit.residual[k] @ fit.residual[k])) for k in joints]
    return np.array([after / max(before, 1e-300) for after, before in power])


def tangents(state: State, cause: Cause) -> Array:
    """Return how the torque changes with each of a chosen cause's shapes, whitened, (rows, n, shapes)."""
    if isinstance(cause, Signal):  # what it changes is the torque before it
        return compute_tangent(leave_cause_out(state, cause), cause, np.ones(1))[..., 1:]
    return compute_tangent(state, cause, state.coefficients(cause))[..., width(cause) :]
