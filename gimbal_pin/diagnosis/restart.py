"""The search, and where much is left of a joint other starts of it: from another cause, or the two that fit best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.contenders import PENALTY, contenders, possible
from gimbal_pin.diagnosis.contenders import ranked as gaining
from gimbal_pin.diagnosis.couples import ranked
from gimbal_pin.diagnosis.edges import cleared, dispersion
from gimbal_pin.diagnosis.leftover import MUCH, NEARLY_ALL
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.loosened import loosened
from gimbal_pin.diagnosis.score import all_gained
from gimbal_pin.diagnosis.search import CLEARER, WORSE, entered, foremost, forward, polished, swapped
from gimbal_pin.diagnosis.shapes import form, free, measure, refined
from gimbal_pin.diagnosis.state import State, consistent, left, solved, without
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.signal import Static

LOOKED = 24
"""Couples that are looked at."""
SEVERAL = 3
"""Causes at one joint from which one that explains as much is looked for."""
TRIED = 4
"""Most of them that are refined."""
Start = Callable[[State, str, Library], State | None]
"""What a search may begin with at a joint."""


def composed(first: State, shelf: Library) -> State:
    """Search forward and swap; where much is left of a joint, start once more from another cause or the best two there.

    What enters first may be between two others, so that beside it neither is seen. Several causes at one joint may be
    one in a form that by itself gained no more than the first of them, and a base that leans about both of its axes may
    gain less about either than what stands in for it. Where much is left still, a gap is looked for whose flanks give,
    and a spring whose link swings far; and last a threshold that tells all but what lies at its edge.
    """
    state = swapped(forward(first, shelf), shelf)
    for joint in state.problem.evidence.rig.joints:
        state = alone(state, joint, shelf) or state
    start = leaning(first, shelf) if state.causes else None
    if start is not None and clearer(start, state):
        state = swapped(forward(start, shelf), shelf)
    for j in np.flatnonzero(state.fit.dispersion > MUCH).tolist():
        for other in (second, coupled):
            state = began(other, state, j, shelf)
    # Where most is left the gap is: its link's swing is felt at the others, too.
    for j in np.argsort(-state.fit.dispersion).tolist():
        if state.fit.dispersion[j] > MUCH:
            joint = state.problem.evidence.rig.joints[j]
            found = (one for one in loosened(state, joint, shelf) if clearer(one, state) or sparser(one, state))
            start = next((one for one in found if stands(one, joint)), None)
            state = state if start is None else swapped(forward(start, shelf), shelf)
    for j in np.flatnonzero(state.fit.dispersion > MUCH).tolist():
        state = edged(first, state, j, shelf) or state
    return state


def edged(first: State, state: State, j: int, shelf: Library) -> State | None:
    """A threshold in place of all at a joint, where its edge is clear: that tells nearly all there, and more than they.

    A loop that lingers at an edge leaves of its time what nobody can know, and others than the threshold take of it
    what they can.
    """
    joint = state.problem.evidence.rig.joints[j]
    others, here = parted(state, joint)
    if any(isinstance(cause, Static) and cause.abrupt for cause in here):
        return None
    base = solved(state.problem, others, state)
    for _, cause in contenders(base, shelf, joint):
        clear = cleared(state.problem.evidence, cause) if isinstance(cause, Static) and cause.place == joint else None
        if clear is None:
            continue
        found = entered(base, cause)
        before, old, new = (dispersion(one, clear, j) for one in (first, state, found))
        fewer = free(cause) < sum(map(free, here))
        if before - new > NEARLY_ALL * (before - 1) and np.log(new) < np.log(old) - CLEARER * (not fewer):
            return found if stands(found, joint) else None
    return None


def parted(state: State, joint: str) -> tuple[list[Cause], list[Cause]]:
    """A state's causes elsewhere, and those at a joint."""
    here = [cause for cause in state.causes if cause.of_joint and cause.place == joint]
    return [cause for cause in state.causes if cause not in here], here


def began(otherwise: Start, state: State, j: int, shelf: Library) -> State:
    """What a search ends with that begins otherwise at a joint of which much is left; as it was if that is no clearer.

    Args:
        otherwise: What it begins with, of a state, the joint and the library.
        state: What it ended with before.
        j: Which joint.
        shelf: The library.
    """
    joint = state.problem.evidence.rig.joints[j]
    start = otherwise(state, joint, shelf) if state.fit.dispersion[j] > MUCH else None
    found = state if start is None else swapped(forward(start, shelf), shelf)
    return found if clearer(found, state) else state


def alone(state: State, joint: str, shelf: Library) -> State | None:
    """One cause in place of `SEVERAL` at a joint, which leaves no more than they do; None if there is none."""
    others, here = parted(state, joint)
    if len(here) < SEVERAL:
        return None
    base = solved(state.problem, others, state)
    own = [one for one in shelf.columns(base, joint) if one.cause.of_joint and not isinstance(one.cause, Harmonic)]
    best: dict[tuple[object, ...], Cause] = {}
    for _, one in gaining(base, own):
        best.setdefault((one.cause.name, form(one.cause)), one.cause)
    found = [solved(base.problem, (*base.causes, refined(base, cause)), base) for cause in list(best.values())[:TRIED]]
    least = min((polished(polished(one)) for one in found), key=left, default=None)
    return least if least is not None and left(least) <= left(state) + WORSE and stands(least, joint) else None


def leaning(first: State, shelf: Library) -> State | None:
    """The state with the two turns of the base that gain most together; None where none do."""
    turns = shelf.all_of(
        [cause for cause in shelf.causes if isinstance(cause, RigEffect) and not cause.of_joint], first
    )
    pairs = {(one.cause, other.cause): both(one, other) for one, other in combinations(turns, 2)}
    gains = dict(zip(pairs, (found.gain for found in all_gained(first.fit, list(pairs.values()), False))))
    best = max(gains, key=lambda pair: gains[pair], default=None)
    if best is None or gains[best] <= 0:
        return None
    return consistent(solved(first.problem, best, first))


def both(one: Columns, other: Columns) -> Columns:
    """The columns of two causes of the whole rig side by side."""
    own, lower, upper = (
        np.concatenate(rows, axis=-1)
        for rows in ((one.own, other.own), (one.lower, other.lower), (one.upper, other.upper))
    )
    return replace(one, own=own, lower=lower, upper=upper)


def clearer(new: State, old: State) -> bool:
    """Whether a state leaves so much less than another that it is worth the causes that it may have more."""
    more = max(len(new.causes) - len(old.causes), 1)
    return left(new) < left(old) - CLEARER * more


def sparser(new: State, old: State) -> bool:
    """Whether a state leaves less than another by fewer parameters."""
    return left(new) < left(old) and sum(map(free, new.causes)) < sum(map(free, old.causes))


def second(state: State, joint: str, shelf: Library) -> State | None:
    """One cause in place of all at a joint: of those that would not enter first, what leaves least once it is in.

    What gains most of all may do so in place of two others, and beside it neither is seen. What reads the torque gains
    less than it explains, until the torque that it reads is the one that it has mended.
    """
    base = solved(state.problem, parted(state, joint)[0], state)
    rows = [row for row in contenders(base, shelf, joint) if row[1].of_joint]
    first = foremost(base, rows) if rows else None
    found = [entered(base, cause) for _, cause in rows if cause is not first]
    return min(found, key=left, default=None)


def coupled(state: State, joint: str, shelf: Library) -> State | None:
    """The two causes that leave least in place of all at a joint, and clearly less; None if there are none.

    Args:
        state: The state.
        joint: The joint.
        shelf: The library.
    """
    base = solved(state.problem, parted(state, joint)[0], state)
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
