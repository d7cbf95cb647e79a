"""Forms of a cause that the log cannot tell from the one named: what they would say differs, and so is unsure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import hypot, inf, isfinite, pi

import numpy as np

from gimbal_pin.diagnosis.finding import APART
from gimbal_pin.diagnosis.fit import norms, project
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.search import variants
from gimbal_pin.diagnosis.shapes import form, free, measure, moved, refined, same, shape_names, worth
from gimbal_pin.diagnosis.state import State, solved, without
from gimbal_pin.diagnosis.verdict import versus
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter

STRONGEST = 3
"""Harmonics whose neighbours are tried."""
CLOSE = 5.0
"""Log-likelihood under which a form still has support: ten of AIC (Burnham and Anderson 2002, section 2.6)."""
LEAST = 0.5
"""Share of what a cause explains that another form of it must explain: what leaves more is the form of something else,
however few the blocks of time in which the cause acts, as a limit does on rare peaks. By three of them no z reaches
`APART`."""
FAR = 4.0
"""Factor by which a shape parameter is moved to look for another place that does as well."""
SYSTEMATIC = 0.0025
"""Share of a figure that clocks, filters and the grid of samples may shift it by, whatever the noise."""


def widened(state: State, cause: Cause, shown: Sequence[Parameter], shelf: Library) -> tuple[Parameter, ...]:
    """``std² + (largest difference to what another form says)² + (SYSTEMATIC value)²``, wherever there is a std.

    The variance that does not presume the form (Burnham and Anderson, Model Selection and Multimodel Inference, 2002,
    eq. 4.9), at its largest over the forms rather than at their mean: which is true is what the log does not say.
    """
    others = [told(state, cause, other) for other in alternatives(state, cause, shelf)]
    others += pinned(state, cause, shelf)
    return tuple(replace(p, std=hypot(p.std, doubt(p, others), SYSTEMATIC * p.value)) for p in shown)


def doubt(figure: Parameter, others: Sequence[Sequence[Parameter]]) -> float:
    """Largest difference of a figure to that of the same name among others."""
    return max((apart(figure, p) for told_ in others for p in told_ if p.name == figure.name), default=0.0)


def apart(figure: Parameter, other: Parameter) -> float:
    """Difference of two figures within the first one's bounds; phases round the circle."""
    gap = abs(min(max(other.value, figure.lower), figure.upper) - figure.value)
    return abs((gap + pi) % (2 * pi) - pi) if figure.name.startswith("phase") else gap


def alternatives(state: State, cause: Cause, shelf: Library) -> list[Cause]:
    """Other forms of a chosen cause that explain the blocks of time as well (Vuong's test), or nearly as much.

    The second is for forms that hardly differ here: what little one gains over the other it may gain in every block. A
    form with more parameters does not count by it: that it is near says only that those tell nothing (Arnold, J.
    Wildlife Management 74, 2010). Nor does one that leaves most of what the cause explains.
    """
    base = without(state, cause)
    forms = neighbours(state, cause) if isinstance(cause, Harmonic) else other_forms(base, cause, shelf)
    least = LEAST * worth(base, cause)
    rivals = ((other, versus(base, cause, other)) for other in forms if worth(base, other) > least)
    return [
        other
        for other, rival in rivals
        if (rival.z < APART and not needless(cause, other, rival.delta)) or near(cause, other, rival.delta)
    ]


def needless(cause: Cause, other: Cause, delta: float) -> bool:
    """Whether a form that has a plainer one has more parameters, and no more support by them: they tell nothing."""
    return delta > 0 and other.plain() != other and free(other) > free(cause)


def near(cause: Cause, other: Cause, delta: float) -> bool:
    """Whether another form with no more parameters has hardly less support; `delta`: in log-likelihood."""
    return delta < CLOSE and free(other) <= free(cause)


def other_forms(base: State, cause: Cause, shelf: Library) -> Iterator[Cause]:
    """Yield a cause's other forms, refined; a change of the rig has none."""
    if not isinstance(cause, RigEffect):
        yield from (other for _, other in variants(base, cause, shelf))
        yield from elsewhere(base, cause)


def elsewhere(base: State, cause: Cause) -> Iterator[Cause]:
    """Yield where a refinement ends that starts far off in the last of a filter's several shape parameters.

    Within a band poles and zeros trade places: a resonance above it shows by ``(1/r - 1)/ω²`` alone, r the rotor's
    share, and the others follow where that goes.
    """
    names = shape_names(cause) if isinstance(cause, Signal) and cause.linear else []
    for factor in (FAR, 1 / FAR) if len(names) > 1 else ():
        start = moved(cause, names[-1], factor)
        if start is not None and worth(base, found := refined(base, start)) > 0:
            yield found


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


def pinned(state: State, cause: Cause, shelf: Library) -> list[Sequence[Parameter]]:
    """What forms say that leave their bounds where they are free, held within them, and explain nearly as much so."""
    others = [c for c in shelf.causes if same(c, cause) and form(c) != form(cause) and bounded(c)]
    if not others:
        return []
    base = without(state, cause)
    least = measure(base, cause).gain - 2 * CLOSE
    rows = ((other, *held(base, other, shelf)) for other in others if isinstance(other, Effect))
    return [other.shown(values.tolist()) for other, values, gain in rows if gain > least]


def bounded(cause: Cause) -> bool:
    """Whether a cause is linear in several coefficients of which some are bounded."""
    terms = cause.coefficients if isinstance(cause, Effect) and not shape_names(cause) else ()
    return len(terms) > 1 and any(isfinite(c.lower) or isfinite(c.upper) for c in terms)


def held(base: State, other: Effect, shelf: Library) -> tuple[Array, float]:
    """Coefficients within their bounds, (c,), and what they gain; no gain where they are free to be what they are."""
    from scipy.optimize import lsq_linear

    columns = shelf.of(other, base)
    rest = project(base.fit, columns)
    unit = np.maximum(norms(rest), 1e-300)
    found = lsq_linear(rest / unit, base.fit.residual, (columns.lower * unit, columns.upper * unit), method="bvls")
    gain = base.fit.cost - 2 * float(found.cost)
    return found.x / unit, gain if np.any(found.active_mask) else -inf
