"""What a cause gains beside a fitted model, as a number, and refined by it."""

from __future__ import annotations

from gimbal_pin.diagnosis import State, gained, shapes
from gimbal_pin.diagnosis.engine.selection import value
from gimbal_pin.diagnosis.score import Gained
from gimbal_pin.effects import Cause, Signal


def measure(state: State, cause: Cause) -> Gained:
    """Fit a cause as it stands to what a state leaves."""
    return gained(state.fit, state.columns(cause), isinstance(cause, Signal))


def worth(state: State, cause: Cause) -> float:
    """Return its gain alone."""
    return measure(state, cause).gain


def refined(state: State, cause: Cause, step: float = shapes.COARSE_FACTOR) -> Cause:
    """Return the cause with its shape parameters where it gains most."""
    return shapes.refine_shapes(state, cause, value, step)
