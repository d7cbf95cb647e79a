"""Forms of a cause that the log cannot tell from the one named: what they would say differs, and so is unsure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import hypot, pi

from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.search import variants
from gimbal_pin.diagnosis.state import State, solved, without
from gimbal_pin.diagnosis.verdict import APART, versus
from gimbal_pin.effects import Cause, Effect, RigEffect
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.parameter import Parameter

STRONGEST = 3
"""Harmonics whose neighbours are tried."""
SYSTEMATIC = 0.0025
"""Share of a figure that clocks, filters and the grid of samples may shift it by, whatever the noise."""


def widened(state: State, cause: Cause, shown: Sequence[Parameter], shelf: Library) -> tuple[Parameter, ...]:
    """``std² + (largest difference to what another form says)² + (SYSTEMATIC value)²``, wherever there is a std."""
    others = [told(state, cause, other) for other in alternatives(state, cause, shelf)]
    return tuple(replace(p, std=hypot(p.std, apart(p, others), SYSTEMATIC * p.value)) for p in shown)


def apart(figure: Parameter, others: Sequence[Sequence[Parameter]]) -> float:
    """Largest difference of a figure to that of the same name among others; phases round the circle."""
    gaps = [abs(p.value - figure.value) for told_ in others for p in told_ if p.name == figure.name]
    if figure.name.startswith("phase"):
        gaps = [abs((gap + pi) % (2 * pi) - pi) for gap in gaps]
    return max(gaps, default=0.0)


def alternatives(state: State, cause: Cause, shelf: Library) -> list[Cause]:
    """Other forms of a chosen cause that explain the blocks of time as well (Vuong's test)."""
    base = without(state, cause)
    forms = neighbours(state, cause) if isinstance(cause, Harmonic) else other_forms(base, cause, shelf)
    return [form for form in forms if versus(base, cause, form).z < APART]


def other_forms(base: State, cause: Cause, shelf: Library) -> Iterator[Cause]:
    """Yield a cause's other forms, refined; a change of the rig has none."""
    if not isinstance(cause, RigEffect):
        yield from (other for _, other in variants(base, cause, shelf))


def neighbours(state: State, cause: Harmonic) -> Iterator[Cause]:
    """Yield the harmonics with one of the strongest replaced by the next lower or higher one."""
    sizes = [size for size, _ in cause.polar(state.coefficients(cause).tolist())]
    strongest = sorted(zip(sizes, cause.harmonic), reverse=True)[:STRONGEST]
    for _, k in strongest:
        for other in (k - 1.0, k + 1.0):
            if other >= 1.0 and other not in cause.harmonic:
                yield type(cause)(cause.joint, tuple(sorted({*cause.harmonic, other} - {k})))


def told(state: State, cause: Cause, other: Cause) -> Sequence[Parameter]:
    """What another form says in a cause's place, all else refitted."""
    causes = tuple(other if one is cause else one for one in state.causes)
    new = solved(state.problem, causes, state, keep=True)
    return other.shown(new.coefficients(other).tolist()) if isinstance(other, Effect) else other.shown()
