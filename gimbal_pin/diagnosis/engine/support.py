"""What a model must be beside likely: possible, and more than another's error of form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft
from scipy.ndimage import uniform_filter1d

from gimbal_pin.diagnosis.engine.criterion import WIDTH
from gimbal_pin.diagnosis.shapes import same
from gimbal_pin.diagnosis.state import Problem, State, acted, consistent, solved
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.estimation.identification import given_beta
from gimbal_pin.log.log import Array

FORM, OF_CAUSE = 0.005, 0.17
"""Plausible error of a form, as a share of its torque: of the rigid model, and of what only a cause explains."""
LIGHTEST = 1 / 3
"""Share of the given inertia about a joint's axis that what its drive passes on must move at least: no URDF is further
off than that."""


def fitted(problem: Problem, causes: Sequence[Cause], before: State) -> State:
    """Refit everything with these causes until what reads the model's torque agrees with it."""
    return consistent(solved(problem, causes, before))


def without(state: State, cause: Cause) -> State:
    """Refit without a cause: once, as what a cause adds is asked for whenever another is weighed."""
    if cause not in state.lacking:
        state.lacking[cause] = fitted(state.problem, [one for one in state.causes if one is not cause], state)
    return state.lacking[cause]


def matters(state: State, other: State) -> bool:
    """Whether a model explains more of any joint's torque than an error of the other's form could.

    ``Σ (|R'|² - |R|²)/(1 + s) > Σ s/(1 + s)`` over frequencies, R' and R the two residuals in units of the noise and
    ``s = FORM² |T|² + OF_CAUSE² Σ_k |T_k|²`` the power of such an error: T is the torque that the other model predicts,
    T_k what only its cause k explains, unless the model has but other pieces of it. Nature has more forms than a
    library, of the rigid model and of every cause.
    """
    evidence, n = other.problem.evidence, len(other.fit.scale)
    total = evidence.whiten_all(other.torque)
    residuals = [one.fit.residual.reshape(-1, n) / one.fit.scale for one in (other, state)]
    pieced = [one for one in state.causes if one.pieces]
    whole = [one for one in other.causes if not any(same(one, x) and one.pieces != x.pieces for x in pieced)]
    lacking = (without(other, cause).fit for cause in whole)
    missed = (fit.residual.reshape(-1, n) / fit.scale - residuals[0] for fit in lacking)
    signals = [(FORM, total), *((OF_CAUSE, one) for one in missed)]
    gained, allowed, first = np.zeros(n), np.zeros(n), 0
    for part in evidence.parts:
        rows = slice(first, first + part.rows)
        first += part.rows
        error = sum(share**2 * power_of(signal[rows], WIDTH) for share, signal in signals)
        before, after = (power_of(one[rows]) for one in residuals)
        gained += np.sum((before - after) / (1 + error), axis=0)
        allowed += np.sum(error / (1 + error), axis=0)
    return bool(np.any(gained > allowed))


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
        problem, j = state.problem, state.problem.evidence.rig.joint_index(cause.joint)
        row, b = problem.inertia[j], len(problem.reduction.independent)
        std = float(np.sqrt(row @ state.fit.information[:b, :b] @ row))
        given = float(row @ given_beta(problem.evidence.rig, problem.reduction))
        return float(row @ state.fit.theta[:b]) + 2 * std > LIGHTEST * given
    return True


def added(state: State, cause: Cause) -> Array:
    """Return the torque that a chosen cause adds to a model, or takes off the measured one, whitened, (rows, n)."""
    if not isinstance(cause, Signal):
        return np.asarray(state.columns(cause).values @ state.coefficients(cause))
    others = [one for one in state.causes if one is not cause]
    with_, without_ = (passed(state, causes) for causes in (state.causes, others))
    return state.problem.evidence.whiten_all([x - y for x, y in zip(without_, with_)])


def passed(state: State, causes: Sequence[Cause]) -> list[Array]:
    """Return what the drives' signals among some causes make of the measured torques, N m, (m, n) per part."""
    torque = state.problem.evidence.torque
    for cause in causes:
        if isinstance(cause, Signal):
            torque = acted(state.problem.evidence, cause, torque, state.bearing_for(cause, torque))
    return torque
