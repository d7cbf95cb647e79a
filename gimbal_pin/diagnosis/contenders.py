"""Which causes could enter: those that gain on the coarse grid, refined, and that do what such a cause can do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.columns import PUSHED, Columns, Stand, build, plain_columns, pushes
from gimbal_pin.diagnosis.fit import LUCK, improves
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.nearness import nearness, span
from gimbal_pin.diagnosis.score import CLEARED, Score, all_gained, gained, score
from gimbal_pin.diagnosis.shapes import free, measure, otherwise, refined, same
from gimbal_pin.diagnosis.state import State, solved, width
from gimbal_pin.effects import Cause, Effect, RigEffect, Sample, Signal
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array

ENTER = 1e-4
"""A candidate whose own p is above this does not enter."""
WORTH = 1e-2
"""The same on the coarse grid, before its shape parameters are refined."""
MOST = 8
"""Most causes that are composed."""
CLOSE = 0.2
"""Share of the best gain below which a candidate is no contender on the coarse grid."""
PENALTY = 4.0
"""Gain that a free parameter makes by luck."""
HUSHED = 1.5
"""Gain of a drive's signal over what it takes off the unexplained torque, under which it does only that."""
GENUINE = 0.5
"""Share of such a gain that must be left where it acts on the model's torque in place of the measured one."""
MOST_CAPPED = 0.5
"""Share of the samples at which a drive's limit bites, from which little more than the commands' signs is left."""
NEARLY_ALL = 0.98
"""The same of what a threshold passes, from which nothing else is left: under it a limit lets none act by its size."""
SLIGHT = 0.01
"""Share of the largest torque under which none is passed."""
SWUNG = 20.0
"""What all but the joint's own acceleration leaves of those over what the whole model leaves, from which its motion
follows them: a sine, as any motion has, leaves a fifth of a square wave of its phase."""
LIGHTER = 0.5
"""Share of the given rig's torque by which the fitted one's may be another, if so much less acts than is commanded."""
OUTBENT = 0.5
"""Share of a joint's dry friction by which more of it may bend: bristles of another form than these take so much."""
BESIDE = 30.0
"""Harmonics on either side, beyond those that the travel does not part from one, that it must stand out from."""
FEWEST = 20
"""Fewest of them by which it is judged."""
LINE = 5.0
"""Gain of a harmonic over the median of those from which it is a line."""
UNEVEN = 5.0
"""Torque per current at one angle over that at another from which it is no motor's: a ripple of two thirds."""
UNLIKE = 0.5
"""Cosine under which two harmonics are functions of their own on a log."""


def ranked(state: State, columns: Sequence[Columns]) -> list[tuple[float, Columns]]:
    """Gains on the coarse grid, the largest first; only those above zero."""
    rows = [(found.gain, one) for found, one in zip(all_gained(state.fit, columns, False), columns)]
    return sorted((row for row in rows if row[0] > 0), key=lambda row: -row[0])


def contenders(state: State, shelf: Library, place: str | None = None) -> list[tuple[Score, Cause]]:
    """The best of each cause, refined, the largest net gain first: what fits the residual of this state.

    Args:
        state: The state.
        shelf: The library.
        place: Only causes at this joint and of the whole rig; None: of any joint, that of the best candidate.
    """
    rows = lines(state, ranked(state, untaken(state, shelf.columns(state, place))))
    first: dict[tuple[str, str], Cause] = {}
    for gain, one in rows:
        key = (one.cause.name, one.cause.place)
        if gain > CLOSE * rows[0][0] and key not in first and score(state.fit, one, False).p < WORTH:
            first[key] = whole(state, [other for _, other in rows], one.cause)
    best = [refined(state, cause) for cause in list(first.values())[:MOST]]
    again = [best_form(state, cause) for cause in best]
    passed = [row for row in again if row[0].p < ENTER and net(*row) > 0 and possible(state, *row)]
    return sorted(passed, key=lambda row: -net(*row))


def untaken(state: State, columns: Sequence[Columns]) -> list[Columns]:
    """Leave out what cannot enter: a second cause of one kind at one place, unless it is a harmonic or of the rig."""
    taken = {(c.name, c.place) for c in state.causes if not isinstance(c, (Harmonic, RigEffect))}
    return [one for one in columns if (one.cause.name, one.cause.place) not in taken]


def best_form(state: State, cause: Cause) -> tuple[Score, Cause]:
    """Score a cause, or its other form that fits better where it has been found."""
    rows = [(measure(state, one), one) for one in (cause, *otherwise(state, cause))]
    return max(rows, key=lambda row: net(*row))


def lines(state: State, rows: Sequence[tuple[float, Columns]]) -> list[tuple[float, Columns]]:
    """Leave out harmonics that gain no more than those beside them: a part of what no harmonic explains, and no line.

    What is left of a cause that the library lacks is spread over all harmonics, and some of them gain most. Over whole
    turns it is not: each harmonic is then a function of its own. A joint that moves in small strokes, as by a chirp,
    parts fewer of them than its travel would: the first of all gains is then compared with what is unlike it.
    """
    evidence = state.problem.evidence
    travels = dict(zip(evidence.rig.joints, (seen.travel for seen in evidence.seen)))
    alike: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for gain, one in rows:
        if isinstance(one.cause, Harmonic):
            alike.setdefault((one.cause.name, one.cause.place), []).append((one.cause.harmonic[0], gain))
    combs = {key: np.array(comb).T for key, comb in alike.items()}

    def stands_out(gain: float, cause: Cause) -> bool:
        if not isinstance(cause, Harmonic) or travels[cause.joint] > 2 * np.pi:
            return True
        harmonics, gains = combs[cause.name, cause.place]
        apart, unparted = np.abs(harmonics - cause.harmonic[0]), 2 * np.pi / travels[cause.joint]
        beside = gains[(apart > unparted) & (apart < unparted + BESIDE)]
        return len(beside) < FEWEST or gain > LINE * float(np.median(beside))

    out = [stands_out(gain, one.cause) for gain, one in rows]
    if rows and not out[0]:
        out[0] = explains_others(state, rows[0], rows)
    return [row for row, stands in zip(rows, out) if stands]


def explains_others(state: State, row: tuple[float, Columns], rows: Sequence[tuple[float, Columns]]) -> bool:
    """Whether the harmonics that are unlike one gain little more than what they have in common with it.

    Of what one harmonic explains, with a gain G, another takes up ``G cos²`` of the angle between them.
    """
    gain, one = row
    others = [(x, other) for x, other in rows if other is not one and same(other.cause, one.cause)]
    near = nearness(state.fit, span(state.fit, one), [other for _, other in others])
    apart = np.array([harmonic(other.cause) - harmonic(one.cause) for _, other in others])
    beyond = np.array([x for x, _ in others]) - gain * near**2
    unlike = [side * apart[(near < UNLIKE) & (side * apart > 0)] for side in (-1, 1)]
    first = [float(np.min(side, initial=np.inf)) for side in unlike]
    beside = (near < UNLIKE) & (np.abs(apart) < np.where(apart < 0, *first) + BESIDE)
    return bool(np.sum(beside) >= FEWEST and gain > LINE * float(np.median(np.maximum(beyond[beside], 0.0))))


def harmonic(cause: Cause) -> float:
    """Which multiple of the angle a cause turns with; its first."""
    return cause.harmonic[0] if isinstance(cause, Harmonic) else 0.0


def whole(state: State, columns: Sequence[Columns], cause: Cause) -> Cause:
    """Return the cause, or that of its grid which gains most with coefficient one: what clips part of it does not."""
    if not isinstance(cause, Signal) or cause.linear:
        return cause
    alike = [one for one in columns if same(one.cause, cause)]
    rows = [(found.gain, one.cause) for found, one in zip(all_gained(state.fit, alike, True), alike)]
    gain, best = max(rows, key=lambda row: row[0])
    return best if gain > 0 else cause


def possible(state: State, found: Score, cause: Cause) -> bool:
    """Whether what a cause would do is what such a cause can do."""
    tests = (hushes, signs_only, holds_fast, drives, outbends, falls, strays, swells)
    return not any(test(state, found, cause) for test in tests)


def holds_fast(state: State, found: Score, cause: Cause) -> bool:
    """Whether dry friction would hold the joint against more than the largest torque of the logs: it never moved.

    What varies with the angle does so together with the rest of it, where the joint has been.
    """
    if not isinstance(cause, Effect) or not cause.dry or not len(found.beta):
        return False
    evidence = state.problem.evidence
    j = evidence.rig.joint_index(cause.joint)
    rows = [(cause, found.beta)]
    at = Sample(0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    if isinstance(cause, Harmonic):
        plain = [effect for effect in state.problem.friction if effect.dry]
        rows = [row for row in brakes(state, found, cause) if row[0] in plain or isinstance(row[0], Harmonic)]
        at = at._replace(q=np.concatenate([part.channels.q[:, j] for part in evidence.parts]))
    held = sum(x * np.asarray(y) for effect, beta in rows for x, y in zip(beta, effect.basis(at)))
    return bool(np.max(np.abs(held)) > evidence.seen[j].peak)


def outbends(state: State, found: Score, cause: Cause) -> bool:
    """Whether more friction would bend than there is: what is left of Coulomb friction would push."""
    if not isinstance(cause, Effect) or not cause.bristly or not len(found.beta):
        return False
    at = len(state.problem.reduction.independent)
    here = [at + k for k, effect in enumerate(state.problem.friction) if effect.joint == cause.joint and effect.dry]
    rest = float(np.sum(refitted_beside(state, found, cause)[here]))
    return rest < -OUTBENT * (rest + float(found.beta[0]))


def falls(state: State, found: Score, cause: Cause) -> bool:
    """Whether friction that grows faster than the rate stands on viscous friction that would push, all else refitted.

    Friction that falls with the rate before it grows is Stribeck's, whatever makes up for the fall.
    """
    if not isinstance(cause, Effect) or not cause.rising or not len(found.beta):
        return False
    effects, at = state.problem.friction, len(state.problem.reduction.independent)
    theta = refitted_beside(state, found, cause)[at:]
    evidence, j = state.problem.evidence, state.problem.evidence.rig.joint_index(cause.joint)
    own = np.concatenate(plain_columns(evidence, cause, state.load)) @ found.beta
    rate = np.concatenate([part.channels.v[:, j] for part in evidence.parts])
    viscous = [x for one, x in zip(effects, theta) if not one.dry and one.joint == cause.joint]
    return bool(viscous[0] * np.linalg.norm(rate) < -PUSHED * np.linalg.norm(own))


def swells(state: State, found: Score, cause: Cause) -> bool:
    """Whether a motor's torque per current, ``1 - s(q)`` for a ripple s, differs by more over a log than any motor's.

    Harmonics over less than a turn hold a constant, which a rig of one joint does not show: what counts is the ratio.
    """
    if not isinstance(cause, Harmonic) or not cause.loaded or not len(found.beta):
        return False
    evidence = state.problem.evidence
    j = evidence.rig.joint_index(cause.joint)
    q = np.concatenate([part.channels.q[:, j] for part in evidence.parts])
    per = 1.0 - np.stack(cause.basis(Sample(0.0, q, 0.0, 0.0, 0.0, 1.0)), axis=1) @ found.beta
    return bool(np.max(per) > UNEVEN * np.min(per))


def drives(state: State, found: Score, cause: Cause) -> bool:
    """Whether dry friction at the cause's joint would have to push, all else refitted."""
    if not isinstance(cause, Effect) or not cause.dry or not len(found.beta):
        return False
    return pushes(state.problem.evidence, brakes(state, found, cause), state.load)


def brakes(state: State, found: Score, cause: Effect) -> list[tuple[Effect, Array]]:
    """All friction at the cause's joint with its coefficients, all refitted beside the cause, which comes last."""
    theta = refitted_beside(state, found, cause)
    effects = [*state.problem.friction, *(c for c in state.causes if not isinstance(c, Signal))]
    ends = np.cumsum([len(state.problem.reduction.independent), *map(width, effects)])
    always = len(state.problem.friction)
    dry = next(one for one in state.problem.friction if one.dry and one.joint == cause.joint)
    others = [
        slid(effect, theta[begin:end], dry)
        for k, (effect, begin, end) in enumerate(zip(effects, ends, ends[1:]))
        if isinstance(effect, Effect) and effect.joint == cause.joint and (k < always or resists(effect))
    ]
    return [*others, (cause, found.beta)]


def resists(effect: Effect) -> bool:
    """Whether an effect is friction of any kind."""
    return effect.dry or effect.bristly or effect.rising


def slid(effect: Effect, values: Array, dry: Effect) -> tuple[Effect, Array]:
    """An effect with its coefficients; of bristles what they hold once they slide, which is `dry` friction.

    While they unbend they push, as they may.
    """
    return (dry, values[:1]) if effect.bristly else (effect, values)


def strays(state: State, found: Score, cause: Cause) -> bool:
    """Whether what changes with time does not tell whole stretches of time from the others.

    What changes with the motion may have looked like it, where the motion was another early than late.
    """
    if not isinstance(cause, Effect) or not cause.lasting or not len(found.beta):
        return False
    return not improves(state.fit, state.columns(cause), False, whole=True)


def refitted_beside(state: State, found: Score, cause: Cause) -> Array:
    """Coefficients of all else once a cause is in, (k,)."""
    added = state.fit.stacked(state.columns(cause).values) @ found.beta
    return np.asarray(state.fit.theta - state.fit.information @ (state.fit.stack.T @ added))


def hushes(state: State, found: Score, cause: Cause) -> bool:
    """Whether a drive's signal gains by taking away what nobody explains: it does that to any torque, a noise too.

    What a signal truly is leaves next to nothing of what it passes on of the unexplained, however much it takes off.
    Where less is unexplained than the sensors' noise, noise is all that it could take away, by a limit or a gap, too,
    unless it gains as much by what it takes from the model's torque, which has none. What adds to the torque what its
    model says takes nothing away.
    """
    if not isinstance(cause, Signal) or cause.springy:
        return False
    evidence, j = state.problem.evidence, state.problem.evidence.rig.joint_index(cause.joint)
    left = [x[:, j] for x in state.unexplained]
    loud, noise = float(np.sum(evidence.whiten(left, j) ** 2)), evidence.rows * float(evidence.used()[j])
    if not cause.linear:
        return loud < noise and on_model(state, cause) < GENUINE * found.gain
    if loud < LUCK * noise:
        return True
    hushed = float(np.sum(evidence.whiten([cause.acting(x, p.dt) for x, p in zip(left, evidence.parts)], j) ** 2))
    gain = found.gain / float(state.fit.scale[j]) ** 2
    return gain < HUSHED * (loud - hushed) and loud - gain > CLEARED * hushed


def signs_only(state: State, found: Score, cause: Cause) -> bool:
    """Whether a drive's limit leaves but the signs of the commands, as friction or lighter bodies explain of any.

    Of commands of one sign it leaves a constant, as a weight that is held asks for. Where the limit is one the joint's
    acceleration is as large as it says for the rig's own masses: what the joint bears at rest, and all else that was
    found, is not enough.
    """
    if not isinstance(cause, Signal):
        return False
    evidence, now = state.problem.evidence, state.fit
    j = evidence.rig.joint_index(cause.place)
    given_to = np.concatenate([x[:, j] for x in state.acting])
    # Where a threshold passes nothing no limit bites.
    passes = np.abs(given_to) > SLIGHT * np.max(np.abs(given_to), initial=0.0)
    capped = np.mean(cause.biting(given_to)[passes]) if np.any(passes) else 0.0
    if capped <= MOST_CAPPED or capped > NEARLY_ALL > np.mean(passes):
        return bool(capped > MOST_CAPPED)
    after = solved(state.problem, (*state.causes, cause), state, keep=True)
    given = given_beta(evidence.rig, state.problem.reduction)
    rows, at = now.rows(j), len(given)
    weights = evidence.whiten([x[:, j, state.problem.felt[j]] for x in state.problem.resting], j)
    A, b = np.column_stack([after.fit.stack[rows][:, at:], weights]), after.fit.target[rows]
    alone, left = b - A @ np.linalg.lstsq(A, b, rcond=1e-10)[0], after.fit.residual[rows]
    rigid = now.stack[rows][:, :at]
    off, asked = rigid @ (after.fit.theta[:at] - given), rigid @ given
    return bool(alone @ alone < SWUNG * (left @ left) or off @ off > LIGHTER**2 * (asked @ asked))


def on_model(state: State, cause: Signal) -> float:
    """Gain of a drive's signal by what it takes from the torque that the model asks for, in place of the measured."""
    asked: list[Array] = [x - y for x, y in zip(state.acting, state.unexplained)]
    bearing = state.bearing_for(cause, asked)
    columns = build(state.problem.evidence, cause, Stand(state.rig), state.load, asked, bearing)
    return gained(state.fit, columns, fixed=True).gain


def net(found: Score, cause: Cause) -> float:
    """Gain less what as many free parameters gain by luck."""
    return found.gain - PENALTY * free(cause)
