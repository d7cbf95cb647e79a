"""What an online estimator knows, second by second."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gimbal_pin.errors import DataError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.online.follower import Memory, Online
from gimbal_pin.online.learning import Event, gathered

EVERY = 1.0
"""Time of the log from one progress to the next, s."""


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
        columns = gathered(task, memory.known).block().A
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
