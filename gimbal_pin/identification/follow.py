"""Identification on the running gimbal: samples in, at any moment the model that `identify` would give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.checks import check_assignment, check_driven, check_sampling
from gimbal_pin.dynamics.model import Model, build_friction_effects
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import Effect
from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.identification.fitting import assemble_result, to_model
from gimbal_pin.identification.identified import Identified
from gimbal_pin.identification.payload_change import payload_directions
from gimbal_pin.identification.payload_swap import (
    LOOK,
    PUSH_ROWS,
    SWAP_WINDOWS,
    Expectation,
    Score,
    compute_scores,
    compute_scores_without_push,
    find_onset,
)
from gimbal_pin.identification.payloads import get_known_parameters
from gimbal_pin.identification.requirements import LEAST_MOVING, find_unseen
from gimbal_pin.identification.validation import measure_accuracy
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    TRUSTED,
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Filtering,
    Method,
    Misfit,
    PastRows,
    Recording,
    ResidualNoise,
    add_misfit,
    compute_residuals,
    compute_settling_time,
    count_effective_rows,
    fit_residual_noise,
    join_logs,
    loosen_prior,
    read_window,
    solve,
)
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

PROGRESS_INTERVAL = 1.0
"""Time of the log from one progress to the next, s."""
FIRST_SAMPLES = 64
"""Samples after which the sampling interval is judged."""
RESERVED = LOOK + 5
"""Newest rows that the reference does not know while nothing seems to have changed."""
RESERVED_IN_DOUBT = 2 * max(SWAP_WINDOWS) + PUSH_ROWS
"""The same while something does: those that the slowest alarm can be about."""
PLAIN_SCORE = 15.0
"""Times beyond chance that a score without any few rows is if a payload was swapped; what a model's form leaves out
near standstill for a second or two (Stribeck of more than half the friction) reaches five."""
DOUBT = 0.2
"""Share of friction by which it may be off without anything having changed."""
REFRESHED = 8
"""Rows after which the reference of the innovations is solved anew."""
NOISE_ROWS = 64
"""Rows (8 s at 4 Hz) after which the noise is known; an alarm before takes a score that few rows' noise cannot make."""
CORRELATED_ROWS_SHARE = 2.5
"""Rows, half a period of the cutoff apart, that tell as much of slow noise's power as one would of white noise's."""
REMEMBERED = 480.0
"""Rows over which the dispersion of the score is averaged."""


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
class Learned:
    """What is kept of the rows since the last change, and the events.

    Attributes:
        rows: The newest of them, at most `Online.most_rows`.
        past: Those before.
        prior: ``[U z]`` of what was known at the last change, or beforehand; None: nothing.
        gamma: The noise that was known then, as in `Expectation`; None: nothing.
        reference: The estimate that the newest rows are compared with; None until everything is known.
        expected: What of it that takes.
        dispersion: Mean of the score over its expectation so far.
        looks: From how many rows that is.
        beyond: For how many rows each window's score has been beyond chance.
        predicted: Prediction, torque and share of rows before they were learned, one column.
        since: Start of what is learned now, s.
        ready: Whether everything was known, once, since then.
        events: What happened.
    """

    rows: Block
    past: PastRows
    predicted: PastRows
    prior: Array | None = None
    gamma: Array | None = None
    reference: Estimate | None = None
    expected: Expectation | None = None
    dispersion: float = 1.0
    looks: int = 0
    beyond: tuple[int, ...] = (0,) * len(SWAP_WINDOWS)
    since: float = -inf
    ready: bool = False
    events: tuple[Event, ...] = ()

    __repr__ = brief

    @property
    def doubtful(self) -> int:
        """How many of the newest rows seem to be of another payload, until that is announced or passes."""
        rows = max((count + window for count, window in zip(self.beyond, SWAP_WINDOWS) if count), default=0)
        return min(rows, len(self.rows.t))

    @property
    def settled(self) -> int:
        """How many rows the reference may know."""
        return self.past.rows + len(self.rows.t) - self.reserved

    @property
    def reserved(self) -> int:
        """How many of the newest rows the reference does not know."""
        return min(RESERVED_IN_DOUBT if self.doubtful else RESERVED, len(self.rows.t))


class LogMemory(NamedTuple):
    """All that is remembered of a log: as much after an hour as after some minutes, but for the events.

    Attributes:
        name: Name of the log.
        learned: What was learned.
        recording: Samples that later rows depend on; None until the sampling interval is known.
        pending: Blocks that came since these were looked at.
        due: Time of a sample that is worth looking at them, s.
        t: Time of the newest sample, s.
        samples: How many came.
    """

    name: str
    learned: Learned
    recording: Recording | None = None
    pending: tuple[Log, ...] = ()
    due: float = -inf
    t: float = -inf
    samples: int = 0

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened: payloads changed, parameters known."""
        return self.learned.events


@dataclass(frozen=True, eq=False)
class Online:
    """``memory = online.advance(memory, log)`` takes samples in, one or many at a time; `model` answers at any moment.

    The answer is that of `identify` with everything for training, whichever way the samples were cut into blocks: the
    rows are those of `regression.read_window`, and `solve` is the same. The base is taken as standing.

    Attributes:
        design: Rig, base parameters, effects and filters.
        directions: How a change of the payload moves the parameters, (k, r).
        everything: Whether a change of payload lets all parameters loose.
        fading: Time constant of forgetting, s of a joint's motion; infinite: none.
        prior: ``[U z]`` of what is known beforehand; None: nothing.
        most_rows: Rows that are held as they are, four minutes at 4 Hz; the older half of more is kept as its factors.
    """

    design: Design
    directions: Array
    everything: bool = False
    fading: float = inf
    prior: Array | None = None
    most_rows: int = 2048

    __repr__ = brief

    @staticmethod
    def of(
        rig: Rig,
        effects: Sequence[Effect] = (),
        *,
        filtering: Filtering | None = None,
        fading: float = inf,
        everything: bool = False,
        known: Model | None = None,
    ) -> Online:
        """Return the estimator for a rig.

        Args:
            rig: The rig.
            effects: Effects on top of Coulomb and viscous friction; none with a memory.
            filtering: Cutoff and alignment; None: the defaults, with the lags of the known model.
            fading: Time constant of exponential forgetting, s of a joint's motion; standing still forgets nothing.
            everything: After a change of payload estimate all parameters anew, not the payload's alone.
            known: An identified model of this gimbal with any payload: the payload's parameters alone are estimated.

        Raises:
            UsageError: An effect with a memory, a time constant that is not positive, a model of other parameters.
        """
        for effect in effects:
            if effect.start() is not None:
                raise UsageError(effect.name, "has a memory of its own", "identify it from a whole log")
        if not fading > 0:
            raise UsageError("fading", f"is {fading:g} s", "give a positive time, or infinity")
        everywhere = build_friction_effects(rig.joints) + tuple(effects)
        design = Design(rig, reduce_parameters(rig), everywhere, (), filtering or _take_lags(known))
        directions, prior = payload_directions(design), None
        if known is not None:
            before = get_known_parameters(known)
            if before.names != design.names:
                what = "holds other parameters than this rig"
                raise UsageError("the known model", what, f"identify {rig.name} once")
            prior = loosen_prior(before.theta, before.covariance, directions)
        return Online(design, directions, everything, fading, prior)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.design.rig.joints

    def start(self, name: str = "online") -> LogMemory:
        """Return the memory before the first sample; `name` is what errors and results call the log."""
        return LogMemory(name, self._forget(self.prior))

    def advance(self, memory: LogMemory, log: Log) -> LogMemory:
        """Return the memory after more samples.

        Args:
            memory: Before.
            log: Samples later than those before, in one block or many; with rates in all of them or in none.

        Raises:
            LogError: They are not later than those before, or lack a joint of the rig.
            UsageError: No torque, too few samples per period of the cutoff, or rates in some blocks only.
        """
        if not len(log):
            return memory
        memory = _append_samples(memory, log.ordered(self.design.rig))
        if memory.t <= memory.due:
            return memory
        filtering, recording = self.design.filtering, memory.recording
        if recording is None:
            memory = self._time(memory._replace(pending=(join_logs(memory.pending),)))
            if (recording := memory.recording) is None:
                return memory
        else:
            recording = recording.with_logs(memory.pending)
        learned = memory.learned
        while (found := read_window(self.design, recording)) is not None:
            now, (blocks, recording) = recording.compute_due(filtering), found
            for block in blocks:
                learned = self._learn(learned, block, now)
        return memory._replace(recording=recording, pending=(), learned=learned, due=recording.compute_due(filtering))

    def estimate(self, memory: LogMemory) -> Estimate:
        """Return the parameters from all samples so far, since the last change of payload.

        While the newest second or two seem to be of another payload, but may be a push, they are left out.

        Raises:
            DataError: They are too few yet, or leave no trace of some parameters; it names these.
        """
        return self._estimate(memory)[0]

    def is_ready(self, memory: LogMemory) -> bool:
        """Whether `model` has an answer."""
        try:
            return bool(self.answer(memory)[0].rows)
        except DataError:
            return False

    def model(self, memory: LogMemory) -> Model:
        """Return the model with its uncertainty, as `identify` gives it; `DataError` as `estimate`."""
        return to_model(self.design, self.estimate(memory))

    def identified(self, memory: LogMemory) -> Identified:
        """Return what `identify` returns; held out are the rows before they were learned, where that was possible.

        Raises:
            DataError: As `estimate`.
            LogError: A torque has the wrong sign, see `checks.check_assignment`.
        """
        estimate, block, missed = self._estimate(memory)
        blocks = DesignBlocks(self.design, (block,))
        check_assignment(blocks, estimate, memory.name)
        found = assemble_result(blocks, estimate, None, "")
        notes = tuple(event.sentence for event in memory.events)
        swapped = any(event.what == "changed" for event in memory.events)
        if swapped:
            payload = self.design.rig.payload
            notes += (f"what speaks of the payload's mass stands on {payload}, which was there at first",)
        predicted, tested = memory.learned.predicted, None
        if predicted.rows:
            how = "predicted before it was learned"
            tested = measure_accuracy(self.joints, [predicted.to_block()], np.ones(1), how)
        missing = dict(zip(self.joints, missed))
        found = replace(found, held_out=tested, simpler=(), missed=missing)
        return replace(found, logs=(memory.name,), notes=notes, swapped=swapped)

    def torque_error(self, memory: LogMemory) -> Mapping[str, float]:
        """Joint → rms of what the newest two seconds' torque was mispredicted by, N m; empty until it was predicted."""
        reference, rows = memory.learned.reference, _select(memory.learned.rows, slice(-max(SWAP_WINDOWS), None))
        if reference is None or not len(rows.t):
            return {}
        error, share = compute_residuals(rows, reference.theta), rows.share
        rms = np.sqrt(np.sum(error**2, axis=0) / np.maximum(np.sum(share**2, axis=0), 1e-300))
        return dict(zip(self.joints, rms.tolist()))

    def _time(self, memory: LogMemory) -> LogMemory:
        """Choose the grid once the samples of a first window tell their interval: the mean but for lost samples."""
        (log,) = memory.pending
        if len(log) <= FIRST_SAMPLES:
            return memory
        check_sampling(memory.name, log.dt, self.design.filtering.cutoff)
        due = float(log.t[0]) + 2 * compute_settling_time(self.design.filtering)
        if memory.t <= due:
            return memory._replace(due=due)
        steps = np.diff(log.t[log.t <= due])
        dt = float(np.mean(steps[steps < 1.5 * np.median(steps)]))
        return memory._replace(recording=Recording(log, np.zeros((0, 2)), dt, float(log.t[0])))

    def _forget(self, prior: Array | None) -> Learned:
        """Return what is known before the first row."""
        n, k = self.design.rig.n, len(self.design.names)
        nothing = np.zeros((0, n))
        rows = Block(np.zeros(0), np.zeros((0, n, k)), *[nothing] * 6)
        return Learned(rows, PastRows.empty(n, k), PastRows.empty(n, 1), prior)

    def answer(self, memory: LogMemory) -> tuple[Estimate, Block]:
        """Return the estimate without what the model misses, and rows of the same squares and products as its own.

        It takes some milliseconds, `estimate` some tens more; `DataError` as there.
        """
        return self._check(memory, self._finish(memory))

    def _estimate(self, memory: LogMemory) -> tuple[Estimate, Block, tuple[Misfit, ...]]:
        """Return the estimate with what the model misses, rows as `answer`, and that at each joint."""
        learned = self._finish(memory)
        estimate, block = self._check(memory, learned)
        if learned.prior is not None or self.fading < inf:
            return estimate, block, ()
        estimate, missed = add_misfit(self._weigh(learned, learned.doubtful)[0], estimate)
        return estimate, block, missed

    def _finish(self, memory: LogMemory) -> Learned:
        """Return what is learned with the rows that only the end of the log makes whole."""
        learned, recording = memory.learned, memory.recording
        if recording is None:
            raise DataError(memory.name, "has too few samples so far", "go on")
        recording = recording.with_logs(memory.pending)
        while (found := read_window(self.design, recording, ended=True)) is not None:
            blocks, recording = found
            for block in blocks:
                learned = self._append(learned, block)
        return learned

    def _check(self, memory: LogMemory, learned: Learned) -> tuple[Estimate, Block]:
        """Return what `answer` does; `DataError` that says what is missing."""
        estimate, block, hidden = self._solve(learned, learned.doubtful)
        if estimate is None:
            what = f"has given {learned.past.rows + len(learned.rows.t)} rows so far; they cannot show any of"
            raise DataError(memory.name, what, "go on moving every joint", hidden)
        moving = np.mean(block.share**2, axis=0) > LEAST_MOVING
        check_driven(memory.name, self.joints, np.abs(block.b).max(axis=0), moving)
        if hidden:
            raise DataError(memory.name, "so far leaves no trace of", "move every joint, several at a time", hidden)
        return estimate, block

    def _append(self, learned: Learned, block: Block) -> Learned:
        """Add rows that are of the present payload; of too many the older half becomes the past."""
        block = _select(block, block.t >= learned.since)
        learned = replace(learned, rows=Block(*(np.concatenate(x) for x in zip(learned.rows, block))))
        if len(learned.rows.t) <= self.most_rows or learned.reference is None:
            return learned
        half = self.most_rows // 2
        blocks, past = self._weigh(replace(learned, rows=_select(learned.rows, slice(half))))
        past = past.add(blocks, _fit_noise(blocks, learned.reference).processes)
        return replace(learned, rows=_select(learned.rows, slice(half, None)), past=past)

    def _weigh(self, learned: Learned, left_out: int = 0) -> tuple[list[Block], PastRows]:
        """Return the rows but for some newest, and the past, by how long ago they were; apart where time is missing."""
        rows, past = _select(learned.rows, slice(len(learned.rows.t) - left_out)), learned.past
        if self.fading < inf and len(rows.t):
            moved = np.cumsum(rows.share, axis=0) * self._row_step
            root = np.exp((moved - moved[-1]) / (2 * self.fading))
            rows = rows._replace(A=rows.A * root[:, :, None], b=rows.b * root, share=rows.share * root)
            past = past.fade(np.exp(-moved[-1] / self.fading))
        cuts = np.flatnonzero(np.diff(rows.t) > 1.5 * self._row_step) + 1
        return [_select(rows, part) for part in np.split(np.arange(len(rows.t)), cuts) if len(part)], past

    @property
    def _row_step(self) -> float:
        """Time from row to row, s."""
        return 0.5 / self.design.filtering.cutoff

    def _solve(self, learned: Learned, left_out: int) -> tuple[Estimate | None, Block, tuple[str, ...]]:
        """Return the estimate but for some newest rows, all its rows as few, and what does not show in them.

        There is none from fewer rows than three per parameter that is not known beforehand.
        """
        (blocks, past), names, prior = self._weigh(learned, left_out), self.design.names, learned.prior
        whole = past.add(blocks)
        block = whole.to_block()
        if not blocks or whole.count.sum() < 3 * (len(names) if prior is None else self.directions.shape[1]):
            return None, block, names
        known = past if learned.gamma is None else past.with_noise(learned.gamma[0])
        estimate = solve(blocks, prior, method=Method.RECURSIVE, past=known)
        hidden = find_unseen(names, [block], estimate)
        if prior is not None:  # what was known beforehand need not show again
            known_at_rest = ~np.any(block.A != 0.0, axis=(0, 1)) & np.isfinite(estimate.std)
            hidden = tuple(name for name in hidden if not known_at_rest[names.index(name)])
        return estimate, block, hidden

    def _learn(self, learned: Learned, block: Block, now: float) -> Learned:
        """Take the rows of a window in, and see whether they fit.

        Args:
            learned: Before.
            block: The rows.
            now: Time of the sample that made them whole, s.
        """
        if learned.reference is not None:
            guess = (block.A @ learned.reference.theta)[:, :, None]
            learned = replace(learned, predicted=learned.predicted.add([block._replace(A=guess)]))
        learned = self._refresh(self._append(learned, block), learned.settled)
        reference, expected, squares = learned.reference, learned.expected, self._count_squares(learned)
        if reference is None or expected is None or not len(block.t):
            return self._announce(learned, now)
        found = compute_scores(learned.rows, expected)
        alarms = [one.is_alarm(learned.dispersion, squares) for one in found]
        # Rows at standstill, without freedom, leave the count as it is.
        counts = zip(learned.beyond, found, alarms)
        beyond = tuple(
            (old + len(block.t) if old else 1) if alarm else old * (one.freedom == 0) for old, one, alarm in counts
        )
        learned = replace(learned, beyond=beyond)
        if any(count >= window + PUSH_ROWS for count, window in zip(beyond, SWAP_WINDOWS)):
            return self._loosen(learned, reference, expected, now)
        # A score that is so far beyond chance even without a push need not last.
        doubted = PLAIN_SCORE * learned.dispersion
        if any(alarms) and any(
            one.is_alarm(doubted, squares) for one in compute_scores_without_push(learned.rows, expected)
        ):
            return self._loosen(learned, reference, expected, now)
        if learned.settled >= NOISE_ROWS and not any(alarms):
            learned = _average_dispersion(learned, found[-1], len(block.t))
        return self._announce(learned, now)

    def _refresh(self, learned: Learned, before: int) -> Learned:
        """Solve the reference anew where enough rows have settled since there were so many."""
        if learned.settled // REFRESHED == before // REFRESHED:
            return learned
        estimate, _, hidden = self._solve(learned, learned.reserved)
        if estimate is None or hidden:
            return replace(learned, reference=None, expected=None)
        blocks, _ = self._weigh(learned, learned.reserved)
        noise, rows = _fit_noise(blocks, estimate), count_effective_rows(blocks)
        gamma = np.stack([process.to_autocovariance(LOOK) for process in noise.processes], axis=1) * rows / noise.rows
        if learned.gamma is not None:
            gamma = (rows * gamma + TRUSTED * learned.gamma) / (rows + TRUSTED)
        size = len(self.design.reduction.independent)
        doubt = np.where(np.arange(len(estimate.theta)) < size, 0.0, DOUBT * estimate.theta)
        expected = Expectation(estimate.theta, estimate.covariance + np.diag(doubt**2), gamma, self.directions)
        return replace(learned, reference=estimate, expected=expected)

    def _count_squares(self, learned: Learned) -> float:
        """From how many squares the noise is known of the joint that tells least; enough of them count as no end."""
        if learned.settled >= NOISE_ROWS:
            return inf
        count = np.sum(learned.rows.share[: len(learned.rows.t) - learned.reserved] ** 2, axis=0)
        return float((count.min() - len(self.design.names) / len(count)) / CORRELATED_ROWS_SHARE)

    def _loosen(self, learned: Learned, reference: Estimate, expected: Expectation, now: float) -> Learned:
        """Announce a change; keep what it leaves known, and start anew behind it.

        Of the newest rows none is kept: some have samples before the change and after it.
        """
        newest = _select(learned.rows, slice(-learned.reserved, None))
        since, resumed = find_onset(newest, expected, learned.dispersion), compute_settling_time(self.design.filtering)
        loose = "everything" if self.everything else "its parameters"
        said = f"the payload changed at {since:.1f} s: {loose} are estimated anew"
        prior = loosen_prior(reference.theta, reference.covariance, self.directions)
        return replace(
            self._forget(None if self.everything else prior),
            predicted=learned.predicted,
            gamma=None if self.everything else expected.gamma,
            since=float(newest.t[-1]) + resumed,
            events=(*learned.events, Event(now, "changed", since, said)),
            dispersion=learned.dispersion,
            looks=learned.looks,
        )

    def _announce(self, learned: Learned, now: float) -> Learned:
        """Say when everything is known, the first time since the start or since a change."""
        if learned.ready or not len(learned.rows.t):
            return learned
        estimate, _, hidden = self._solve(learned, learned.doubtful)
        if estimate is None or hidden:
            return learned
        event = Event(now, "known", float(learned.rows.t[0]), f"every parameter shows since {now:.1f} s")
        return replace(learned, ready=True, events=(*learned.events, event))


def _take_lags(known: Model | None) -> Filtering:
    """Return the usual filter with a known model's lags: a stream has no torque left to fit them to."""
    return Filtering(lags=() if known is None or known.estimated is None else known.estimated.lags)


def _append_samples(memory: LogMemory, log: Log) -> LogMemory:
    """Append samples; this is all that is done for most of them, so it is done with little."""
    if log.tau is None:
        raise UsageError(log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory")
    before = memory.pending[-1] if memory.pending else memory.recording and memory.recording.log
    if before is not None and (before.v is None) is not (log.v is None):
        raise UsageError(memory.name, "has rates in some samples only", "give them in all or in none")
    if not log.t.item(0) > memory.t:
        what = f"time goes from {memory.t!r} back to {log.t.item(0)!r} s"
        raise LogError(memory.name, what, "give the samples in the order of time")
    return memory._replace(pending=(*memory.pending, log), t=log.t.item(-1), samples=memory.samples + len(log))


def _select(block: Block, rows: Any) -> Block:
    """Some rows of a block."""
    return Block(*(x[rows] for x in block))


def _fit_noise(blocks: Sequence[Block], estimate: Estimate) -> ResidualNoise:
    """Return the noise of each joint's residual as it is, without leverage."""
    k = len(estimate.theta)
    columns, weight = [block.A for block in blocks], np.ones(len(estimate.residual_std))
    return fit_residual_noise(blocks, columns, estimate.theta, np.zeros((k, k)), weight)


def _average_dispersion(learned: Learned, newest: Score, rows: int) -> Learned:
    """Average the score: a model that leaves structure in its residual has larger ones without any change."""
    looks = learned.looks + rows
    step = rows * max(1 / looks, 1 / REMEMBERED)
    mean = max(1.0, learned.dispersion + step * (newest.mean - learned.dispersion))
    return replace(learned, looks=looks, dispersion=mean)


@dataclass(frozen=True, eq=False)
class Progress:
    """The state at one time.

    Attributes:
        t: Time of the newest sample, s.
        samples: How many there were.
        names: Parameters.
        units: Their units.
        value: Their values, (k,); NaN while some of them do not show.
        std: Their standard deviations, (k,).
        torque: What each moves, N m rms, (k,).
        hidden: What does not show yet; empty: `value` holds.
        torque_error: Joint → rms by which the newest two seconds' torque was mispredicted, N m; empty before that.
        events: All events so far.
    """

    t: float
    samples: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    std: Array
    torque: Array
    hidden: tuple[str, ...]
    torque_error: Mapping[str, float]
    events: tuple[Event, ...]

    __repr__ = brief

    @property
    def telling(self) -> list[int]:
        """Places of the parameters, those that move the most torque first."""
        return [int(k) for k in np.argsort(-self.torque, kind="stable")]

    def to_dict(self) -> dict[str, Any]:
        """Return a line of JSON."""
        rows = zip(self.names, self.value.tolist(), self.std.tolist(), self.units)
        parameters = [{"name": n, "value": x, "std": s, "unit": u} for n, x, s, u in rows]
        return {
            "schema": 1,
            "kind": "progress",
            "t": self.t,
            "samples": self.samples,
            "ready": not self.hidden,
            "hidden": list(self.hidden),
            "base_parameters": [] if self.hidden else parameters,
            "torque_error": dict(self.torque_error),
            "events": [asdict(event) for event in self.events],
        }


def report_progress(online: Online, memory: LogMemory) -> Progress:
    """Return what is known now."""
    names, nothing = online.design.names, np.full(len(online.design.names), np.nan)
    hidden: tuple[str, ...] = ()
    value, std, torque = nothing, nothing, np.zeros(len(names))
    try:
        estimate, block = online.answer(memory)
        value, std = estimate.theta, estimate.std
        torque = np.abs(value) * np.sqrt(np.mean(block.A**2, axis=0)).max(axis=0)
    except DataError as error:
        hidden = error.unseen or names
    error_now = online.torque_error(memory)
    units = online.design.units
    return Progress(memory.t, memory.samples, names, units, value, std, torque, hidden, error_now, memory.events)


def iterate_progress(
    online: Online, logs: Iterable[Log], name: str, every: float = PROGRESS_INTERVAL
) -> Iterator[LogMemory]:
    """Take logs in as they come; yield the memory at least once each `every` seconds of them, and at each one's end.

    Args:
        online: The estimator.
        logs: Blocks of one log, in the order of time.
        name: What the log is called.
        every: As above, s.
    """
    memory = online.start(name)
    yield memory
    for log in logs:
        spans = np.maximum(np.ceil((log.t - 1e-6) / every), np.floor(log.t[0] / every) + 1)
        cuts = np.append(np.flatnonzero(np.diff(spans, prepend=-np.inf)), len(log))
        for begin, end in zip(cuts[:-1].tolist(), cuts[1:].tolist()):
            memory = online.advance(memory, log.part(slice(begin, end)))
            yield memory
