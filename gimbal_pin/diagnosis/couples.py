"""Two causes at one joint tried together: beside another cause, or none, neither of them may be seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.contenders import PENALTY
from gimbal_pin.diagnosis.contenders import ranked as alone
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import HIDDEN, fitting, visibility
from gimbal_pin.diagnosis.shapes import form, free, moved, shape_names
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause, Effect
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.log import Array

HARMONICS = 12
"""Most harmonics that are tried with others: those that gain most by themselves."""
BETWEEN = 1.5
"""Factor from a shape parameter on the coarse grid to one about half way to the next."""
Couple = tuple[Columns, Columns]


def ranked(base: State, joint: str, shelf: Library) -> list[Couple]:
    """Return the couples at a joint, each two causes in each of their forms once, those that gain most first.

    Args:
        base: The state without any cause there.
        joint: The joint.
        shelf: The library.
    """
    best: dict[tuple[object, ...], tuple[float, Couple]] = {}
    for gain, couple in couples(base, candidates(base, joint, shelf)):
        key = tuple((one.cause.name, form(one.cause)) for one in couple)
        if gain > best.get(key, (0.0,))[0]:
            best[key] = gain, couple
    return [couple for _, couple in sorted(best.values(), key=lambda row: -row[0])]


def candidates(base: State, joint: str, shelf: Library) -> list[Columns]:
    """What can be seen of the library at a joint; of harmonics, which are many, those that gain most.

    Two causes that make up for each other are told by their shapes: those with one are tried twice as closely.
    """
    j = base.problem.evidence.rig.joint_index(joint)
    every = [one.at(j) for one in shelf.columns(base, joint) if one.cause.of_joint]
    plain = [one for one in every if not isinstance(one.cause, Harmonic)]
    plain += [base.columns(cause).at(j) for one in plain for cause in between(one.cause)]
    shown = [one for one, seen in zip(plain, visibility(base.fit, plain)) if seen > HIDDEN]
    harmonics = alone(base, [one for one in every if isinstance(one.cause, Harmonic)])
    return [*shown, *(one for _, one in harmonics[:HARMONICS])]


def between(cause: Cause) -> list[Cause]:
    """Return the torque half way to the next on the grid of its one shape; none where it has more of them."""
    names = shape_names(cause) if isinstance(cause, Effect) else []
    other = moved(cause, names[0], BETWEEN) if len(names) == 1 else None
    return [] if other is None else [other]


def couples(base: State, columns: Sequence[Columns]) -> Iterator[tuple[float, Couple]]:
    """Yield every two of some candidates of one joint and what both gain, less what as many parameters gain by luck.

    As in `score.gained_alike` the products ``RᵀR`` and ``Rᵀr`` of what the fitted columns leave are all it takes.
    """
    if not columns:
        return
    rows = base.fit.rows(columns[0].joint)
    S = np.hstack([base.fit.weighted(one) for one in columns])
    along = base.fit.along(S, columns[0].joint)
    gram, s = S.T @ S - along.T @ along, base.fit.residual[rows] @ S
    ends = np.cumsum([one.width for one in columns])
    groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, k in combinations(range(len(columns)), 2):
        if columns[i].cause.name != columns[k].cause.name:
            groups.setdefault((columns[i].width, columns[k].width), []).append((i, k))
    for (c, d), pairs in groups.items():
        first, second = np.array(pairs).T
        at = np.hstack([ends[first][:, None] - np.arange(c, 0, -1), ends[second][:, None] - np.arange(d, 0, -1)])
        yield from judged(columns, pairs, gram[at[:, :, None], at[:, None]], s[at])


def judged(
    columns: Sequence[Columns], pairs: Sequence[tuple[int, int]], gram: Array, s: Array
) -> Iterator[tuple[float, Couple]]:
    """Yield those of some pairs that are within bounds, from their ``RᵀR``, (k, c, c), and ``Rᵀr``, (k, c)."""
    own = fitting(gram, s)
    lower, upper = (np.array([[*x(columns[i]), *x(columns[k])] for i, k in pairs]) for x in (low, high))
    gain = np.sum(own * s, axis=1)
    within = np.all((own >= lower) & (own <= upper), axis=1)
    for place in np.flatnonzero(within & (gain > 0)).tolist():
        one, other = (columns[i] for i in pairs[place])
        yield float(gain[place]) - PENALTY * (free(one.cause) + free(other.cause)), (one, other)


def low(columns: Columns) -> list[float]:
    """Lower bounds of the coefficients."""
    bounds: list[float] = columns.lower.tolist()
    return bounds


def high(columns: Columns) -> list[float]:
    """Upper bounds of the coefficients."""
    bounds: list[float] = columns.upper.tolist()
    return bounds
