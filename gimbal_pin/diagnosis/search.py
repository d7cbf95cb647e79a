"""Forward, swap, prune: which causes a log shows, every step refitting the rigid model and all that was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.contenders import MOST, PENALTY, contenders, falls, hushes, net, possible, ranked, signs_only
from gimbal_pin.diagnosis.fit import improves
from gimbal_pin.diagnosis.leftover import MUCH
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.linked import linked
from gimbal_pin.diagnosis.score import Score
from gimbal_pin.diagnosis.shapes import (
    COARSE,
    FINE,
    TOLD,
    form,
    free,
    measure,
    otherwise,
    refined,
    same,
    shape_names,
    worth,
)
from gimbal_pin.diagnosis.state import State, consistent, left, solved, without
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.effects.harmonic import Harmonic

STEPS = 16
"""Most steps of the search: every harmonic of a cause is one."""
WORSE = 0.1
"""Rise of what is left by which a step is none: what was there before stood on what a joint bears, and that moved."""
CLEARER = float(np.log(2.0))
"""Fall of what is left from which more parameters led to something better: by half."""
FURTHER = 2.0
"""Net gain of a new cause over that of a further harmonic of one that stands, under which the harmonic goes first."""
SHIFTED = 2.0**0.25
"""Factor by which shapes are moved first to make up for a cause that is left out."""
SWAPS = 4
"""Most rounds of swapping."""


def forward(state: State, shelf: Library) -> State:
    """Add the cause that gains most, refit, and again, until nothing enters.

    A step that is none ends the search at its joint: what is left there is none of these. Others go on.
    """
    closed: set[str] = set()
    for _ in range(STEPS):
        rows = contenders(state, shelf) if len(state.causes) < MOST else []
        rows = [row for row in rows if row[1].place not in closed]
        if not rows:
            break
        new = foremost(state, rows)
        after = entered(state, new)
        if np.max(after.fit.dispersion) > MUCH:
            new, after = min([(new, after), *sprung(state, rows, new)], key=lambda one: left(one[1]))
            combs = [one for one in combed(state, rows, new) if left(one[1]) < left(after) - CLEARER]
            new, after = min(combs, key=lambda one: left(one[1]), default=(new, after))
        if left(after) > left(state) + WORSE or undone(after, new):
            closed.add(new.place)
        else:
            state = after
    return state


def sprung(state: State, rows: Sequence[tuple[Score, Cause]], new: Cause) -> list[tuple[Cause, State]]:
    """States with each spring among the contenders in place of a `new` cause.

    At the encoder's angle a spring whose link swings far explains less than another cause may.
    """
    springs = [cause for _, cause in rows if cause is not new and isinstance(cause, Signal) and cause.springy]
    return [(one, entered(state, one)) for one in springs]


def entered(state: State, new: Cause) -> State:
    """The state with a new cause, all refitted and its own shape refined."""
    return polished(solved(state.problem, with_cause(state.causes, new), state), only=new)


def combed(state: State, rows: Sequence[tuple[Score, Cause]], new: Cause) -> list[tuple[Cause, State]]:
    """States with two harmonics, one the double of the other, in place of a `new` cause that is none.

    What repeats with the angle in peaks is spread over its overtones: its first alone may gain less than a gap or a
    limit, and the two of them more.
    """
    if isinstance(new, Harmonic):
        return []
    first = [one for _, one in rows if isinstance(one, Harmonic) and one.place == new.place]
    twos = [one.merged(other) for one in first if (other := one.doubled()) is not None]
    return [(two, solved(state.problem, with_cause(state.causes, two), state)) for two in twos]


def undone(state: State, new: Cause) -> bool:
    """Whether harmonics of one kind at one joint gain nothing any more once a further one is among them.

    Over part of a turn two of them may work against each other and the model, with torques far beyond what there is.
    """
    merged = next(cause for cause in state.causes if same(cause, new))
    return isinstance(merged, Harmonic) and len(merged.harmonic) > 1 and worth(without(state, merged), merged) <= 0


def foremost(state: State, rows: Sequence[tuple[Score, Cause]]) -> Cause:
    """The contender that gains most; a further harmonic of a cause that stands claims less than a new cause.

    What some harmonics leave is periodic, but not in time, and a drive's limit or a gap can look like that until the
    others are in.
    """

    def claim(row: tuple[Score, Cause]) -> float:
        further = isinstance(row[1], Harmonic) and any(same(row[1], cause) for cause in state.causes)
        return net(*row) * (FURTHER if further else 1.0)

    return max(rows, key=claim)[1]


def polished(state: State, only: Cause | None = None, step: float = COARSE) -> State:
    """Refine the shape parameters of every cause, or of one, once more, with all the others in.

    What a shape that is a little off leaves over would be named next.
    """
    for cause in state.causes:
        if shape_names(cause) and only in (None, cause) and cause not in state.swings:
            state = chained(state, cause, refined(without(state, cause), cause, step))
    return linked(consistent(state), again=step < COARSE)


def chained(state: State, cause: Cause, better: Cause) -> State:
    """The state with a cause refined; a drive's signals in the order that leaves least.

    ``f(g(x)) ≠ g(f(x))``: a limit behind a gap is another than before it, and each is refined as the last of its drive.
    """
    after = solved(state.problem, tuple(better if c is cause else c for c in state.causes), state)
    if all(alike_in_turn(cause, other) for other in state.causes if other is not cause):
        return after
    last = solved(state.problem, (*(c for c in state.causes if c is not cause), better), state)
    return min((after, last, state), key=left)


def alike_in_turn(one: Cause, other: Cause) -> bool:
    """Whether it is all the same which of two causes comes first; what acts behind a gear comes last."""
    if not isinstance(one, Signal) or not isinstance(other, Signal) or one.place != other.place:
        return True
    return (one.linear and other.linear) or one.geared or other.geared


def needed(state: State) -> State:
    """Leave out a drive's signal without which the others of its joint, moved, explain as much.

    What a shape that is a little off leaves over may be named next, and then holds it there: without it alone much is
    missed, and no shape by itself can be moved to where it would not be.
    """
    for cause in state.causes:
        beside = [c for c in state.causes if c is not cause and isinstance(c, Signal) and c.place == cause.place]
        if not isinstance(cause, Signal) or not beside:
            continue
        rest = tuple(c for c in state.causes if c is not cause)
        other = polished(solved(state.problem, rest, state), step=SHIFTED)
        rows = state.problem.evidence.rows * float(np.max(state.problem.evidence.used()))
        if rows * (left(other) - left(state)) < TOLD:
            return needed(other)
    return state


def spot(cause: Cause) -> str | None:
    """Joint at which a cause's rivals sit, beside those of the whole rig; None: at any."""
    return cause.place if cause.of_joint else None


def with_cause(causes: Sequence[Cause], new: Cause) -> tuple[Cause, ...]:
    """Add a cause; harmonics of one kind at one joint are one cause."""
    for i, old in enumerate(causes):
        if isinstance(old, Harmonic) and isinstance(new, Harmonic) and same(old, new):
            return (*causes[:i], old.merged(new), *causes[i + 1 :])
    return (*causes, new)


def pruned(state: State, limit: float, material: Callable[[State, Score], bool]) -> tuple[State, list[Cause]]:
    """Drop, the weakest first, what is no clearer than `limit` or does not matter; return what was dropped too."""
    dropped: list[Cause] = []
    while state.causes:
        bases = [without(state, cause) for cause in state.causes]
        rows = [(measure(base, cause), cause) for base, cause in zip(bases, state.causes)]
        weak = [
            (found.gain, i)
            for i, ((found, cause), base) in enumerate(zip(rows, bases))
            if surest(base, cause, found) > limit
            or hushes(base, found, cause)
            or signs_only(base, found, cause)
            or falls(base, found, cause)
            or not material(base, found)
            or not holds(base, cause)
        ]
        if not weak:
            break
        i = yielding(state, bases, min(weak)[1], rows[min(weak)[1]][0])
        if surest(bases[i], state.causes[i], rows[i][0]) <= limit and not material(bases[i], rows[i][0]):
            dropped.append(state.causes[i])
        state = reshaped(solved(state.problem, tuple(c for k, c in enumerate(state.causes) if k != i), state))
    return state, dropped


def reshaped(state: State) -> State:
    """Refine the shapes of causes that gain nothing as they are: what they were refined beside has gone.

    What was left out may have held a shape where without it the fit asks for a coefficient that no such cause has.
    """
    for cause in state.causes:
        if shape_names(cause) and worth(without(state, cause), cause) <= 0:
            state = polished(state, only=cause)
    return state


def regrown(
    before: State, state: State, shelf: Library, limit: float, material: Callable[[State, Score], bool]
) -> State:
    """Let in again, one by one, what is clear by itself at a joint of which several were pruned, and stands.

    One of them may have hidden another. `before` is the state before it was pruned.
    """
    lost = [cause.place for cause in before.causes if not any(same(cause, kept) for kept in state.causes)]
    places = {place for place in lost if lost.count(place) > 1}
    while places and len(state.causes) < MOST:
        rows = [row for row in contenders(state, shelf) if row[0].p < limit and row[1].place in places]
        if not rows:
            break
        new = foremost(state, rows)
        after, _ = pruned(entered(state, new), limit, material)
        if left(after) >= left(state):
            break
        state = after
    return state


def yielding(state: State, bases: Sequence[State], i: int, found: Score) -> int:
    """Which goes where cause `i` does not stand: it, or one of its joint without which it would, if that costs less.

    What harmonics of the angle take over of a spring leaves it a coefficient that no spring has, though it explains all
    but a little, and they that little. `bases` are the states without each cause; `found`: how cause `i` scored.
    """
    cause = state.causes[i]
    spoils = [
        k
        for k, (other, base) in enumerate(zip(state.causes, bases))
        if found.gain <= 0 and other is not cause and other.of_joint and other.place == cause.place
        if base.fit.cost < bases[i].fit.cost and measure(without(base, cause), cause).gain > 0
    ]
    return min(spoils, key=lambda k: bases[k].fit.cost, default=i)


def surest(base: State, cause: Cause, found: Score) -> float:
    """Chance of a cause by luck: of all its columns together, or of the harmonic that is clearest, times their number.

    Blocks of time are few, and many harmonics tested as one are tested weakly, however clear the first of them is.
    """
    if not isinstance(cause, Harmonic) or len(cause.harmonic) == 1:
        return found.p
    each = [measure(base, type(cause)(cause.joint, (k,))).p for k in cause.harmonic]
    return min(found.p, len(each) * min(each))


def holds(base: State, cause: Cause) -> bool:
    """Whether a cause predicts parts of time that its fit has not seen; `base` is the state without it."""
    return improves(base.fit, base.columns(cause), isinstance(cause, Signal))


def swapped(state: State, shelf: Library) -> State:
    """Replace a cause, or two at one joint, by one that fits better with all the rest refitted, until none does."""
    for _ in range(SWAPS):
        better = (found for group in groups(state.causes) if (found := replaced(state, group, shelf)) is not None)
        new = next(better, None)
        if new is None:
            return state
        state = new
    return state


def groups(causes: Sequence[Cause]) -> list[tuple[Cause, ...]]:
    """Each cause, and each two at one joint: one cause may have been taken for two others before it was seen whole."""
    pairs = [pair for pair in combinations(causes, 2) if pair[0].of_joint and pair[0].place == pair[1].place]
    return [*((cause,) for cause in causes), *pairs]


def replaced(state: State, group: tuple[Cause, ...], shelf: Library) -> State | None:
    """The state with the best other cause in a group's place, or None if the group fits as well.

    What reads the torque was built from one that the group is a part of: without it, too, it must leave no more.
    """
    others = tuple(c for c in state.causes if c not in group)
    base = solved(state.problem, others, state, keep=True)
    own = base.fit.cost - state.fit.cost - PENALTY * sum(free(cause) for cause in group)
    if len(group) == 1:
        rows = [*rivals_of(base, group[0], shelf), *variants(base, group[0], shelf)]
        own += PENALTY
    else:
        # Two causes that stand have been refined for long: beside them the last coarse step of a shape is much.
        finer = [refined(base, cause, FINE) for _, cause in contenders(base, shelf, spot(group[0]))[:1]]
        rows = [(measure(base, cause), cause) for cause in finer]
    best = max(rows, key=lambda row: net(*row), default=None)
    if best is None or net(*best) <= own:
        return None
    after = polished(solved(state.problem, with_cause(others, best[1]), state), only=best[1])
    return after if left(after) <= left(state) + WORSE else None


def rivals_of(base: State, cause: Cause, shelf: Library) -> list[tuple[Score, Cause]]:
    """Other causes that fit what this one explains; `base` is the state without it.

    A cause of the whole rig may be mistaken for one at any of its joints.
    """
    rows = [row for row in contenders(base, shelf, spot(cause)) if not same(row[1], cause)]
    if isinstance(cause, Harmonic):
        alike = [type(c)(c.joint, cause.harmonic) for _, c in rows if isinstance(c, Harmonic)]
        rows += [(found, c) for c in alike if possible(base, found := measure(base, c), c)]
    return sorted(rows, key=lambda row: -net(*row))


def variants(base: State, cause: Cause, shelf: Library) -> list[tuple[Score, Cause]]:
    """Other forms of a cause, the best of each refined: what was chosen while another was missing may not stand."""
    if isinstance(cause, Harmonic):
        return []
    others = [shelf.of(c, base) for c in shelf.causes if same(c, cause) and form(c) != form(cause)]
    best: dict[tuple[object, ...], Cause] = {}
    for _, one in ranked(base, others):
        best.setdefault(form(one.cause), one.cause)
    found = [*(refined(base, other) for other in best.values()), *otherwise(base, cause)]
    return [(measure(base, other), other) for other in found]
