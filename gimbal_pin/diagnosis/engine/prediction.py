"""What a model predicts of blocks that it has not seen: its coefficients and its causes' shapes fitted to the others.

A cause that only one event of a log made fits that event as well as any; from the rest of the log nothing of it is
predicted. A shape is a column here: its tangent (Gauss and Newton).
"""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.columns import build
from gimbal_pin.diagnosis.engine.discrepancy import unseen
from gimbal_pin.diagnosis.shapes import FINE, moved, shape_names
from gimbal_pin.diagnosis.state import State, acted
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log import Array


def overfit(state: State) -> Array:
    """Return each joint's residual on blocks that were left out over that of the fit to all, power over power, (n,)."""
    fit = state.fit
    columns = [fit.stacked(tangent[:, :, None]) for cause in state.causes for tangent in tangents(state, cause)]
    error = unseen(np.concatenate([fit.stack, *columns], axis=1), fit.stack[:, :0], fit.target, fit.block, (1.0,))
    joints = [fit.rows(j) for j in range(len(fit.scale))]
    power = [(float(error[k] @ error[k]), float(fit.residual[k] @ fit.residual[k])) for k in joints]
    return np.array([after / max(before, 1e-300) for after, before in power])


def tangents(state: State, cause: Cause) -> list[Array]:
    """Return how the balance of a model changes with each of a chosen cause's shapes, whitened, (rows, n) each."""
    found: list[Array] = []
    for name in shape_names(cause):
        other = moved(cause, name, FINE) or moved(cause, name, 1.0 / FINE)
        if other is not None:
            found.append(balance(state, cause, other) - balance(state, cause, cause))
    return found


def balance(state: State, cause: Cause, other: Cause) -> Array:
    """Return what a chosen cause puts into the balance with another shape, up to a constant, whitened, (rows, n)."""
    evidence = state.problem.evidence
    if not isinstance(cause, Signal):
        columns = build(evidence, other, state.stand, state.load, state.acting).values
        return np.asarray(columns @ state.coefficients(cause))
    acting = evidence.torque
    for one in state.causes:
        if isinstance(one, Signal):
            signal = other if one is cause else one
            assert isinstance(signal, Signal)
            acting = acted(evidence, signal, acting, state.bearing_for(signal, acting))
    return evidence.whiten_all(acting)
