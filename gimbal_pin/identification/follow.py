"""Identification on the running gimbal: samples in, at any moment the model that `identify` would give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.checks import check_assignment, check_sampling
from gimbal_pin.dynamics.model import Model, build_stated_effects
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import Effect
from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.identification.fitting import assemble_result, to_model
from gimbal_pin.identification.identified import IdentificationResult
from gimbal_pin.identification.payload_change import payload_directions
from gimbal_pin.identification.payloads import get_known_parameters
from gimbal_pin.identification.requirements import check_motors, find_unseen
from gimbal_pin.identification.validation import measure_accuracy
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Filtering,
    Method,
    Misfit,
    PastRows,
    Recording,
    add_misfit,
    compute_residuals,
    compute_settling_time,
    fit_residual_noise,
    join_logs,
    loosen_prior,
    read_window,
    solve,
)
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

PROGRESS_INTERVAL = 1.0
"""Time of the log from one progress line to the next, s."""
FIRST_SAMPLES = 64
"""Samples after which the sampling interval is judged."""
NEWEST_ROWS = 16
"""Newest rows, two seconds at a cutoff of 4 Hz, that `Online.torque_error` predicts from the rows before them. With
twice as many the error shown is smoother, and later."""
ROWS_PER_REFERENCE = 8
"""Rows after which the parameters that predict the newest rows are estimated anew: each takes some milliseconds."""


@dataclass(frozen=True)
class Event:
    """An event of the estimation.

    Attributes:
        t: Time at which it was noticed, s of the log.
        what: "known": every parameter shows.
        since: Time of the first row that it rests on, s of the log.
        sentence: Description for a person.
    """

    t: float
    what: str
    since: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Learned:
    """Rows and events so far.

    Attributes:
        rows: The newest rows, at most `Online.most_rows`.
        past: Those before.
        predicted: Prediction, torque and share of rows before they were learned, one column.
        reference: Estimate from all rows but the newest; None until every parameter shows.
        events: Events so far.
    """

    rows: Block
    past: PastRows
    predicted: PastRows
    reference: Estimate | None = None
    events: tuple[Event, ...] = ()

    __repr__ = brief

    @property
    def count(self) -> int:
        """Number of rows so far."""
        return self.past.rows + len(self.rows.t)


class LogMemory(NamedTuple):
    """All that is remembered of a log: its size does not grow with time, but for the events.

    Attributes:
        name: Name of the log.
        learned: Rows and events so far.
        recording: Samples that later rows depend on; None until the sampling interval is known.
        pending: Blocks that came since these were looked at.
        due: Time of a sample that makes the next rows whole, s.
        t: Time of the newest sample, s.
        samples: Number of samples so far.
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
        """Events so far."""
        return self.learned.events


@dataclass(frozen=True, eq=False)
class Online:
    """Recursive estimator: ``memory = online.advance(memory, log)`` takes samples in, one or many at a time.

    `model` answers at any moment, and its answer is that of `identify` with everything for training, whichever way the
    samples were cut into blocks: the rows are those of `regression.read_window`, and `solve` is the same. The base is
    taken as standing. A payload that is swapped meanwhile is not noticed: start anew for it, with the old model as
    `known`.

    Attributes:
        design: Rig, base parameters, effects and filters.
        free: Number of parameters that are not known beforehand.
        fading: Time constant of forgetting, s of a joint's motion; infinite: none.
        prior: ``[U z]`` of the parameters known beforehand; None: none.
        most_rows: Rows that are held as they are, four minutes at 4 Hz; the older half of more is kept as its factors.
    """

    design: Design
    free: int
    fading: float = inf
    prior: Array | None = None
    most_rows: int = 2048

    __repr__ = brief

    @staticmethod
    @check_arguments
    def of(
        rig: Rig,
        effects: Sequence[Effect] = (),
        *,
        filtering: Filtering | None = None,
        fading: float = inf,
        known: Model | None = None,
    ) -> Online:
        """Return the estimator for a rig.

        Args:
            rig: The rig.
            effects: Effects on top of Coulomb and viscous friction; none with a memory.
            filtering: Cutoff and alignment; None: the defaults, with the lags of the known model.
            fading: Time constant of exponential forgetting, s of a joint's motion; standing still forgets nothing.
            known: An identified model of this gimbal with any payload: the payload's parameters alone are estimated.

        Raises:
            UsageError: An effect with a memory, a time constant that is not positive, a model of other parameters.
        """
        for effect in effects:
            if effect.start() is not None:
                raise UsageError(
                    effect.name, "has a memory of its own", "identify it from a whole log"
                )
        if not fading > 0:
            raise UsageError("fading", f"is {fading:g} s", "give a positive time, or infinity")
        reduction = reduce_parameters(rig)
        everywhere = build_stated_effects(rig, reduction) + tuple(effects)
        design = Design(rig, reduction, everywhere, (), filtering or _take_lags(known))
        if known is None:
            return Online(design, len(design.names), fading)
        before = get_known_parameters(known)
        if before.names != design.names:
            what = "holds other parameters than this rig"
            raise UsageError("the known model", what, f"identify {rig.name} once")
        directions = payload_directions(design)
        prior = loosen_prior(before.theta, before.covariance, directions)
        return Online(design, directions.shape[1], fading, prior)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.design.rig.joints

    def start(self, name: str = "online") -> LogMemory:
        """Return the memory before the first sample; `name` is what errors and results call the log."""
        n = self.design.rig.n
        k = len(self.design.names)
        empty = np.zeros((0, n))
        rows = Block(np.zeros(0), np.zeros((0, n, k)), *[empty] * 6)
        return LogMemory(name, Learned(rows, PastRows.empty(n, k), PastRows.empty(n, 1)))

    @check_arguments
    def advance(self, memory: LogMemory, log: Log) -> LogMemory:
        """Return the memory after more samples.

        Args:
            memory: Before.
            log: Samples later than those before, in one block or many; with rates in all of them or in none. Angles
                that start over after a turn, in a block or between two, are unwrapped.

        Raises:
            LogError: They are not later than those before, or lack a joint of the rig.
            UsageError: No torque, too few samples per period of the cutoff, or rates in some blocks only.
        """
        if not len(log):
            return memory
        memory = _append_samples(memory, log.ordered(self.design.rig), self.design.rig.slides)
        if memory.t <= memory.due:
            return memory
        filtering = self.design.filtering
        recording = memory.recording
        if recording is None:
            memory = self._time(memory._replace(pending=(join_logs(memory.pending),)))
            if (recording := memory.recording) is None:
                return memory
        else:
            recording = recording.with_logs(memory.pending)
        learned = memory.learned
        while (window := read_window(self.design, recording)) is not None:
            now = recording.compute_due(filtering)
            blocks, recording = window
            for block in blocks:
                learned = self._learn(learned, block, now)
        return memory._replace(
            recording=recording, pending=(), learned=learned, due=recording.compute_due(filtering)
        )

    def estimate(self, memory: LogMemory) -> Estimate:
        """Return the parameters from all samples so far.

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

    @check_arguments
    def model(self, memory: LogMemory) -> Model:
        """Return the model with its uncertainty, as `identify` gives it; `DataError` as `estimate`."""
        return to_model(self.design, self.estimate(memory))

    def identified(self, memory: LogMemory) -> IdentificationResult:
        """Return what `identify` returns; held out are the rows before they were learned, where that was possible.

        Raises:
            DataError: As `estimate`.
            LogError: A torque has the wrong sign, see `checks.check_assignment`.
        """
        estimate, block, missed = self._estimate(memory)
        blocks = DesignBlocks(self.design, (block,))
        check_assignment(blocks, estimate, memory.name)
        identified = assemble_result(blocks, estimate, None, "")
        predicted = memory.learned.predicted
        held_out = None
        if predicted.rows:
            held_out = measure_accuracy(
                self.joints, [predicted.to_block()], np.ones(1), "predicted before it was learned"
            )
        return replace(
            identified,
            held_out=held_out,
            simpler=(),
            missed=dict(zip(self.joints, missed)),
            logs=(memory.name,),
            notes=tuple(event.sentence for event in memory.events),
        )

    def torque_error(self, memory: LogMemory) -> Mapping[str, float]:
        """Return joint → rms by which the newest two seconds' torque was mispredicted, N m; empty before that."""
        reference = memory.learned.reference
        rows = _select(memory.learned.rows, slice(-NEWEST_ROWS, None))
        if reference is None or not len(rows.t):
            return {}
        error = compute_residuals(rows, reference.theta)
        count = np.maximum(np.sum(rows.share**2, axis=0), np.finfo(float).tiny)
        return dict(zip(self.joints, np.sqrt(np.sum(error**2, axis=0) / count).tolist()))

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

    def answer(self, memory: LogMemory) -> tuple[Estimate, Block]:
        """Return the estimate without what the model misses, and rows of the same squares and products as its own.

        It takes some milliseconds, `estimate` some tens more; `DataError` as there.
        """
        return self._check(memory, self._finish(memory))

    def _estimate(self, memory: LogMemory) -> tuple[Estimate, Block, tuple[Misfit, ...]]:
        """Return the estimate with what the model misses, rows as `answer`, and that at each joint."""
        learned = self._finish(memory)
        estimate, block = self._check(memory, learned)
        if self.prior is not None or self.fading < inf:
            return estimate, block, ()
        estimate, missed = add_misfit(self._weigh(learned)[0], estimate)
        return estimate, block, missed

    def _finish(self, memory: LogMemory) -> Learned:
        """Return what is learned with the rows that only the end of the log makes whole."""
        learned = memory.learned
        recording = memory.recording
        if recording is None:
            raise DataError(memory.name, "has too few samples so far", "go on")
        recording = recording.with_logs(memory.pending)
        while (window := read_window(self.design, recording, ended=True)) is not None:
            blocks, recording = window
            for block in blocks:
                learned = self._append(learned, block)
        return learned

    def _check(self, memory: LogMemory, learned: Learned) -> tuple[Estimate, Block]:
        """Return what `answer` does; `DataError` that says what is missing."""
        estimate, block, hidden = self._solve(learned)
        if estimate is None:
            what = f"has given {learned.count} rows so far; they cannot show any of"
            raise DataError(memory.name, what, "go on moving every joint", hidden)
        check_motors(memory.name, self.design, [block])
        if hidden:
            raise DataError(
                memory.name,
                "so far leaves no trace of",
                "move every joint, several at a time",
                hidden,
            )
        return estimate, block

    def _append(self, learned: Learned, block: Block) -> Learned:
        """Add rows; of too many the older half becomes the past."""
        learned = replace(
            learned, rows=Block(*(np.concatenate(x) for x in zip(learned.rows, block)))
        )
        if len(learned.rows.t) <= self.most_rows or learned.reference is None:
            return learned
        half = self.most_rows // 2
        blocks, past = self._weigh(replace(learned, rows=_select(learned.rows, slice(half))))
        theta = learned.reference.theta
        # The noise of the residual as it is, without leverage: of so many rows it does not matter.
        noise = fit_residual_noise(
            blocks,
            [block.A for block in blocks],
            theta,
            np.zeros((len(theta),) * 2),
            np.ones(len(self.joints)),
        )
        past = past.add(blocks, noise.processes)
        return replace(learned, rows=_select(learned.rows, slice(half, None)), past=past)

    def _weigh(self, learned: Learned, left_out: int = 0) -> tuple[list[Block], PastRows]:
        """Return the rows but for some newest, and the past, by how long ago they were; apart where time is missing."""
        rows = _select(learned.rows, slice(max(len(learned.rows.t) - left_out, 0)))
        past = learned.past
        step = 0.5 / self.design.filtering.cutoff
        if self.fading < inf and len(rows.t):
            moved = np.cumsum(rows.share, axis=0) * step
            root = np.exp((moved - moved[-1]) / (2 * self.fading))
            rows = rows._replace(
                A=rows.A * root[:, :, None], b=rows.b * root, share=rows.share * root
            )
            past = past.fade(np.exp(-moved[-1] / self.fading))
        cuts = np.flatnonzero(np.diff(rows.t) > 1.5 * step) + 1
        return [
            _select(rows, part) for part in np.split(np.arange(len(rows.t)), cuts) if len(part)
        ], past

    def _solve(
        self, learned: Learned, left_out: int = 0
    ) -> tuple[Estimate | None, Block, tuple[str, ...]]:
        """Return the estimate but for some newest rows, all its rows as few, and what does not show in them.

        There is none from fewer rows than three per parameter that is not known beforehand.
        """
        names = self.design.names
        blocks, past = self._weigh(learned, left_out)
        whole = past.add(blocks)
        block = whole.to_block()
        if not blocks or whole.count.sum() < 3 * self.free:
            return None, block, names
        estimate = solve(blocks, self.prior, method=Method.RECURSIVE, past=past)
        hidden = find_unseen(names, [block], estimate)
        if self.prior is not None:  # what was known beforehand need not show again
            known_at_rest = ~np.any(block.A != 0.0, axis=(0, 1)) & np.isfinite(estimate.std)
            hidden = tuple(name for name in hidden if not known_at_rest[names.index(name)])
        return estimate, block, hidden

    def _learn(self, learned: Learned, block: Block, now: float) -> Learned:
        """Predict the rows of a window, then take them in.

        Args:
            learned: Before.
            block: The rows.
            now: Time of the sample that made them whole, s.
        """
        if learned.reference is not None:
            guess = (block.A @ learned.reference.theta)[:, :, None]
            learned = replace(learned, predicted=learned.predicted.add([block._replace(A=guess)]))
        before = learned.count // ROWS_PER_REFERENCE
        learned = self._append(learned, block)
        if not learned.events and len(learned.rows.t):
            estimate, _, hidden = self._solve(learned)
            if estimate is not None and not hidden:
                said = f"every parameter shows since {now:.1f} s"
                learned = replace(
                    learned, events=(Event(now, "known", float(learned.rows.t[0]), said),)
                )
        if learned.count // ROWS_PER_REFERENCE == before:
            return learned
        estimate, _, hidden = self._solve(learned, NEWEST_ROWS)
        return replace(learned, reference=None if hidden else estimate)


def _take_lags(known: Model | None) -> Filtering:
    """Return the usual filter with a known model's lags: a stream has no torque left to fit them to."""
    return Filtering(lags=() if known is None or known.estimated is None else known.estimated.lags)


def _append_samples(memory: LogMemory, log: Log, slides: Sequence[bool]) -> LogMemory:
    """Append samples; this is all that is done for most of them, so it is done with little."""
    if log.tau is None:
        raise UsageError(
            log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory"
        )
    before = memory.pending[-1] if memory.pending else memory.recording and memory.recording.log
    if before is not None and (before.v is None) is not (log.v is None):
        raise UsageError(
            memory.name, "has rates in some samples only", "give them in all or in none"
        )
    if not log.t.item(0) > memory.t:
        what = f"time goes from {memory.t!r} back to {log.t.item(0)!r} s"
        raise LogError(memory.name, what, "give the samples in the order of time")
    steps = np.diff(log.q, axis=0, prepend=log.q[:1] if before is None else before.q[-1:])
    turns = np.round(steps / (2 * pi))
    turns[:, np.asarray(slides)] = 0.0
    turns[np.abs(turns) > 1] = (
        0.0  # larger steps are counts or degrees that start over, or glitches
    )
    if turns.any():
        log = replace(log, q=log.q - 2 * pi * np.cumsum(turns, axis=0))
    return memory._replace(
        pending=(*memory.pending, log), t=log.t.item(-1), samples=memory.samples + len(log)
    )


def _select(block: Block, rows: Any) -> Block:
    """Return some rows of a block."""
    return Block(*(x[rows] for x in block))


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
    names = online.design.names
    nothing = np.full(len(online.design.names), np.nan)
    hidden: tuple[str, ...] = ()
    value = nothing
    std = nothing
    torque = np.zeros(len(names))
    try:
        estimate, block = online.answer(memory)
        value = estimate.theta
        std = estimate.std
        torque = np.abs(value) * np.sqrt(np.mean(block.A**2, axis=0)).max(axis=0)
    except DataError as error:
        hidden = error.unseen or names
    error_now = online.torque_error(memory)
    units = online.design.units
    return Progress(
        memory.t, memory.samples, names, units, value, std, torque, hidden, error_now, memory.events
    )


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
