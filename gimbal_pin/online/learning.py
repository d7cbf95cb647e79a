"""Rows in, what is known out, with the payload watched: the part of the online estimator that knows no filter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gimbal_pin.identification import find_unseen
from gimbal_pin.log.log import Array
from gimbal_pin.online.causal import Row
from gimbal_pin.online.change import ALIKE, LONGER, LOOK, WINDOWS, Score, Watch, onset, scores, scores_without_transient
from gimbal_pin.regression import Estimate, Known, Moments, Prior, loosen_prior, solve_recursive
from gimbal_pin.rig.brief import brief

WINDOW = LOOK + 5
"""Newest rows that are not learned for good yet while nothing seems to have changed."""
HELD = 2 * max(WINDOWS) + LONGER
"""The same while something does: those that the slowest alarm can be about."""
PLAIN = 15.0
"""Times beyond chance that a score without any few rows is if a payload was swapped; what a model's form leaves out
near standstill for a second or two (Stribeck of more than half the friction) reaches five."""
DOUBT = 0.2
"""Share of friction by which it may be off without anything having changed."""
REFRESHED = 8
"""Rows after which the reference of the innovations is solved anew."""
TRIED = 64
"""Rows (8 s at 4 Hz) after which the noise is known; an alarm before takes a score that few rows' noise cannot make."""
REMEMBERED = 480.0
"""Looks over which the dispersion of the score is averaged."""


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        t: When it was noticed, s of the log.
        what: "changed" or "known".
        since: When it began, s of the log.
        sentence: The same for a person.
    """

    t: float
    what: str
    since: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Task:
    """Constants of an online estimate.

    Attributes:
        names: Names of the parameters.
        directions: How a change of the payload moves them, (k, r).
        doubt: By what share each may be off without a change, (k,).
        everything: Whether a change lets all of them loose, not those of the payload alone.
        fading: Time constant of forgetting, s of a joint's motion; infinite: none.
        step: Time from row to row, s.
        transition: Time after a change in which the filters mix before and after, s.
    """

    names: tuple[str, ...]
    directions: Array
    doubt: Array
    everything: bool
    fading: float
    step: float
    transition: float

    __repr__ = brief

    def faded(self, rows: Array) -> Array | None:
        """Weight that each row leaves those before it, (m, n): only motion makes forget."""
        return None if self.fading == inf else np.exp(-self.step / self.fading * rows[:, :, -1])


@dataclass(frozen=True, eq=False)
class Learned:
    """What is kept of the rows: arrays of fixed sizes, and the events.

    The newest rows stay apart in a window until it is plain that nothing changed: `all_moments` counts them in.

    Attributes:
        settled: Rows before the window, since the last change.
        window: The newest rows.
        prior: What was known at the last change, or beforehand.
        reference: The estimate that the window is compared with; None until everything is known.
        watch: What of it that takes.
        dispersion: Mean of the score over its expectation so far.
        looks: How many scores that is.
        beyond: For how many rows each window's score has been beyond chance.
        predicted: ``Σ x xᵀ``, x = [prediction, b, share] of rows before they were learned, (n, 3, 3).
        count: How many.
        since: Start of what is learned now, s.
        ready: Whether everything was known, once, since then.
        events: What happened.
    """

    settled: Moments
    window: tuple[Row, ...]
    prior: Prior | None
    predicted: Array
    reference: Known | None = None
    watch: Watch | None = None
    dispersion: float = 1.0
    looks: int = 0
    beyond: tuple[int, ...] = (0,) * len(WINDOWS)
    count: int = 0
    since: float = -inf
    ready: bool = False
    events: tuple[Event, ...] = ()

    __repr__ = brief

    @property
    def doubtful(self) -> int:
        """How many of the newest rows seem to be of another payload, until that is announced or passes."""
        rows = max((count + window for count, window in zip(self.beyond, WINDOWS) if count), default=0)
        return min(rows, len(self.window))


def initial(n: int, width: int, prior: Prior | None) -> Learned:
    """Return what is known before the first row."""
    return Learned(Moments.empty(n, width), (), prior, np.zeros((n, 3, 3)))


def learn(task: Task, known: Learned, row: Row, now: float) -> Learned:
    """Take a row in, and see whether it fits.

    Args:
        task: Constants.
        known: Before.
        row: The row.
        now: Time at which it came, s.
    """
    if row.t < known.since:
        return known
    known = with_row(task, predicted(known, row), row)
    reference, watch = known.reference, known.watch
    if reference is None or watch is None:
        return announced(task, known, now)
    rows, few_squares = values(known.window[-LOOK:]), squares(task, known)
    found = scores(rows[-max(WINDOWS) :], watch)
    alarms = [one.alarms(known.dispersion, few_squares) for one in found]
    # Rows at standstill, without freedom, leave the count as it is.
    counts = zip(known.beyond, found, alarms)
    beyond = tuple(before + 1 if alarm else before * (one.freedom == 0) for before, one, alarm in counts)
    known = replace(known, beyond=beyond)
    if any(count >= window + LONGER for count, window in zip(beyond, WINDOWS)):
        return changed(task, known, reference, watch, now)
    # A score that is so far beyond chance even without a push need not last.
    doubted = PLAIN * known.dispersion
    if any(alarms) and any(one.alarms(doubted, few_squares) for one in scores_without_transient(rows, watch)):
        return changed(task, known, reference, watch, now)
    tried = known.settled.rows >= TRIED and not any(alarms)
    return announced(task, with_dispersion(known, found[-1]) if tried else known, now)


def squares(task: Task, known: Learned) -> float:
    """From how many squares the noise is known of the joint that tells least; enough of them count as no end."""
    if known.settled.rows >= TRIED:
        return inf
    count = known.settled.count
    return float((count.min() - len(task.names) / len(count)) / ALIKE)


def values(window: tuple[Row, ...]) -> Array:
    """``[A b share]`` of some rows, (m, n, k + 2)."""
    return np.stack([row.values for row in window])


def predicted(known: Learned, row: Row) -> Learned:
    """Compare a row with what was known before it."""
    if known.reference is None:
        return known
    guess = row.values[:, :-2] @ known.reference.estimate.theta
    line = np.concatenate([guess[:, None], row.values[:, -2:]], axis=1)
    squares = known.predicted + line[:, :, None] * line[:, None, :]
    return replace(known, predicted=squares, count=known.count + 1)


def with_row(task: Task, known: Learned, row: Row) -> Learned:
    """Put a row into the window; the oldest leaves it and is learned for good."""
    window, before = (*known.window, row), known.settled.rows
    leaving = max(0, len(window) - (HELD if known.doubtful else WINDOW))
    if not leaving:
        return replace(known, window=window)
    settled = with_rows_of(task, known.settled, window[:leaving])
    if window[leaving].t - window[leaving - 1].t > 1.5 * task.step:
        settled = settled.break_off()
    known = replace(known, settled=settled, window=window[leaving:])
    if settled.rows // REFRESHED == before // REFRESHED:
        return known
    reference = solved_if_shown(task, settled, known.prior)
    watch = None if reference is None else Watch.of(reference, task.directions, task.doubt)
    return replace(known, reference=reference, watch=watch)


def solved_if_shown(task: Task, moments: Moments, prior: Prior | None) -> Known | None:
    """Solve, if there are rows enough and nothing stays hidden."""
    if too_few(task, moments, prior):
        return None
    known = solve_recursive(moments, prior)
    return None if hidden_parameters(task, moments, known.estimate, prior) else known


def too_few(task: Task, moments: Moments, prior: Prior | None) -> bool:
    """Whether there are fewer rows than three per parameter that is not known beforehand."""
    free = len(task.names) if prior is None else task.directions.shape[1]
    return float(moments.count.sum()) < 3 * free


def hidden_parameters(task: Task, moments: Moments, estimate: Estimate, prior: Prior | None) -> tuple[str, ...]:
    """Return the parameters whose uncertainty alone moves more torque than the rows have."""
    block = moments.to_block()
    names = find_unseen(task.names, [block], estimate)
    if prior is None:
        return names
    # What was known beforehand need not show again.
    at_rest = ~np.any(block.A != 0.0, axis=(0, 1)) & np.isfinite(estimate.std)
    return tuple(name for name in names if not at_rest[task.names.index(name)])


def with_dispersion(known: Learned, newest: Score) -> Learned:
    """Average the score: a model that leaves structure in its residual has larger ones without any change."""
    looks = known.looks + 1
    step = max(1 / looks, 1 / REMEMBERED)
    mean = max(1.0, known.dispersion + step * (newest.mean - known.dispersion))
    return replace(known, looks=looks, dispersion=mean)


def changed(task: Task, known: Learned, reference: Known, watch: Watch, now: float) -> Learned:
    """Announce a change; keep what it leaves known, and start anew behind it.

    Of the rows in the window none is kept: the filters mix what was before and after the change.
    """
    since = known.window[onset(values(known.window), watch, known.dispersion)].t
    resumed = known.window[-1].t + task.transition
    n, columns = known.window[-1].values.shape
    prior = None if task.everything else loosen_prior(reference, task.directions)
    loose = "everything" if task.everything else "its parameters"
    said = f"the payload changed at {since:.1f} s: {loose} are estimated anew"
    event = Event(now, "changed", since, said)
    start = replace(initial(n, columns - 2, prior), since=resumed, events=(*known.events, event))
    return replace(start, dispersion=known.dispersion, looks=known.looks)


def announced(task: Task, known: Learned, now: float) -> Learned:
    """Say when everything is known, the first time since the start or since a change."""
    if known.ready or not known.window or len(known.window) % 2:
        return known
    if answer(task, known) is None:
        return known
    begin = known.since if known.since > -inf else known.window[0].t
    event = Event(now, "known", begin, f"every parameter shows since {now:.1f} s")
    return replace(known, ready=True, events=(*known.events, event))


def all_moments(task: Task, known: Learned) -> Moments:
    """All rows so far since the last change, but for the newest while they seem to be of another payload."""
    return with_rows_of(task, known.settled, known.window[: len(known.window) - known.doubtful])


def with_rows_of(task: Task, moments: Moments, rows: tuple[Row, ...]) -> Moments:
    """Add rows; where two of them are apart, nothing is correlated across."""
    first = 0
    for end in range(1, len(rows) + 1):
        if end == len(rows) or rows[end].t - rows[end - 1].t > 1.5 * task.step:
            some = values(rows[first:end])
            moments = (moments if first == 0 else moments.break_off()).with_rows(some, task.faded(some))
            first = end
    return moments


def answer(task: Task, known: Learned) -> Known | None:
    """Return the estimate from all rows so far; None while they hide something."""
    return solved_if_shown(task, all_moments(task, known), known.prior)
