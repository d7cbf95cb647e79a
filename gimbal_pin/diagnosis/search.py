"""Forward, prune, swap: which causes a log shows, every step refitting the rigid model and all that was found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from gimbal_pin.diagnosis.columns import Columns, build, plain_columns, pushes, rigid_columns
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.fit import Fit, fit, improves
from gimbal_pin.diagnosis.score import Score, gained, score
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array
from gimbal_pin.model import friction_effects
from gimbal_pin.reduction import Reduction
from gimbal_pin.rig import Rig
from gimbal_pin.rows import columns_of

ENTER = 1e-4
"""A candidate whose own p is above this does not enter."""
WORTH = 1e-2
"""The same on the coarse grid, before its shape parameters are refined."""
MOST = 8
"""Most causes that are composed."""
STEPS = 16
"""Most steps of the search: every harmonic of a cause is one."""
CLOSE = 0.2
"""Share of the best gain below which a candidate is no contender on the coarse grid."""
PENALTY = 4.0
"""Gain that a free parameter makes by luck."""
FURTHER = 2.0
"""Net gain of a new cause over that of a further harmonic of one that stands, under which the harmonic goes first."""
STALE = 0.05
"""Change of a torque, as a share, up to which a column of the coarse search is kept."""
HUSHED = 1.5
"""Gain of a drive's signal over what it takes off the unexplained torque, under which it does only that."""
SETTLED = 1e-4
"""The same from which a torque that reads itself has settled."""
PASSES = 5
"""Most rounds of that."""
SWAPS = 4
"""Most rounds of swapping."""
ROUNDS = 8
"""Rounds of refinement of the shape parameters, each with half the step."""
COARSE = 2.0
"""Factor by which a shape parameter is moved first."""
FINE = 2.0 ** (1 / 64)
"""The same where a parameter is to be told as closely as the log shows it: ends at 6e-5."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Logs with the rigid model's columns, computed once."""

    evidence: Evidence
    reduction: Reduction
    rigid: Array
    rigid_full: list[Array]

    @staticmethod
    def of(evidence: Evidence, reduction: Reduction) -> Problem:
        """Compute the columns."""
        return Problem(evidence, reduction, *rigid_columns(evidence, reduction))

    @cached_property
    def friction(self) -> tuple[Effect, ...]:
        """Coulomb and viscous friction of every joint."""
        return friction_effects(self.evidence.rig.joints)


@dataclass(frozen=True, eq=False)
class State:
    """Causes chosen so far, all refitted with the rigid model.

    Attributes:
        problem: The logs.
        causes: The chosen causes.
        fit: The fit.
        rig: The rig with the fitted inertias.
        torque: The best estimate of the torque that acts, N m, (m, n) per part.
        acting: The measured torque after the drives' signals, N m, (m, n) per part.
        unexplained: What of it the fit does not predict, N m, (m, n) per part.
    """

    problem: Problem
    causes: tuple[Cause, ...]
    fit: Fit
    rig: Rig
    torque: list[Array]
    acting: list[Array]
    unexplained: list[Array]

    def columns(self, cause: Cause) -> Columns:
        """What a cause would add."""
        return build(self.problem.evidence, cause, self.rig, self.torque, self.acting)

    def coefficients(self, cause: Cause) -> Array:
        """Fitted coefficients of a chosen torque or rig effect."""
        return self.fit.theta[self.places(cause)]

    def places(self, cause: Cause) -> slice:
        """Where they stand in theta."""
        at = len(self.fit.theta) - sum(width(c) for c in self.causes)
        for other in self.causes:
            if other is cause:
                return slice(at, at + width(other))
            at += width(other)
        raise ValueError(f"{cause.name} was not chosen")


def width(cause: Cause) -> int:
    """Coefficients that a cause adds to theta."""
    return len(cause.coefficients) if isinstance(cause, Effect) else int(isinstance(cause, RigEffect))


def solved(problem: Problem, causes: Sequence[Cause], before: State | None = None, keep: bool = False) -> State:
    """Refit everything with these causes.

    Args:
        problem: The logs.
        causes: The causes.
        before: A state to take the model's torque from, which loaded causes read.
        keep: Keep its weights too, so that sums of squares can be compared.
    """
    evidence = problem.evidence
    rig = before.rig if before else evidence.rig
    model = before.torque if before else evidence.torque
    acting = evidence.torque
    for cause in causes:
        if isinstance(cause, Signal):
            acting = acted(evidence, cause, acting)
    b = np.stack([evidence.whiten([x[:, j] for x in acting], j) for j in range(evidence.rig.n)], axis=1)
    effects = [*problem.friction, *(c for c in causes if not isinstance(c, Signal))]
    A = np.concatenate([problem.rigid, *(build(evidence, c, rig, model, acting).values for c in effects)], axis=2)
    now = fit(A, b, evidence.used(), evidence.block, before.fit.scale if before and keep else None)
    total = predicted(problem, effects, now.theta, model)
    mixed = [part.mixed(x, y) for part, x, y in zip(evidence.parts, total, acting)]
    unexplained: list[Array] = [y - x for x, y in zip(total, acting)]
    return State(problem, tuple(causes), now, refitted(problem, now.theta), mixed, acting, unexplained)


def acted(evidence: Evidence, signal: Signal, torque: list[Array]) -> list[Array]:
    """Let a drive's signal act on the torques of its joint."""
    j = evidence.rig.joint_index(signal.joint)
    out = []
    for part, x in zip(evidence.parts, torque):
        changed = x.copy()
        changed[:, j] = signal.acting(x[:, j], part.dt)
        out.append(changed)
    return out


def refitted(problem: Problem, theta: Array) -> Rig:
    """Return the rig with the fitted base parameters."""
    rig, reduction = problem.evidence.rig, problem.reduction
    phi = rig.phi.copy()
    phi[columns_of(rig, reduction)] += theta[: len(reduction.independent)] - given_beta(rig, reduction)
    return rig.with_phi(phi)


def predicted(problem: Problem, effects: Sequence[Cause], theta: Array, torque: list[Array]) -> list[Array]:
    """The model's total torque at full rate, N m, (m, n) per part."""
    width_ = len(problem.reduction.independent)
    out: list[Array] = [x @ theta[:width_] for x in problem.rigid_full]
    at = width_
    for effect in effects:
        size = width(effect)
        if isinstance(effect, Effect):
            j = problem.evidence.rig.joint_index(effect.joint)
            for total, x in zip(out, plain_columns(problem.evidence, effect, torque)):
                total[:, j] += x @ theta[at : at + size]
        at += size
    return out


def library(problem: Problem, kinds: Mapping[str, type[Cause]]) -> list[Cause]:
    """Every cause at every joint, on the coarse grid of its shape parameters."""
    rig, seen = problem.evidence.rig, problem.evidence.seen
    found: list[Cause] = []
    for kind in kinds.values():
        for joint, ranges in zip(rig.joints, seen) if kind.of_joint else ((rig.joints[0], seen[0]),):
            found += kind.tried(joint, ranges)
    return found


class Library:
    """Columns of the whole library, built once; those that read a torque again where it has changed by much."""

    def __init__(self, problem: Problem, causes: Sequence[Cause]) -> None:
        """Remember what to build."""
        self.problem, self.causes = problem, causes
        self.built: dict[Cause, tuple[list[Array], Columns]] = {}

    def columns(self, state: State, place: str | None = None) -> list[Columns]:
        """Columns at this state, of all causes or only of those at a joint and of the whole rig."""
        here = [c for c in self.causes if place is None or c.place == place or not c.of_joint]
        return [self.of(cause, state) for cause in here if cause not in state.causes]

    def of(self, cause: Cause, state: State) -> Columns:
        """Columns of one cause: as they were, if what they were built from is nearly as it was."""
        read = self.read(cause, state)
        known = self.built.get(cause)
        if known is None or not all(near(new, old) for new, old in zip(read, known[0])):
            known = read, state.columns(cause)
            self.built[cause] = known
        return known[1]

    def read(self, cause: Cause, state: State) -> list[Array]:
        """What a cause's columns depend on besides the log: the torque at its joint, the rig's inertias, or nothing."""
        if isinstance(cause, RigEffect):
            return [state.rig.phi]
        if isinstance(cause, Effect) and not cause.loaded:
            return []
        j = self.problem.evidence.rig.joint_index(cause.place)
        return [x[:, j] for x in (state.acting if isinstance(cause, Signal) else state.torque)]


def near(new: Array, old: Array, share: float = STALE) -> bool:
    """Whether two torques differ by less than a share of their size."""
    return float(np.linalg.norm(new - old)) <= share * float(np.linalg.norm(old))


def ranked(state: State, columns: Sequence[Columns]) -> list[tuple[float, Columns]]:
    """Gains on the coarse grid, the largest first; only those above zero."""
    rows = [(gained(state.fit, one, False).gain, one) for one in columns]
    return sorted((row for row in rows if row[0] > 0), key=lambda row: -row[0])


def refined(state: State, cause: Cause, step: float = COARSE) -> Cause:
    """Return the cause with its shape parameters moved to where it gains most: a pattern search in their logarithms.

    Args:
        state: The state without the cause.
        cause: The cause.
        step: The first step, a factor; every round takes its square root.
    """
    best, at = worth(state, cause), cause
    for _ in range(ROUNDS):
        for name in shape_names(cause):
            for factor in (step, 1 / step):
                other = moved(at, name, factor)
                if other is not None and (found := worth(state, other)) > best:
                    best, at = found, other
        step **= 0.5
    return at


def worth(state: State, cause: Cause) -> float:
    """The gain of a cause as it stands in this state, without how sure that is."""
    return gained(state.fit, state.columns(cause), isinstance(cause, Signal)).gain


def measure(state: State, cause: Cause) -> Score:
    """Score a cause as it stands in this state; a drive's signal with the coefficient one that it has."""
    return score(state.fit, state.columns(cause), isinstance(cause, Signal))


def shape_names(cause: Cause) -> list[str]:
    """Shape parameters that are continuous and stand as fields; one at zero is a form of its own, and stays there."""
    if isinstance(cause, RigEffect):
        return []
    held = {field.name for field in fields(cause)} - set(cause.chosen)
    return [s.name for s in cause.shapes if s.name in held and isinstance(x := getattr(cause, s.name), float) and x]


def moved(cause: Cause, name: str, factor: float) -> Cause | None:
    """Return the cause with one shape parameter multiplied, or None outside its bounds."""
    shape = next(s for s in cause.shapes if s.name == name)
    value = getattr(cause, name) * factor
    return replace(cause, **{name: value}) if shape.lower <= value <= shape.upper else None


def contenders(state: State, shelf: Library, place: str | None = None) -> list[tuple[Score, Cause]]:
    """The best of each cause, refined, the largest net gain first: what fits the residual of this state.

    Args:
        state: The state.
        shelf: The library.
        place: Only causes at this joint and of the whole rig; None: of any joint, that of the best candidate.
    """
    taken = {(c.name, c.place) for c in state.causes if not isinstance(c, (Harmonic, RigEffect))}
    gains = ranked(state, shelf.columns(state, place))
    rows = [(gain, one) for gain, one in gains if (one.cause.name, one.cause.place) not in taken]
    first: dict[tuple[str, str], Cause] = {}
    for gain, one in rows:
        key = (one.cause.name, one.cause.place)
        if gain > CLOSE * rows[0][0] and key not in first and score(state.fit, one, False).p < WORTH:
            first[key] = whole(state, [other for _, other in rows], one.cause)
    best = [refined(state, cause) for cause in list(first.values())[:MOST]]
    again = [(measure(state, cause), cause) for cause in best]
    passed = [row for row in again if row[0].p < ENTER and net(*row) > 0 and possible(state, *row)]
    return sorted(passed, key=lambda row: -net(*row))


def whole(state: State, columns: Sequence[Columns], cause: Cause) -> Cause:
    """Return the cause, or that of its grid which gains most with coefficient one: what clips part of it does not."""
    if not isinstance(cause, Signal) or cause.linear:
        return cause
    rows = [(gained(state.fit, one, True).gain, one.cause) for one in columns if same(one.cause, cause)]
    gain, best = max(rows, key=lambda row: row[0])
    return best if gain > 0 else cause


def possible(state: State, found: Score, cause: Cause) -> bool:
    """Whether what a cause would do is what such a cause can do."""
    return not hushes(state, found, cause) and not drives(state, found, cause)


def drives(state: State, found: Score, cause: Cause) -> bool:
    """Whether dry friction at the cause's joint would have to push, all else refitted."""
    if not isinstance(cause, Effect) or not cause.dry or not len(found.beta):
        return False
    added = state.fit.stacked(state.columns(cause).values) @ found.beta
    theta = state.fit.theta - state.fit.information @ (state.fit.stack.T @ added)
    effects = [*state.problem.friction, *(c for c in state.causes if not isinstance(c, Signal))]
    ends = np.cumsum([len(state.problem.reduction.independent), *map(width, effects)])
    always = len(state.problem.friction)
    brakes = [
        (effect, theta[begin:end])
        for k, (effect, begin, end) in enumerate(zip(effects, ends, ends[1:]))
        if isinstance(effect, Effect) and effect.joint == cause.joint and (k < always or effect.dry)
    ]
    return pushes(state.problem.evidence, [*brakes, (cause, found.beta)], state.torque)


def hushes(state: State, found: Score, cause: Cause) -> bool:
    """Whether a drive's signal gains by taking away what nobody explains: it does that to any torque, a noise too."""
    if not isinstance(cause, Signal) or not cause.linear:
        return False
    evidence, j = state.problem.evidence, state.problem.evidence.rig.joint_index(cause.joint)
    left = [x[:, j] for x in state.unexplained]
    quiet = [cause.acting(x, part.dt) for x, part in zip(left, evidence.parts)]
    loud, hushed = (float(np.sum(evidence.whiten(x, j) ** 2)) for x in (left, quiet))
    return bool(found.gain < HUSHED * (loud - hushed) * state.fit.scale[j] ** 2)


def net(found: Score, cause: Cause) -> float:
    """Gain less what as many free parameters gain by luck."""
    return found.gain - PENALTY * free(cause)


def free(cause: Cause) -> int:
    """Coefficients and continuous shape parameters of a cause."""
    return width(cause) + len(shape_names(cause))


def forward(state: State, shelf: Library) -> State:
    """Add the cause that gains most, refit, and again, until nothing enters."""
    for _ in range(STEPS):
        rows = contenders(state, shelf) if len(state.causes) < MOST else []
        if not rows:
            break
        new = foremost(state, rows)
        state = polished(solved(state.problem, with_cause(state.causes, new), state), only=new)
    return state


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
        if shape_names(cause) and only in (None, cause):
            better = refined(without(state, cause), cause, step)
            state = solved(state.problem, tuple(better if c is cause else c for c in state.causes), state)
    return consistent(state)


def consistent(state: State) -> State:
    """Solve again until the loaded causes have read the torque that they themselves are a part of."""
    loaded = any(isinstance(cause, Effect) and cause.loaded for cause in state.causes)
    for _ in range(PASSES if loaded else 0):
        before, state = state, solved(state.problem, state.causes, state)
        if all(near(new, old, SETTLED) for new, old in zip(state.torque, before.torque)):
            break
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


def same(a: Cause, b: Cause) -> bool:
    """Whether two are the same cause at the same place."""
    return a.name == b.name and a.place == b.place


def without(state: State, cause: Cause) -> State:
    """Refit without a cause, the joints weighted as before."""
    return solved(state.problem, tuple(c for c in state.causes if c is not cause), state, keep=True)


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
            or not material(base, found)
            or not holds(base, cause)
        ]
        if not weak:
            break
        i = min(weak)[1]
        if surest(bases[i], state.causes[i], rows[i][0]) <= limit and not material(bases[i], rows[i][0]):
            dropped.append(state.causes[i])
        state = solved(state.problem, tuple(c for k, c in enumerate(state.causes) if k != i), state)
    return state, dropped


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
    """The state with the best other cause in a group's place, or None if the group fits as well."""
    others = tuple(c for c in state.causes if c not in group)
    base = solved(state.problem, others, state, keep=True)
    own = base.fit.cost - state.fit.cost - PENALTY * sum(free(cause) for cause in group)
    if len(group) == 1:
        rows = [*rivals_of(base, group[0], shelf), *variants(base, group[0], shelf)]
        own += PENALTY
    else:
        rows = contenders(base, shelf, spot(group[0]))
    best = max(rows, key=lambda row: net(*row), default=None)
    return solved(state.problem, with_cause(others, best[1]), state) if best and net(*best) > own else None


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
    found = [refined(base, other) for other in best.values()]
    return [(measure(base, other), other) for other in found]


def form(cause: Cause) -> tuple[object, ...]:
    """What of a cause is chosen rather than measured: a stiffening spring, an exponent, a shape left at zero."""
    held = [(f.name, getattr(cause, f.name)) for f in fields(cause)]
    return tuple(x == 0.0 if isinstance(x, float) and name not in cause.chosen else x for name, x in held)
