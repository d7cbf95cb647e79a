"""The motion that parts what a diagnosis leaves ambiguous: a search over Fourier series under the rig's limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from gimbal_pin.diagnosis.contest import Contest, contest, imagined
from gimbal_pin.diagnosis.diagnose import BAND
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.finding import Diagnosis, Finding
from gimbal_pin.diagnosis.parting import IDENTICAL, Apart, NextExperiment, Parting
from gimbal_pin.diagnosis.state import Problem, State
from gimbal_pin.effects import CAUSES, Cause, Signal
from gimbal_pin.excitation.clearance import Clearance
from gimbal_pin.excitation.columns import Columns
from gimbal_pin.excitation.criteria import Determinant
from gimbal_pin.excitation.design import CLEARANCE, cleared
from gimbal_pin.excitation.fourier import Series
from gimbal_pin.excitation.limits import Envelope
from gimbal_pin.excitation.problem import Problem as Limits
from gimbal_pin.log import Array, Motion
from gimbal_pin.model import Model
from gimbal_pin.threads import one_thread

SECONDS = 20.0
"""Length of the next experiment, s."""
SERIES = ((1, 8), (2, 8), (4, 12), (8, 12))
"""How often a motion repeats in that time, and its harmonics: from slow sweeps of the whole travel to 5 Hz, which the
loop must follow."""
USED = 0.3
"""Share of a joint's samples that should lie away from standstill: what is left of fewer says too little."""
TRIES = 120
"""Motions that are tried: half of them at random, the others as changes of the best."""
FOLLOWED = 2
"""How many of the random motions are followed up."""
MARGIN = 0.05
"""Share of every limit that is left free."""
COARSE = 12
"""Samples per period of the highest harmonic on which torque limits are kept while searching."""
SPARSE = 2
"""How much longer the interval may be at which motions are compared than that at which they are judged."""
BISECTIONS = 7
KICK, WIDER, NARROWER = 0.3, 1.3, 0.9
"""Size of a change as a share of the motion, and what becomes of it after one that was better, or was not."""


class Tried(NamedTuple):
    """A motion that was tried.

    Attributes:
        limits: The series, and the rig's limits on it.
        x: Its free coefficients.
        apart: What it parts with the logs so far, contest by contest.
        alone: What it parts by itself: long logs that part little leave two causes as alike as they are on them.
        used: Share of the samples that count, of the joint where that is least.
    """

    limits: Limits
    x: Array
    apart: tuple[Apart, ...]
    alone: tuple[Apart, ...]
    used: float

    @property
    def value(self) -> float:
        """Sum of each contest's worth: what is parted already gains little more, what is hopeless nothing."""
        return min(self.used / USED, 1.0) * max(sum(each.worth for each in way) for way in (self.apart, self.alone))


@dataclass(frozen=True, eq=False)
class Bench:
    """Where motions are tried in thought.

    Attributes:
        state: What was found.
        contests: Findings against rivals.
        model: The extended model, which predicts the torque.
        seconds: Length of a motion, s.
        tries: How many are tried.
    """

    state: State
    contests: tuple[Contest, ...]
    model: Model
    seconds: float
    tries: int

    def apart(self, motion: Motion) -> tuple[tuple[Apart, ...], tuple[Apart, ...], float]:
        """What a motion would part with the logs so far, what alone, and what share of it counts."""
        problem, torque = self.on(motion)
        used = problem.evidence.used()[[problem.evidence.rig.joint_index(joint) for joint in self.joints]]
        rows = list(self.rows(problem, torque))
        beside, alone = (tuple(each.expected(*row, way) for each, row in rows) for way in (False, True))
        return beside, alone, float(used.min())

    def closest(self, motion: Motion) -> tuple[list[tuple[Contest, Apart]], bool]:
        """The contests with the rivals' shapes where they imitate best, and what a motion then would part.

        With the logs so far, or, where it names more so, alone; and whether that is the case.
        """
        rows = list(self.rows(*self.on(motion)))
        ways = []
        for way in (False, True):
            found = [(each.closest(*row, way), row) for each, row in rows]
            ways.append([(each, each.expected(*row, way)) for each, row in found])
        beside, alone = (sum(apart.named for _, apart in way) for way in ways)
        return ways[alone > beside], alone > beside

    def on(self, motion: Motion) -> tuple[Problem, Array]:
        """A motion's columns, and its torque, N m, (m, n)."""
        known = self.state.problem.evidence
        evidence, torque = imagined(known, motion, self.model, replace(BAND, cutoff=known.band))
        return Problem.of(evidence, self.state.problem.reduction), torque

    def rows(self, problem: Problem, torque: Array) -> Iterator[tuple[Contest, tuple[State, Array]]]:
        """Yield every contest with its state on a motion and what is common to all of its finding."""
        common = dict[Cause, Array]()
        for each in self.contests:
            state = each.on(problem, torque)
            if each.cause not in common:
                common[each.cause] = each.common(state)
            yield each, (state, common[each.cause])

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints whose torque is to tell."""
        places = {each.cause.place for each in self.contests if each.cause.of_joint}
        every = self.state.problem.evidence.rig.joints
        return tuple(joint for joint in every if not places or joint in places)

    def tried(self, limits: Limits, x: Array) -> Tried:
        """Try a motion."""
        return Tried(limits, x, *self.apart(self.motion(limits, x, self.coarse)))

    @property
    def fine(self) -> float:
        """Interval at which logs like these are judged, s."""
        return self.state.problem.evidence.parts[0].dt

    @property
    def coarse(self) -> float:
        """Interval that is enough while searching, s: what a drive does to a signal takes the fine one."""
        signals = any(isinstance(one, Signal) for each in self.contests for one in (each.cause, *each.forms))
        return self.fine if signals else SPARSE * self.fine

    def motion(self, limits: Limits, x: Array, dt: float) -> Motion:
        """The motion over and over for as long as the experiment lasts, sampled every `dt` s."""
        t = dt * np.arange(round(self.seconds / dt) + 1)
        return limits.series.motion(limits.coefficients(x), t)


@one_thread()
def next_experiment(
    found: Diagnosis,
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    rng: np.random.Generator,
    seconds: float = SECONDS,
    tries: int = TRIES,
    dt: float = 1e-3,
) -> NextExperiment | None:
    """Design the motion that parts what a diagnosis leaves ambiguous: maximise the expected separation of the rivals.

    ``|f - best explanation by rival, rigid model and friction| / noise``, f the finding's fitted torque, over the logs
    so far and the motion. Random Fourier series within the rig's limits, slow and fast, then random changes of the
    best; interrupted (Ctrl-C), it returns the best so far.

    Args:
        found: The diagnosis.
        causes: The causes that it knew.
        rng: Source of the motions.
        seconds: Length of the motion, s.
        tries: Motions that are tried, some 20 a second.
        dt: Sampling interval of the returned motion, s.

    Returns:
        The motion with what it is expected to part; None where nothing is ambiguous.

    Raises:
        UsageError: The rig cannot move within its limits.
    """
    if found.state is None:
        return None
    pairs = list(contests(found.state, found.findings, causes))
    if not pairs:
        return None
    model = extended(found.state).model
    bench = Bench(found.state, tuple(each for _, each in pairs), model, seconds, tries)
    best, possible, finished = searched(bench, rng)
    partable = [largest.share > IDENTICAL for largest in possible]
    motion, alone, after = None, False, list(zip(bench.contests, possible))
    if any(partable):
        repaired = best.limits.repaired(best.x)
        if repaired is None:
            raise best.limits.infeasible()
        repaired = cleared(best.limits, repaired)[0]
        motion = bench.motion(best.limits, repaired, dt)
        after, alone = bench.closest(bench.motion(best.limits, repaired, bench.fine))
    partings = [parting(f, c, a if ok else None, alone, causes) for (f, _), (c, a), ok in zip(pairs, after, partable)]
    return NextExperiment(found.state.problem.evidence.rig.joints, motion, tuple(partings), finished)


def planned(found: Diagnosis, causes: Mapping[str, type[Cause]] = CAUSES, *, rng: np.random.Generator) -> Diagnosis:
    """Return the diagnosis with its `next_experiment`."""
    return replace(found, planned=next_experiment(found, causes, rng=rng))


def contests(
    state: State, findings: Sequence[Finding], causes: Mapping[str, type[Cause]]
) -> Iterator[tuple[Finding, Contest]]:
    """Yield every ambiguous finding with each of its rivals."""
    for finding in findings:
        mine = [c for c in state.causes if c.name == finding.cause and finding.joint in (None, c.place)]
        for rival in finding.alike[1:] if mine else ():
            each = contest(state, mine[0], rival, causes)
            if each is not None:
                yield finding, each


def searched(bench: Bench, rng: np.random.Generator) -> tuple[Tried, tuple[Apart, ...], bool]:
    """Return the best motion found, the largest share that any one reached in each contest, and whether all ran."""
    every: list[Tried] = []
    try:
        bar = tqdm(total=bench.tries, desc="next experiment", unit="motion", disable=None, leave=False)
        with bar:
            for one in walk(bench, rng, every):
                every.append(one)
                bar.update()
        finished = True
    except KeyboardInterrupt:
        if not every:
            raise
        finished = False
    found = zip(*(way for one in every for way in (one.apart, one.alone)))
    possible = tuple(max(column, key=lambda apart: apart.share) for column in found)
    return max(every, key=lambda one: one.value), possible, finished


def walk(bench: Bench, rng: np.random.Generator, every: Sequence[Tried]) -> Iterator[Tried]:
    """Yield random motions of every series in turn, then random changes of the best of them."""
    rig = bench.state.problem.evidence.rig
    envelope, columns = Envelope.of(rig, MARGIN), Columns.of(rig)
    apart = Clearance.of(rig, CLEARANCE, envelope)
    series = [Series(bench.seconds / times, harmonics) for times, harmonics in SERIES]
    family = [Limits(bench.model, each, columns, Determinant(), envelope, COARSE, apart) for each in series]
    for k in range((bench.tries + 1) // 2):
        yield bench.tried(family[k % len(family)], drawn(family[k % len(family)], rng))
    for start in sorted(every, key=lambda one: -one.value)[:FOLLOWED]:
        yield from climbed(bench, start, rng)


def climbed(bench: Bench, best: Tried, rng: np.random.Generator) -> Iterator[Tried]:
    """Yield random changes of a motion, each of the best so far (a (1+1) evolution strategy)."""
    kick = KICK
    for _ in range(bench.tries // (2 * FOLLOWED)):
        change = kick * np.sqrt(np.mean(best.x**2)) * rng.standard_normal(len(best.x))
        x = kept(best.limits, best.x + change * (rng.random(len(best.x)) < rng.uniform(0.1, 1.0)))
        now = best if x is None else bench.tried(best.limits, x)
        better = now.value > best.value
        best, kick = (now, kick * WIDER) if better else (best, kick * NARROWER)
        yield now


def drawn(limits: Limits, rng: np.random.Generator) -> Array:
    """A random motion within the limits: each joint of a colour, amplitude and middle of its own.

    Raises:
        UsageError: The motors can hold the rig nowhere.
    """
    series, n = limits.series, limits.model.rig.n
    for _ in range(100):
        coefficients = rng.standard_normal((2 * series.harmonics + 1, n))
        colour = np.tile(series.order, 2)[:, None] ** -rng.uniform(-0.5, 2.0, n)
        coefficients[1:] *= colour
        middle = rng.choice([0.0, 1.0]) * rng.uniform(-0.5, 0.5, n)
        coefficients[0] = limits.envelope.centre + middle * limits.envelope.half
        x = (series.rest.T @ coefficients).ravel()
        size = np.exp(np.minimum(rng.uniform(-2.5, 1.0, n), 0.0))
        found = kept(limits, limits.scaled(x, limits.widest(x, middle) * size))
        if found is not None:
            return found
    raise limits.infeasible()


def kept(limits: Limits, x: Array) -> Array | None:
    """X scaled down to the limits, torques and distances on a coarse grid; None where that leaves no motion."""
    pose = limits.coefficients(x)[0]
    middle = (pose - limits.envelope.centre) / limits.envelope.half
    if not np.abs(middle).max() < 1 or not limits.possible(pose):
        return None
    x = limits.scaled(x, np.minimum(limits.widest(x, middle), 1.0))
    if fits(limits, x):
        return x
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        factor = (low + high) / 2
        low, high = (factor, high) if fits(limits, limits.scaled(x, factor)) else (low, factor)
    return limits.scaled(x, low) if low > 0 else None


def fits(limits: Limits, x: Array) -> bool:
    """Whether the motors can drive a motion and nothing hits anything, on the coarse grid."""
    motion = limits.motion(x, limits.coarse)
    if limits.driven.any() and limits.envelope.torques(limits.model, motion).max() > 1:
        return False
    return limits.apart is None or bool(limits.apart.room(motion.q).min() >= 0)


def parting(
    finding: Finding, each: Contest, after: Apart | None, alone: bool, causes: Mapping[str, type[Cause]]
) -> Parting:
    """Describe a contest, with the rival's shape that imitates best with the next experiment: so far it did, too."""
    instead = (each.cause.experiment, causes[each.rival].experiment)
    return Parting(finding.cause, finding.joint, each.rival, each.now, after, instead, alone)
