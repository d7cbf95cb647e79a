"""The search, and where much is left of a joint another start of it, from the two causes that fit best together."""

from __future__ import annotations

import numpy as np

from gimbal_pin.diagnosis.contenders import PENALTY, possible
from gimbal_pin.diagnosis.couples import ranked
from gimbal_pin.diagnosis.leftover import MUCH
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.loosened import loosened
from gimbal_pin.diagnosis.search import forward, polished, swapped
from gimbal_pin.diagnosis.shapes import free, measure
from gimbal_pin.diagnosis.state import State, left, solved, without

CLEARER = float(np.log(2.0))
"""Fall of what is left from which another start of the search led to something better: by half for each cause more."""
LOOKED = 24
"""Couples that are looked at."""
TRIED = 4
"""Most of them that are refined."""


def composed(first: State, shelf: Library) -> State:
    """Search forward and swap; where much is left of a joint, start once more from the best two causes there.

    What enters first may be between two others, so that beside it neither is seen. Where much is left still, a gap
    is looked for whose flanks give.
    """
    state = swapped(forward(first, shelf), shelf)
    for j in np.flatnonzero(state.fit.dispersion > MUCH).tolist():
        start = coupled(state, state.problem.evidence.rig.joints[j], shelf)
        other = state if start is None else swapped(forward(start, shelf), shelf)
        state = other if clearer(other, state) else state
    # Where most is left the gap is: its link's swing is felt at the others, too.
    for j in np.argsort(-state.fit.dispersion).tolist():
        if state.fit.dispersion[j] > MUCH:
            joint = state.problem.evidence.rig.joints[j]
            start = loosened(state, joint)
            if start is not None and clearer(start, state) and stands(start, joint):
                state = swapped(forward(start, shelf), shelf)
    return state


def clearer(new: State, old: State) -> bool:
    """Whether a state leaves so much less than another that it is worth the causes that it may have more."""
    more = max(len(new.causes) - len(old.causes), 1)
    return left(new) < left(old) - CLEARER * more


def coupled(state: State, joint: str, shelf: Library) -> State | None:
    """The two causes that leave least in place of all at a joint, and clearly less; None if there are none.

    Args:
        state: The state.
        joint: The joint.
        shelf: The library.
    """
    others = [cause for cause in state.causes if cause.place != joint or not cause.of_joint]
    base = solved(state.problem, others, state)
    found = [polished(start) for start in starts(base, joint, shelf)]
    better = [one for one in found if clearer(one, state) and stands(one, joint)]
    return min(better, key=left, default=None)


def starts(base: State, joint: str, shelf: Library) -> list[State]:
    """States with the couples at a joint that gain most, one of each two names, of those that may be."""
    found: dict[frozenset[str], State] = {}
    for couple in ranked(base, joint, shelf)[:LOOKED]:
        causes = tuple(one.cause for one in couple)
        names = frozenset(cause.name for cause in causes)
        if names not in found and stands(start := solved(base.problem, (*base.causes, *causes), base), joint):
            found[names] = start
        if len(found) == TRIED:
            break
    return list(found.values())


def stands(state: State, joint: str) -> bool:
    """Whether each cause at a joint gains beside the others, and does what such a cause can do."""
    here = [(without(state, cause), cause) for cause in state.causes if cause.place == joint and cause.of_joint]
    found = [(base, measure(base, cause), cause) for base, cause in here]
    return all(score.gain > PENALTY * free(cause) and possible(base, score, cause) for base, score, cause in found)
