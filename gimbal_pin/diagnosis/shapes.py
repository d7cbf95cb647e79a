"""What of a cause is measured beside its coefficients: shape parameters, scored, moved and refined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache, partial
from math import log

from gimbal_pin.diagnosis.state import State, width
from gimbal_pin.effects import Cause, RigEffect, Signal

REFINING_ROUNDS = 8
"""Rounds of refinement of the shape parameters, each with half the step."""
COARSE_FACTOR = 2.0
"""Factor by which a shape parameter is moved first."""
NEAR_FACTOR = 2.0 ** (1 / 32)
"""The same where the best of many that stand close is moved on."""


def refine_shapes(
    state: State, cause: Cause, value: Callable[[State, Cause], float], step: float = COARSE_FACTOR
) -> Cause:
    """Return the cause with its shape parameters moved to where it is worth most: a pattern search in their logarithms.

    Args:
        state: The state without the cause.
        cause: The cause.
        value: What a cause is worth in a state.
        step: The first step, a factor; every round takes its square root.
    """
    best = value(state, cause)
    at = cause
    for _ in range(REFINING_ROUNDS):
        before = at
        for name in shape_names(cause):
            for factor in (step, 1 / step):
                other = move_shape(at, name, factor)
                if other is not None and (found := value(state, other)) > best:
                    best, at = found, other
        while (other := onward(before, at)) is not None and (found := value(state, other)) > best:
            best, at = found, other
        step **= 0.5
    return at


def other_forms(
    state: State, cause: Cause, value: Callable[[State, Cause], float]
) -> tuple[Cause, ...]:
    """Other forms of a cause, each where it is worth most from where the search has found it, refined."""
    evidence = state.problem.evidence
    seen = evidence.seen[evidence.rig.joint_index(cause.place) if cause.of_joint else 0]
    forms: dict[tuple[object, ...], list[Cause]] = {}
    for other in cause.akin(seen):
        forms.setdefault(form(other), []).append(other)
    return tuple(
        refine_shapes(state, max(alike, key=partial(value, state)), value, NEAR_FACTOR)
        for alike in forms.values()
    )


def onward(before: Cause, at: Cause) -> Cause | None:
    """Twice as far the way that a round went, where shapes trade places along a ridge; None elsewhere, or at a bound.

    Hooke and Jeeves, J. ACM 8, 1961: steps along one shape at a time creep up a ridge that is aslant.
    """
    if not isinstance(at, Signal) or not at.springy or at is before:
        return None
    shapes = [shape for shape in at.shapes if shape.name in shape_names(at)]
    new = {
        shape.name: getattr(at, shape.name) ** 2 / getattr(before, shape.name) for shape in shapes
    }
    return at.altered(**new) if all(s.lower <= new[s.name] <= s.upper for s in shapes) else None


def shape_names(cause: Cause) -> list[str]:
    """Shape parameters that are continuous and stand as fields; one at zero is a form of its own, and stays there."""
    if isinstance(cause, RigEffect):
        return []
    held = {field.name for field in fields(cause)} - {*cause.chosen}
    return [
        s.name
        for s in cause.shapes
        if s.name in held and isinstance(x := getattr(cause, s.name), float) and x
    ]


def move_shape(cause: Cause, name: str, factor: float) -> Cause | None:
    """Return the cause with one shape parameter multiplied, or None outside its bounds.

    An angle of either sign has no size to be multiplied: it is moved by the factor's logarithm, in rad.
    """
    shape = next(s for s in cause.shapes if s.name == name)
    value = (
        getattr(cause, name) * factor if shape.lower >= 0 else getattr(cause, name) + log(factor)
    )
    return cause.moved(name, value) if shape.lower <= value <= shape.upper else None


@lru_cache(1 << 14)
def free(cause: Cause) -> int:
    """Coefficients and continuous shape parameters of a cause."""
    return width(cause) + len(shape_names(cause))


def same(a: Cause, b: Cause) -> bool:
    """Whether two are the same cause at the same place."""
    return a.name == b.name and a.place == b.place


def form(cause: Cause) -> tuple[object, ...]:
    """What of a cause is chosen rather than measured: a stiffening spring, an exponent, a shape left at zero."""
    held = [(f.name, getattr(cause, f.name)) for f in fields(cause) if not cause.pieces]
    return tuple(
        x == 0.0 if isinstance(x, float) and name not in cause.chosen else x for name, x in held
    )
