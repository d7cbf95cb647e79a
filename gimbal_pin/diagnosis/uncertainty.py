"""How sure the figures of a finding are: sandwich covariance over blocks, shape parameters included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.extended import settled
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter

NUDGE = 0.02
"""Relative change of a shape parameter for its slope."""


def parameters(state: State, cause: Cause) -> tuple[Parameter, ...]:
    """The cause's parameters as a person reads them, with standard deviations.

    ``cov = H⁻¹ (Σ_blocks g gᵀ) H⁻¹``, with the columns of the cause's coefficients and the slopes of its shape
    parameters; whatever else the model holds is projected out.
    """
    final = next(c for c in settled(state) if c.name == cause.name and c.place == cause.place)
    spread = covariance(state, cause)
    names = shape_names(cause)
    if isinstance(cause, Effect):
        width = len(cause.coefficients)
        shown = cause.shown(tuple(state.coefficients(cause).tolist()), spread[:width, :width])
        shapes = dict(zip(names, np.sqrt(np.diag(spread)[width:]).tolist()))
    elif isinstance(cause, RigEffect):
        shown = final.shown()
        moved = {s.name for s in cause.shapes if getattr(cause, s.name)}
        shapes = {name: float(np.sqrt(spread[0, 0])) for name in moved}
    else:
        shown, shapes = cause.shown(), dict(zip(names, np.sqrt(np.diag(spread)).tolist()))
    return tuple(replace(p, std=shapes[p.name]) if p.name in shapes else p for p in shown)


def covariance(state: State, cause: Cause) -> Array:
    """Covariance of a cause's coefficients, then of its shape parameters."""
    base = without(state, cause)
    # What a signal changes is the torque before it.
    at = base if isinstance(cause, Signal) else state
    now = at.columns(cause).values
    columns = [] if isinstance(cause, Signal) else [now]
    weights = state.coefficients(cause) if isinstance(cause, Effect) else np.ones(now.shape[2])
    for name in shape_names(cause):
        value = getattr(cause, name)
        step = NUDGE * abs(value) if value else 1e-6
        shape = next(s for s in cause.shapes if s.name == name)
        other = replace(cause, **{name: value + step if value + step <= shape.upper else value - step})
        slope = at.columns(other).values - now
        columns.append((slope @ weights)[:, :, None] / (getattr(other, name) - value))
    stacked = base.fit.stacked(np.concatenate(columns, axis=2))
    rest = stacked - base.fit.basis @ (base.fit.basis.T @ stacked)
    unit = np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    rest = rest / unit
    bread = np.linalg.pinv(rest.T @ rest, rcond=1e-10)
    scores = state.fit.by_block(rest * state.fit.residual[:, None])
    blocks, width = scores.shape
    meat = scores.T @ scores * blocks / max(blocks - width, 1)
    return bread @ meat @ bread / np.outer(unit, unit)
