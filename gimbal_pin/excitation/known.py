"""What earlier logs have shown already: the information that a sequential design starts from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from gimbal_pin.effects import Effect
from gimbal_pin.excitation.columns import Columns
from gimbal_pin.excitation.criteria import Sequential
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.regression import CHUNK_SAMPLES, Filtering, Segment, find_standstill, smooth_samples, split_segments
from gimbal_pin.rig.rig import Rig

FINE = 100.0
"""Samples per second that are enough for the information of smoothed channels."""


def sequential(rig: Rig, logs: Sequence[Log], seconds: float, effects: Sequence[Effect] = ()) -> Sequential:
    """Return the criterion of a motion of so many seconds that teaches most beyond the logs: for `excite`."""
    return Sequential(known(Columns.of(rig, effects), [log.ordered(rig) for log in logs]), seconds, rig.n)


def known(columns: Columns, logs: Sequence[Log], filtering: Filtering | None = None) -> Array:
    """``integral of W'W dt`` over logs, away from standstill, W the columns in unit torque, s, (p, p)."""
    filters = filtering or Filtering()
    total: Array = np.zeros((len(columns.scale), len(columns.scale)))
    for log in logs:
        for stretch in split_segments(log, filters.cutoff):
            for dt, rows in seen(columns, stretch, filters):
                total += dt * rows.T @ rows
    return total


def seen(columns: Columns, stretch: Segment, filters: Filtering) -> Iterator[tuple[float, Array]]:
    """Yield the interval, s, and the unit columns of a stretch, chunk by chunk, (rows, p)."""
    step = max(1, int(1 / (FINE * stretch.dt)))
    ends = np.linspace(0, stretch.length, max(1, stretch.length // CHUNK_SAMPLES) + 1).astype(int).tolist()
    for first, last in pairwise(ends):
        channels = smooth_samples(stretch, filters, first, last)
        moving = ~find_standstill(channels, filters)[::step]
        motion = Motion(*(x[::step] for x in (channels.t, channels.q, channels.v, channels.a)))
        yield step * stretch.dt, columns.unit(motion, np.sign(motion.v)) * moving.reshape(-1, 1)
