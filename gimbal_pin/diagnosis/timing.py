"""How late a drive must be to be found, in the band that was looked at and in a wider one; and what else shows there.

A delay shows in what is fast: ``x(t) - x(t - d) ≈ d dx/dt``; a joint that gives where it rings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, log, sqrt
from typing import TypeGuard

import numpy as np

from gimbal_pin.diagnosis.columns import ALIKE
from gimbal_pin.diagnosis.contenders import possible
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.fit import LUCK, project
from gimbal_pin.diagnosis.flips import least
from gimbal_pin.diagnosis.lateness import Late, Timing
from gimbal_pin.diagnosis.leftover import MUCH, place
from gimbal_pin.diagnosis.score import HIDDEN, visibility
from gimbal_pin.diagnosis.shapes import measure, refined
from gimbal_pin.diagnosis.state import Problem, State, reads, solved
from gimbal_pin.diagnosis.verdict import FAINT, SHARE, material, torque_level
from gimbal_pin.effects import Cause, Signal
from gimbal_pin.log import Log
from gimbal_pin.rows import FINE, Filtering

WIDER = 2.5
"""A wider band over the one that was looked at."""
LEAST = 1.5
"""The same under which it shows little more."""
BETTER = 0.5
"""Delay that would be found there over the one that would be found here from which it is worth telling."""
AGREES = 0.1
"""Share of a delay by which two bands may differ on it."""


def timing(
    state: State,
    logs: Sequence[Log],
    filtering: Filtering,
    origins: Mapping[str, float],
    delays: Sequence[Signal],
    limit: float,
    quiet: Sequence[str],
    rng: np.random.Generator,
) -> Timing | None:
    """What a wider band of the same logs would show; None where nothing that is worth telling.

    Args:
        state: What was found.
        logs: The logs that it was found in.
        filtering: As they were filtered.
        origins: As for `gather`.
        delays: Those that were tried, at every joint.
        limit: Chance from which nothing is named.
        quiet: Joints at which noise is left in this band.
        rng: For the signs of blocks.
    """
    cutoff = wider(logs, filtering)
    if cutoff < LEAST * filtering.cutoff or not delays:
        return None
    evidence = gather(state.problem.evidence.rig, logs, replace(filtering, cutoff=cutoff), origins)
    causes, problem = [c for c in state.causes if not timely(c)], Problem.of(evidence, state.problem.reduction)
    there = solved(problem, causes, solved(problem, ()) if any(map(reads, causes)) else None)
    here = solved(state.problem, causes, state) if len(causes) < len(state.causes) else state
    each = {joint: [one for one in delays if one.place == joint] for joint in evidence.rig.joints}
    both = {joint: (late(here, tried, limit), late(there, tried, limit)) for joint, tried in each.items() if tried}
    sample = max(log.dt for log in logs)
    worth = {joint: row for joint, row in both.items() if worth_telling(*row, sample)}
    late_ = {joint for joint, (_, there_) in worth.items() if there_.shown}
    more = tuple(joint for joint in quiet if joint not in late_ and louder(state, there, joint, rng))
    return Timing(cutoff, worth, more) if worth or more else None


def louder(state: State, there: State, joint: str, rng: np.random.Generator) -> bool:
    """Whether the wider band leaves a joint much, and more than noise, with all that was found.

    Little may be the sensors' noise itself, whose floor is known less well the faster it is. `there`: the state in the
    wider band without what is late.
    """
    j = state.problem.evidence.rig.joint_index(joint)
    if not there.problem.evidence.used()[j]:  # so short that a gate of the wider band's taper never opens
        return False
    whole = there if there.causes == state.causes else solved(there.problem, state.causes, there)
    return bool(whole.fit.dispersion[j] > MUCH and place(whole, j, rng))


def worth_telling(here: Late, there: Late, sample: float) -> bool:
    """Whether a wider band shows another delay than this one, or would show much less of one than this.

    One that is shorter than a sample, s, no loop feels.
    """
    if here.shown:
        return there.shown > 0 and abs(there.shown - here.shown) > AGREES * here.shown
    return there.shown > 0 or (here.least > sample and there.least < BETTER * here.least)


def wider(logs: Sequence[Log], filtering: Filtering) -> float:
    """The wider band, whole Hz, as far as the samples and the grid of the smoothed channels go."""
    samples = min(0.2 / log.dt for log in logs)
    return float(np.floor(min(WIDER * filtering.cutoff, samples, 0.45 * FINE / filtering.smoothing) + 1e-9))


def wanders(cause: Cause) -> TypeGuard[Signal]:
    """Whether a cause passes on the command of some time ago."""
    return isinstance(cause, Signal) and cause.wanders


def timely(cause: Cause) -> bool:
    """Whether a cause passes on a command later."""
    return isinstance(cause, Signal) and cause.linear and not cause.springy


def late(state: State, delays: Sequence[Signal], limit: float) -> Late:
    """The least delay that passes all that a search asks of one, to first order, and whether one does.

    It must be sure beyond chance, matter, be near one that is tried, and leave at least `LUCK` of the sensors' noise
    beside what else is left: what fits better without it is no evidence of any.
    """
    evidence, fit = state.problem.evidence, state.fit
    j, n, dt = evidence.rig.joint_index(delays[0].place), evidence.rig.n, evidence.parts[0].dt
    first = min(delays, key=lambda one: one.late(dt))
    columns = state.columns(first)
    if visibility(fit, [columns])[0] < HIDDEN:
        return Late(inf)
    slope = project(fit, columns)[:, 0] / first.late(dt)
    power = float(slope @ slope)
    best = max(float(slope @ fit.residual) / power, 0.0)
    left, own = ((x / fit.scale[j])[j::n] for x in (fit.residual - best * slope, slope))
    rows = evidence.rows * float(evidence.used()[j])
    sure = sqrt(float(least(np.array(limit), 1, float(fit.blocks))) / power)
    loud = sqrt(max(LUCK * rows - float(left @ left), 0.0) / float(own @ own))
    matters = max(SHARE * torque(state, j), FAINT * max(1.0, 1.0 / fit.scale[j])) * sqrt(rows / float(own @ own))
    found = Late(max(sure, loud, matters, ALIKE[0] * first.late(dt)))
    start = min(delays, key=lambda one: abs(log(one.late(dt) / max(best, 1e-12))))
    return found._replace(shown=shown(state, start, limit)) if best > found.least else found


def torque(state: State, joint: int) -> float:
    """A joint's torque, rms, in units of its noise floor."""
    return float(torque_level(state)[joint]) / state.problem.evidence.noise_floor(joint)


def shown(state: State, start: Signal, limit: float) -> float:
    """The delay that is there, s, or 0; `start`: the one of those tried that is nearest to it."""
    cause = refined(state, start)
    found = measure(state, cause)
    real = found.p < limit and material(state, found) and possible(state, found, cause)
    return cause.late(state.problem.evidence.parts[0].dt) if real and isinstance(cause, Signal) else 0.0
