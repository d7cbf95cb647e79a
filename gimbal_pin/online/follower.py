"""Identification on the running gimbal: samples in, at any moment the model that `identify` would give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.checks import check_assignment, check_driven, check_sampling
from gimbal_pin.dynamics.model import Model, friction_effects
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.effects import Effect
from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.identification import (
    LEAST_MOVING,
    Accuracy,
    Identified,
    assemble_result,
    measure_accuracy,
    to_model,
)
from gimbal_pin.identification.payload_change import payload_directions
from gimbal_pin.identification.payloads import get_known_parameters
from gimbal_pin.log.log import Array, Log
from gimbal_pin.online.causal import (
    FIRST,
    SETTLING,
    Grid,
    Noise,
    Row,
    Running,
    StreamDesign,
    designed,
    interval,
    next_frame,
    process_frame,
)
from gimbal_pin.online.change import WINDOWS
from gimbal_pin.online.learning import (
    DOUBT,
    Event,
    Learned,
    Task,
    all_moments,
    answer,
    hidden_parameters,
    initial,
    learn,
    too_few,
    values,
)
from gimbal_pin.regression import (
    LAGS,
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Filtering,
    Known,
    Method,
    Prior,
    compute_settling_time,
    loosen_prior,
    solve_recursive,
)
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

EVERY = 1.0
"""Time of the log from one progress to the next, s."""


class Memory(NamedTuple):
    """All that is remembered of a log: as much after an hour as after a second, but for the events.

    Attributes:
        name: Name of the log.
        grid: Samples that are in no frame yet.
        noise: Noise of the sensors.
        known: What was learned.
        design: Constants that follow from the sampling interval; None until it is known.
        running: Memory of the filters; None before the first frame.
        task: Constants of the estimate; None until the sampling interval is known.
        pending: Blocks that came since the grid was looked at.
        due: Time of a sample that is worth looking at it, s.
        t: Time of the newest sample, s.
        samples: How many came.
        rates: Whether they have rates.
        row: The newest row; None before the first.
    """

    name: str
    grid: Grid
    noise: Noise
    known: Learned
    design: StreamDesign | None = None
    running: Running | None = None
    task: Task | None = None
    pending: tuple[Log, ...] = ()
    due: float = -inf
    t: float = -inf
    samples: int = 0
    rates: bool = False
    row: Row | None = None

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened: payloads changed, parameters known."""
        return self.known.events


@dataclass(frozen=True, eq=False)
class Online:
    """``memory = online.advance(memory, log)`` takes samples in, one or many at a time; `model` answers at any moment.

    The answer is that of `fit_weighted` on the same rows, whichever way the samples were cut into blocks
    (recursion: Lawson and Hanson 1974, ch. 27; covariance: Newey and West 1987). The base is taken as standing.

    Attributes:
        rows: Rig, base parameters, effects and filters.
        directions: How a change of the payload moves the parameters, (k, r).
        everything: Whether a change of payload lets all parameters loose.
        fading: Time constant of forgetting, s of a joint's motion; infinite: none.
        prior: What is known beforehand; None: nothing.
    """

    rows: Design
    directions: Array
    everything: bool = False
    fading: float = inf
    prior: Prior | None = None

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
            filtering: Cutoff and alignment; None: the defaults.
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
        everywhere = friction_effects(rig.joints) + tuple(effects)
        rows = Design(rig, reduce(rig), everywhere, (), filtering or Filtering())
        directions = payload_directions(rows)
        prior = None if known is None else prior_of(rows, directions, known)
        return Online(rows, directions, everything, fading, prior)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.rows.rig.joints

    def start(self, name: str = "online") -> Memory:
        """Return the memory before the first sample; `name` is what errors and results call the log."""
        n = self.rows.rig.n
        known = initial(n, len(self.rows.names), self.prior)
        return Memory(name, Grid(n, np.zeros((0, 0))), Noise(np.zeros((2, n)), 0), known)

    def advance(self, memory: Memory, log: Log) -> Memory:
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
        memory = appended(memory, log.ordered(self.rows.rig))
        if memory.t <= memory.due:
            return memory
        memory = memory._replace(grid=memory.grid.with_logs(memory.pending), pending=())
        design = memory.design
        if design is None:
            memory = self.timed(memory)
            if (design := memory.design) is None:
                return memory
        while (after := self.framed(memory, design)) is not memory:
            memory = after
        # A copy: a view would keep the whole block alive behind its last samples.
        grid = memory.grid._replace(raw=memory.grid.raw.copy())
        return memory._replace(grid=grid, due=grid.due(design.count, design.alignment))

    def timed(self, memory: Memory) -> Memory:
        """Choose everything that depends on the sampling interval, once the first samples tell it."""
        if memory.samples <= FIRST:
            return memory
        grid = memory.grid
        filtering, dt = self.rows.filtering, interval(grid.raw[: FIRST + 1, 0])
        check_sampling(memory.name, dt, filtering.cutoff)
        design = designed(self.rows, dt)
        base = len(self.rows.reduction.independent)
        doubt = np.where(np.arange(len(self.rows.names)) < base, 0.0, DOUBT)
        moved = (self.directions, doubt, self.everything, self.fading)
        task = Task(self.rows.names, *moved, design.count * dt, SETTLING * compute_settling_time(filtering))
        return memory._replace(grid=grid._replace(dt=dt), design=design, task=task)

    def framed(self, memory: Memory, design: StreamDesign) -> Memory:
        """Take the next frame; the same memory if there is none."""
        frame, grid = next_frame(memory.grid, design.count, design.alignment, design.gap)
        if frame is None:
            return memory if grid is memory.grid else memory._replace(grid=grid)
        row, running, noise = process_frame(design, memory.running, memory.noise, frame)
        memory = memory._replace(grid=grid, running=running, noise=noise)
        if row is None or memory.task is None:
            return memory
        now = float(frame.t[-1])
        return memory._replace(known=learn(memory.task, memory.known, row, now), row=row)

    def estimate(self, memory: Memory) -> Known:
        """Return the parameters from all samples so far, since the last change of payload.

        While the newest second or two seem to be of another payload, but may be a push, they are left out.

        Raises:
            DataError: They are too few yet, or leave no trace of some parameters; it names these.
        """
        task = memory.task
        if task is None:
            raise DataError(memory.name, "has too few samples so far", "go on")
        moments, prior = all_moments(task, memory.known), memory.known.prior
        if too_few(task, moments, prior):
            what = f"has given {moments.rows} rows so far; they cannot show any of"
            raise DataError(memory.name, what, "go on moving every joint", task.names)
        torque, moving = np.linalg.norm(moments.factors[:, :, -2], axis=1), moments.count > LEAST_MOVING * moments.rows
        check_driven(memory.name, self.rows.rig.joints, torque, moving)
        known = solve_recursive(moments, prior)
        if names := hidden_parameters(task, moments, known.estimate, prior):
            raise DataError(memory.name, "so far leaves no trace of", "move every joint, several at a time", names)
        return known

    def ready(self, memory: Memory) -> bool:
        """Whether `model` has an answer."""
        return memory.task is not None and answer(memory.task, memory.known) is not None

    def model(self, memory: Memory) -> Model:
        """Return the model with its uncertainty, as `identify` gives it; `DataError` as `estimate`."""
        return to_model(self.rows, self.estimate(memory).estimate)

    def identified(self, memory: Memory) -> Identified:
        """Return what `identify` returns; held out are the rows before they were learned, where that was possible.

        Raises:
            DataError: As `estimate`.
            LogError: A torque has the wrong sign, see `checks.check_assignment`.
        """
        estimate = self.estimate(memory).estimate
        task = memory.task
        assert task is not None, "an estimate has a task"
        block = all_moments(task, memory.known).to_block()
        blocks = DesignBlocks(self.rows, (block,))
        check_assignment(blocks, estimate, memory.name)
        found = assemble_result(blocks, estimate, None, "")
        notes = tuple(event.sentence for event in memory.events)
        swapped = any(event.what == "changed" for event in memory.events)
        if swapped:
            notes += (f"what speaks of the payload's mass stands on {self.rows.rig.payload}, which was there at first",)
        tested = tested_accuracy(self.joints, memory.known)
        return replace(found, held_out=tested, logs=(memory.name,), notes=notes, swapped=swapped)

    def torque_error(self, memory: Memory) -> Mapping[str, float]:
        """Joint → rms of what the newest two seconds' torque was mispredicted by, N m; empty until it was predicted."""
        known = memory.known
        if known.reference is None or not known.window:
            return {}
        rows = values(known.window[-max(WINDOWS) :])
        error = rows[:, :, -2] - rows[:, :, :-2] @ known.reference.estimate.theta
        rms = np.sqrt(np.sum(error**2, axis=0) / np.maximum(np.sum(rows[:, :, -1] ** 2, axis=0), 1e-300))
        return dict(zip(self.joints, rms.tolist()))


def appended(memory: Memory, log: Log) -> Memory:
    """Append samples; this is all that is done for most of them, so it is done with little."""
    if log.tau is None:
        raise UsageError(log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory")
    rates = log.v is not None
    if memory.samples and rates is not memory.rates:
        raise UsageError(memory.name, "has rates in some samples only", "give them in all or in none")
    if not log.t.item(0) > memory.t:
        what = f"time goes from {memory.t!r} back to {log.t.item(0)!r} s"
        raise LogError(memory.name, what, "give the samples in the order of time")
    samples = memory.samples + len(log)
    return memory._replace(pending=(*memory.pending, log), t=log.t.item(-1), samples=samples, rates=rates)


def prior_of(rows: Design, directions: Array, model: Model) -> Prior:
    """Return what a model of the gimbal with another payload leaves known."""
    known = get_known_parameters(model)
    if known.names != rows.names:
        raise UsageError("the known model", "holds other parameters than this rig", f"identify {rows.rig.name} once")
    silent = np.zeros((LAGS + 1, rows.rig.n))
    estimate = Estimate(known.theta, known.covariance, silent[0], inf, 0, Method.KNOWN)
    return replace(loosen_prior(Known(estimate, silent), directions), count=0.0)


def tested_accuracy(joints: Sequence[str], known: Learned) -> Accuracy | None:
    """Accuracy of the predictions of rows that were not learned yet; None where none was made."""
    if not known.count:
        return None
    squares, vectors = np.linalg.eigh(3 / known.count * known.predicted)
    roots = np.sqrt(np.maximum(squares, 0.0))[:, :, None] * vectors.swapaxes(1, 2)
    lines = roots.swapaxes(0, 1)  # rows with the same squares and products
    nowhere = np.zeros(lines.shape[:2])
    block = Block(np.zeros(3), lines[:, :, :1], lines[:, :, 1], nowhere, nowhere, lines[:, :, 2])
    return measure_accuracy(joints, [block], np.ones(1), "predicted before it was learned")


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


def progress(online: Online, memory: Memory) -> Progress:
    """Return what is known now."""
    names, nothing = online.rows.names, np.full(len(online.rows.names), np.nan)
    hidden: tuple[str, ...] = ()
    value, std, torque = nothing, nothing, np.zeros(len(names))
    try:
        known, task = online.estimate(memory), memory.task
        value, std = known.estimate.theta, known.estimate.std
        assert task is not None, "an estimate has a task"
        columns = all_moments(task, memory.known).to_block().A
        torque = np.abs(value) * np.sqrt(np.mean(columns**2, axis=0)).max(axis=0)
    except DataError as error:
        hidden = error.unseen or names
    error_now = online.torque_error(memory)
    units = online.rows.units
    return Progress(memory.t, memory.samples, names, units, value, std, torque, hidden, error_now, memory.events)


def steps(online: Online, logs: Iterable[Log], name: str, every: float = EVERY) -> Iterator[Memory]:
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
