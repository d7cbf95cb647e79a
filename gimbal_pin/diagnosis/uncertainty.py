"""How sure the figures of a finding are: over blocks of time and bins of the state, shape parameters included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis import clusters
from gimbal_pin.diagnosis.extended import settled
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array

NUDGE = 0.02
"""Relative change of a shape parameter for its slope."""
ROUNDING = 1e-9
"""Change of a column, as a share of it, up to which that shape parameter changes nothing."""
HELD = 1e-5
"""Size of a direction of the projected slopes, over the largest, from which the log holds it."""
FREE = 0.1
"""Share of a direction that is not held from which a parameter is not either."""


def parameters(state: State, cause: Cause) -> tuple[Parameter, ...]:
    """The cause's parameters as a person reads them, with standard deviations.

    The covariance is `clusters.covariance`'s, with the columns of the cause's coefficients and the slopes of its shape
    parameters; the base columns are refitted with them. What the log does not hold, as of two shape parameters of which
    only the product matters, has none.
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
    """Covariance of a cause's coefficients, then of its shape parameters; nan for what the log does not hold."""
    base = without(state, cause)
    if isinstance(cause, Signal):  # what it changes is the torque before it, by as much as its shape says
        columns = tangent(base, cause, np.ones(1))[..., 1:]
    else:
        columns = tangent(state, cause, state.coefficients(cause))
    stacked = base.fit.stacked(columns)
    rest = stacked - base.fit.basis @ (base.fit.basis.T @ stacked)
    unit = np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    own, sizes, turned = np.linalg.svd(rest / unit, full_matrices=False)
    held = sizes > HELD * sizes[0]
    basis = np.hstack([own[:, held], base.fit.basis])
    spread = clusters.covariance(basis, state.fit.residual, clusters.clusters(state.problem.evidence), int(held.sum()))
    back = turned[held].T / sizes[held] / unit[:, None]
    free = np.any(np.abs(turned[~held]) > FREE, axis=0)
    return np.where(free[:, None] | free, np.nan, back @ spread @ back.T)


def tangent(state: State, cause: Cause, weights: Array) -> Array:
    """Whitened columns of a cause, then slopes of its torque by its shape parameters, (rows, n, c).

    Args:
        state: What the columns are built at.
        cause: The cause.
        weights: Its coefficients, with which its torque changes with its shape.
    """
    now = state.columns(cause).values
    columns = [now]
    for name in shape_names(cause):
        value = getattr(cause, name)
        step = NUDGE * abs(value) if value else 1e-6
        shape = next(s for s in cause.shapes if s.name == name)
        other = cause.altered(**{name: value + step if value + step <= shape.upper else value - step})
        slope = state.columns(other).values - now
        slope = np.where(np.abs(slope) > ROUNDING * np.max(np.abs(now)), slope, 0.0)
        columns.append((slope @ weights)[:, :, None] / (getattr(other, name) - value))
    return np.concatenate(columns, axis=2)
