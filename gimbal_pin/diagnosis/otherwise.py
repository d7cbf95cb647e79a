"""The same causes, fitted to the logs as they would be without something that was taken into account."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved
from gimbal_pin.log import Array, Log
from gimbal_pin.platform import BaseMotion
from gimbal_pin.reduction import reduce
from gimbal_pin.rows import Filtering

CLEAR = 3.0
"""Standard deviations by which the fit must gain over blocks."""


class Otherwise(NamedTuple):
    """What the fit would have been.

    Attributes:
        plain: Without any cause.
        state: With the causes that were found.
        held: The held-out part.
    """

    plain: State
    state: State
    held: Evidence


def otherwise(
    found: State, train: Sequence[Log], test: Sequence[Log], filtering: Filtering, base: BaseMotion
) -> Otherwise:
    """Fit the causes of a state to other logs; without held-out ones these stand for them too."""
    rig = found.problem.evidence.rig
    origins = {log.name: float(log.t[0]) for log in (*train, *test)}
    evidence = gather(rig, train, filtering, origins)
    problem = Problem.of(evidence, reduce(rig, base=base))
    plain = solved(problem, (), solved(problem, ()))
    state = consistent(solved(problem, found.causes, plain)) if found.causes else plain
    return Otherwise(plain, state, judged(rig, test, filtering, origins) if test else evidence)


def clarity(before: State, after: State, joint: int) -> float:
    """Fall of one joint's sum of squares over its scatter by blocks, in standard deviations."""
    falls = squares(before, joint) - squares(after, joint)
    return float(np.sum(falls) / max(float(np.std(falls) * np.sqrt(len(falls))), 1e-300))


def squares(state: State, joint: int) -> Array:
    """One joint's squared residual in units of the noise floor, summed over each block, (blocks,)."""
    rows = state.fit.residual.reshape(-1, len(state.fit.scale)) / state.fit.scale
    own = np.zeros_like(rows)
    own[:, joint] = rows[:, joint] ** 2
    return state.fit.by_block(own.reshape(-1, 1))[:, 0]
