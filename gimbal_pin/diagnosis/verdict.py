"""From a fitted state to findings: rivals refitted in each cause's place, what cannot be told apart, and how sure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.diagnosis.columns import Columns, Load, build
from gimbal_pin.diagnosis.edges import decided
from gimbal_pin.diagnosis.finding import APART, Rival, Slight, Untestable
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.diagnosis.leftover import MUCH, NEARLY_ALL, NOISY
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import HIDDEN, Score, gained, overdone, visibility
from gimbal_pin.diagnosis.search import rivals_of
from gimbal_pin.diagnosis.shapes import TOLD, free, measure, moved, worth
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.diagnosis.wandering import hides, steady
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.signal import Static
from gimbal_pin.log import Array
from gimbal_pin.regressor import weight

ALIKE = 0.95
"""Correlation of two projected columns from which no log of this kind parts them."""
SHARE = 0.0015
"""Projected size over the joint's torque rms under which a cause does not matter."""
FAINT = 0.25
"""Projected size over what is left of the joint's torque in the end, under which it does not matter either: taking it
into the model lowers the error by three per cent."""
EXPLAINED = 0.5
"""Share of a joint's excess over noise that its findings must explain where much is left."""
OUTSPOKEN = 250.0
"""Dispersion from which a drive's clip or gap is none: its formula leaves nothing open that could leave so much."""
PLAIN = 0.97
"""Share explained from which it is one all the same: a switch's edge, met a moment early or late, leaves so much."""
DRAWN = 0.95
"""Share explained from which a function of the angle is one although what is left has a structure: drawn to its last
harmonic it leaves none, and in a form that the library lacks, of a steep tooth or a bump, a fifth of its amplitude."""
EDGE = 1.1
"""A shape parameter within this factor of its bound is at it."""
INSIDE = 4.0
"""A shape parameter this factor from its bound is well inside."""
ONE_SIDED = 0.99
"""Share of the time with a torque of one sign from which a link lies on one flank of a gap, and hardly crosses it."""
BOOTSTRAPS = 200


@dataclass(frozen=True, eq=False)
class Judged:
    """A chosen cause with its rivals.

    Attributes:
        cause: The cause.
        own: Its score in the state without it.
        rivals: The nearest others.
        alike: Names that this log cannot tell from it, itself first.
        frequency: Share of block bootstraps in which it beats every rival.
    """

    cause: Cause
    own: Score
    rivals: tuple[Rival, ...]
    alike: tuple[str, ...]
    frequency: float


def judged(
    state: State, cause: Cause, shelf: Library, rng: np.random.Generator, hidden: Sequence[Untestable] = ()
) -> Judged:
    """Refit every rival in a cause's place and compare block by block.

    Args:
        state: What was found.
        cause: One of it.
        shelf: The library.
        rng: For the bootstraps.
        hidden: What the logs cannot show: no rival, and yet it may be what the cause stands for.
    """
    base = without(state, cause)
    own = measure(base, cause)
    mine = block_gain(base, cause)
    found: dict[str, tuple[Rival, Array]] = {}
    for _, other in rivals_of(base, cause, shelf):
        if other.name in found:
            continue
        found[other.name] = compared(other, mine - block_gain(base, other), free(cause) - free(other))
    alike = [
        name for name, (rival, _) in found.items() if rival.z < APART or alikeness(base, cause, name, shelf) > ALIKE
    ]
    alike += [name for name in twins(base, cause, shelf, hidden) if name not in found]
    seen = dict(zip(base.problem.evidence.rig.joints, base.problem.evidence.seen))
    if cause.of_joint:
        alike += [name for name in cause.blurred(seen[cause.place]) if name not in alike]
        alike += [name for name in cause.leant if name not in alike and leans(state, cause.place)]
    draws = rng.integers(len(mine), size=(BOOTSTRAPS, len(mine)))
    wins = np.all([np.sum(apart[draws], axis=1) > 0 for _, apart in found.values()] or [np.ones(BOOTSTRAPS)], axis=0)
    rivals = tuple(sorted((rival for rival, _ in found.values()), key=lambda rival: rival.z))
    return Judged(cause, own, rivals, (cause.name, *alike), float(np.mean(wins)))


def leans(state: State, joint: str) -> bool:
    """Whether a joint's link asks for a torque of one sign nearly all the time."""
    rows = state.bearing[state.problem.evidence.rig.joint_index(joint)]
    left = np.mean(np.concatenate([np.asarray(one.load + one.inertial) for one in rows]) < 0)
    return bool(max(left, 1 - left) > ONE_SIDED)


def versus(base: State, cause: Cause, other: Cause) -> Rival:
    """How far a cause explains more than another in its place; `base` is the state without both."""
    gains = block_gain(base, cause) - block_gain(base, other)
    return compared(other, gains, free(cause) - free(other))[0]


def compared(other: Cause, gains: Array, extra: int) -> tuple[Rival, Array]:
    """Vuong's test: what a cause gains beyond another in each block, with `extra` more free parameters, (blocks,)."""
    apart = gains / 2
    delta = float(apart.sum()) - extra
    spread = float(np.std(apart) * np.sqrt(len(apart)))
    return Rival(other.name, delta, delta / max(spread, 1e-12)), apart


def block_gain(base: State, cause: Cause) -> Array:
    """Fall of the weighted sum of squares in each block, (blocks,)."""
    rest = project(base.fit, base.columns(cause))
    found = measure(base, cause)
    after = base.fit.residual - rest @ (found.beta if len(found.beta) else np.zeros(rest.shape[1]))
    return base.fit.by_block((base.fit.residual**2 - after**2)[:, None])[:, 0]


def twins(base: State, cause: Cause, shelf: Library, hidden: Sequence[Untestable]) -> list[str]:
    """Names of causes that the logs hide but for a remnant, where that remnant is what this cause explains.

    A cause with several coefficients shows by one of them, and may gain by another that is as hidden as its twin's.
    """
    here = {row.cause for row in hidden if not cause.of_joint or row.joint in (None, cause.place)} - {cause.name}
    rows = ((name, *row) for name in sorted(here) for row in imitations(base, cause, name, shelf))
    target = base.fit.target
    near = [name for name, likeness, torque in rows if likeness > ALIKE and not overdone(target, torque[None])[0]]
    return list(dict.fromkeys(near))


def alikeness(base: State, cause: Cause, name: str, shelf: Library) -> float:
    """Largest cosine between what a cause explains and what the best cause of that name could, in [0, 1]."""
    return max((near for near, _ in imitations(base, cause, name, shelf)), default=0.0)


def imitations(base: State, cause: Cause, name: str, shelf: Library) -> Iterator[tuple[float, Array]]:
    """Yield how near each cause of a name comes to what another explains, in [0, 1], and its whole torque there."""
    rest = project(base.fit, base.columns(cause))
    mine = rest @ (measure(base, cause).beta if len(measure(base, cause).beta) else np.ones(rest.shape[1]))
    positions = [part.channels.q for part in base.problem.evidence.parts]
    gravity = [weight(base.rig, q) for q in positions]
    for other in shelf.causes:
        if other.name != name or (other.of_joint and cause.of_joint and other.place != cause.place):
            continue
        # A clip or a gap that as it stands explains nothing here imitates by taking all of the torque away.
        if isinstance(other, Static) and gained(base.fit, shelf.of(other, base), True).gain <= 0:
            continue
        for columns in (shelf.of(other, base), *at_rest(base, other, gravity)):
            span = project(base.fit, columns)
            beta = np.linalg.lstsq(span, mine, rcond=1e-8)[0]
            near = float(np.linalg.norm(span @ beta) / max(float(np.linalg.norm(mine)), 1e-300))
            yield near, base.fit.stacked(columns.values) @ beta


def at_rest(base: State, cause: Cause, gravity: list[Array]) -> tuple[Columns, ...]:
    """Columns of a loaded cause that feels gravity alone, as a bearing does that the motor's torque goes past."""
    if not isinstance(cause, Effect) or not cause.loaded:
        return ()
    load = Load(base.problem.evidence, gravity, gravity, base.load.stand)
    return (build(base.problem.evidence, cause, load.stand, load, base.acting),)


def share(state: State, found: Score) -> float:
    """Projected size over torque rms, at the joint where that is largest."""
    return float(np.max(newtons(state, found) / torque_level(state)))


def newtons(state: State, found: Score) -> Array:
    """Projected size of a score at each joint over the time that counts, N m rms, (n,)."""
    evidence = state.problem.evidence
    return np.array([evidence.noise_floor(j) for j in range(evidence.rig.n)]) * loudness(state, found)


def loudness(state: State, found: Score) -> Array:
    """Projected size of a score at each joint over the time that counts, in units of the noise floor, (n,).

    As the dispersion counts it: of a joint that stands most of the time a cause is as large as while it moves.
    """
    return np.asarray(found.size / np.sqrt(np.maximum(state.problem.evidence.used(), 1e-12)))


def torque_level(state: State) -> Array:
    """Torque rms of each joint, N m, (n,)."""
    return np.sqrt(np.mean(np.concatenate(state.problem.evidence.torque) ** 2, axis=0)) + 1e-12


def material(state: State, found: Score) -> bool:
    """Whether a cause is large enough to matter; `state` is the one without it, with the final weights."""
    noise = np.sqrt(np.maximum(state.fit.dispersion, 1.0))
    return bool(found.gain > 0 and share(state, found) > SHARE and np.max(loudness(state, found) / noise) > FAINT)


def at_bound(base: State, cause: Cause) -> bool:
    """Whether a shape parameter has run to where it may not go on: the formula is asked for something else.

    One that the log does not tell may lie anywhere: well inside its bounds the cause then gains as much. `base` is the
    state without the cause.
    """
    held = [(shape, getattr(cause, shape.name, None)) for shape in cause.shapes]
    figures = [(shape, value) for shape, value in held if isinstance(value, float) and value > 0]
    for shape, value in figures:
        factor = INSIDE if value < shape.lower * EDGE else 1 / INSIDE
        if shape.lower * EDGE <= value <= shape.upper / EDGE:
            continue
        inside = moved(cause, shape.name, factor)
        if inside is None or worth(base, inside) < worth(base, cause) - TOLD:
            return True
    return False


def minor(state: State, cause: Cause) -> bool:
    """Whether a cause is smaller than what is left unexplained at its joint, where that is much.

    What of it the rigid model takes over to a joint that is explained badly, and so counts for little, is no measure.
    What a delay leaves by wandering does not count where the cause shows beside that.
    """
    size = loudness(state, measure(without(state, cause), cause))
    j = state.problem.evidence.rig.joint_index(cause.place) if cause.of_joint else int(np.argmax(size))
    less = bool(state.fit.dispersion[j] > MUCH and size[j] ** 2 < state.fit.dispersion[j])
    return less and not (cause.of_joint and hides(state, cause))


def doubtful(first: State, state: State, cause: Cause) -> bool:
    """Whether so much is left at the cause's joint that no name deserves trust, and that by no unsure edge of its own.

    `first` is the state without any cause.
    """
    at = shaken(state, cause)
    if too_much(cause, first.fit.dispersion[at], steady(state)[at]) or misses(state, cause):
        known = decided(first, state, cause) if isinstance(cause, Signal) else None
        if known is None or too_much(cause, *np.array(known)[:, None]):
            return True
    return goes_on(state, cause) or at_bound(without(state, cause), cause)


def too_much(cause: Cause, before: Array, after: Array) -> bool:
    """Whether too much is left for a cause's name, by the dispersions before and after all that was found, (k,)."""
    explained = 1 - (after - 1) / np.maximum(before - 1, 1e-9)
    least = np.where(after > NOISY, NEARLY_ALL, EXPLAINED)
    loud = isinstance(cause, Static) and np.any((after > OUTSPOKEN) & (explained < PLAIN))
    return bool(loud or np.any((after > MUCH) & (explained < least)))


def sketches(first: State, state: State, cause: Cause) -> bool:
    """Whether a function of the angle leaves much of its joint's torque, which should then be like noise.

    Harmonics, and springs, take their share of whatever has to do with the angle, as all of a motion has.
    """
    if not (isinstance(cause, Harmonic) or (isinstance(cause, Effect) and cause.restoring)):
        return False
    j = state.problem.evidence.rig.joint_index(cause.joint)
    before, after = float(first.fit.dispersion[j]), float(steady(state)[j])
    return after > MUCH and after - 1 > (1 - DRAWN) * (before - 1)


def misses(state: State, cause: Cause) -> bool:
    """Whether a drive's clip or gap leaves much where it takes most: it is local in the torque, and all of it there.

    ``Σ x² r² / Σ x²`` is what is left there, x what it takes and r the residual in units of noise.
    """
    if not isinstance(cause, Static):
        return False
    base, j = without(state, cause), state.problem.evidence.rig.joint_index(cause.joint)
    taken = np.sum(base.columns(cause).at(j).own ** 2, axis=1)
    before, after = (
        float(taken @ (x.fit.residual[x.fit.rows(j)] / x.fit.scale[j]) ** 2 / max(float(np.sum(taken)), 1e-300))
        for x in (base, state)
    )
    left = max(float(state.fit.dispersion[j]), 1.0)
    return after > MUCH * left and 1 - (after - left) / max(before - left, 1e-9) < PLAIN


def goes_on(state: State, cause: Cause) -> bool:
    """Whether harmonics of the angle run on into the last two that are tried, and much is left: no few of them are it.

    What repeats with a tooth has multiples of one harmonic. A bump once in a turn has all up to its width's, and what
    lies beyond the last is left.
    """
    if not isinstance(cause, Harmonic):
        return False
    j = state.problem.evidence.rig.joint_index(cause.joint)
    return {cause.highest - 1.0, float(cause.highest)} <= {*cause.harmonic} and bool(state.fit.dispersion[j] > MUCH)


def shaken(state: State, cause: Cause) -> list[int]:
    """Joints whose leftover speaks of a cause: its own; of a whole rig's those where it is no less than what is left.

    Elsewhere another may well have left it, which sits at that joint alone.
    """
    if cause.of_joint:
        return [state.problem.evidence.rig.joint_index(cause.place)]
    size = loudness(state, measure(without(state, cause), cause))
    return sorted({int(np.argmax(size)), *np.flatnonzero(size**2 >= state.fit.dispersion).tolist()})


def slight(state: State, causes: Sequence[Cause]) -> tuple[Slight, ...]:
    """Describe what was significant and too small."""
    rows = [(cause, measure(state, cause)) for cause in causes]
    return tuple(Slight(c.name, c.place if c.of_joint else None, share(state, s)) for c, s in rows if s.gain > 0)


def untestable(state: State, shelf: Library) -> tuple[Untestable, ...]:
    """List causes all of whose columns the rigid model and friction explain."""
    visible = shown(state, shelf.causes, shelf)
    why = {cause.name: cause.hidden for cause in shelf.causes}
    return tuple(Untestable(name, joint, why[name]) for (name, joint), left in visible.items() if left < HIDDEN)


def half_hidden(state: State, shelf: Library) -> tuple[Untestable, ...]:
    """List causes that show, but for what of them only other joints' torques can tell: here those do not."""
    every, coupled = shown(state, shelf.causes, shelf), [cause for cause in shelf.causes if cause.coupled]
    why = {cause.name: cause.hidden for cause in coupled}
    found = shown(state, coupled, shelf).items()
    return tuple(Untestable(*at, why[at[0]]) for at, left in found if left < HIDDEN <= every[at])


def shown(state: State, causes: Sequence[Cause], shelf: Library) -> dict[tuple[str, str | None], float]:
    """Name and joint → the largest share of a column's power that the rigid model and friction leave."""
    visible: dict[tuple[str, str | None], float] = {}
    columns = [shelf.of(cause, state) for cause in causes]
    for cause, seen in zip(causes, visibility(state.fit, columns).tolist()):
        key = (cause.name, cause.place if cause.of_joint else None)
        visible[key] = max(visible.get(key, 0.0), seen)
    return visible
