"""What a model predicts of blocks that it has not seen: its coefficients and its causes' shapes fitted to the others.

A cause that only one event of a log made fits that event as well as any; from the rest of the log nothing of it is
predicted. A shape is a column here: its tangent (Gauss and Newton).
"""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.engine.discrepancy import unseen
from gimbal_pin.diagnosis.engine.support import without
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, width
from gimbal_pin.diagnosis.uncertainty import tangent
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log.log import Array


def overfit(state: State) -> Array:
    """Return each joint's residual on blocks that were left out over that of the fit to all, power over power, (n,)."""
    fit = state.fit
    columns = [fit.stacked(tangents(state, cause)) for cause in state.causes if shape_names(cause)]
    error = unseen(np.concatenate([fit.stack, *columns], axis=1), fit.stack[:, :0], fit.target, fit.block, (1.0,))
    joints = [fit.rows(j) for j in range(len(fit.scale))]
    power = [(float(error[k] @ error[k]), float(fit.residual[k] @ fit.residual[k])) for k in joints]
    return np.array([after / max(before, 1e-300) for after, before in power])


def tangents(state: State, cause: Cause) -> Array:
    """Return how the torque changes with each of a chosen cause's shapes, whitened, (rows, n, shapes)."""
    if isinstance(cause, Signal):  # what it changes is the torque before it
        return tangent(without(state, cause), cause, np.ones(1))[..., 1:]
    return tangent(state, cause, state.coefficients(cause))[..., width(cause) :]
