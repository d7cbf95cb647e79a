"""When each joint's measured torque acts: estimated with the model, since milliseconds look like much.

Channels of drives come some milliseconds apart. A shift a of the torque leaves ``(a* - a) dτ/dt``, which friction, lags
and springs take for theirs; it is the log's, and no finding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gimbal_pin.checks.torque_time import LARGEST_SHIFT
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log.log import Array
from gimbal_pin.regression import LAG_DEVIATION, LAG_ROUNDS, LAG_SPREAD, LAGS_WITHIN, LARGEST_LAG


def later_by(state: State) -> Array:
    """Return by how much later each joint's torque acts than the model takes it to, s, (n,).

    ``argmin_a Σ_j ‖r - D a‖²/φ_j + Σ (a_j + a⁰_j)²/σ²``, D_j what the rest of the model leaves of dτ_j/dt, a⁰ the
    shifts it was given.
    """
    D, P = project_slopes(state)
    return np.asarray(
        P @ (D.T @ state.fit.residual - shifts(state.problem.evidence) / LAG_DEVIATION**2)
    )


def project_slopes(state: State) -> tuple[Array, Array]:
    """Return what the model leaves of each joint's ``dτ/dt``, D, weighted, (rows n, n), and ``(DᵀD + 1/σ²)⁻¹``, s².

    The latter is the shifts' covariance where noise is all that is left, (n, n).
    """
    D = np.stack([project_slope(state, j) for j in range(state.problem.evidence.rig.n)], axis=1)
    return D, np.linalg.inv(D.T @ D + np.eye(D.shape[1]) / LAG_DEVIATION**2)


def project_slope(state: State, joint: int) -> Array:
    """Return what the model leaves of ``dτ/dt`` at a joint, weighted, (rows n,)."""
    return project(state.fit, whiten_slope(state, joint)[:, None], joint)[:, 0]


def whiten_slope(state: State, joint: int) -> Array:
    """Return ``dτ/dt`` at a joint, whitened, (rows,)."""
    evidence = state.problem.evidence
    slope = [np.gradient(x[:, joint], part.dt) for part, x in zip(evidence.parts, state.torque)]
    return evidence.whiten(slope, joint)


def shifts(evidence: Evidence) -> Array:
    """Return by how much later than their stamps the joints' torques are taken to act, s, (n,)."""
    return np.array(np.broadcast_to(evidence.parts[0].late, (evidence.rig.n,)))


def retimed(evidence: Evidence, late: Array) -> Evidence:
    """Return logs whose joints' torques act so much later than their stamps, s, (n,)."""
    return replace(evidence, parts=tuple(part.retimed(late) for part in evidence.parts))


def bound_shifts(late: Array) -> Array:
    """Return shifts, s, (n,), as far as they are the log's: within bounds, and three deviations beside each other.

    A rig's drives report alike; a joint whose torque acts later than the others' has a delay of its own. What all have
    is the median of theirs and of none, as the stamps say.
    """
    late = np.clip(late, -LARGEST_LAG, LARGEST_SHIFT)
    if len(late) == 1:
        return late
    common = np.median([*late, 0.0])
    return np.clip(late, common - 3 * LAG_SPREAD, common + 3 * LAG_SPREAD)


def align_torques(
    evidence: Evidence, causes: tuple[Cause, ...], modelled: Callable[[Evidence], State]
) -> State:
    """Return the model with the shifts, within their bounds, at which it leaves least.

    Where a cause is a filter of the torque, such as a delay, all of the time is its: there nothing is shifted.

    Args:
        evidence: The logs.
        causes: Causes of the model.
        modelled: Logs → the model, refitted.
    """
    timed = {cause.place for cause in causes if isinstance(cause, Signal) and cause.linear}
    free = np.array([joint not in timed for joint in evidence.rig.joints])
    late = shifts(evidence) * free
    state = modelled(retimed(evidence, late))
    for _ in range(LAG_ROUNDS):
        to = bound_shifts(late + later_by(state)) * free
        if np.max(np.abs(to - late)) < LAGS_WITHIN:
            break
        late = to
        state = modelled(retimed(evidence, to))
    return state
