"""The parts of a log between its holes, each on a uniform grid."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.missing_samples import filled, holes

SHORTEST = 8
"""A stretch of fewer samples than this has no noise that could be told, and no row survives its filters."""


class Stretch(NamedTuple):
    """Uniform grid over a part of a log: `length` samples every `dt` s from `start`.

    The part has no holes but those whose begin and end, s, are in `holes`, (k, 2); `log` has them filled where the
    motion tells what was in them.
    """

    log: Log
    rows: slice
    start: float
    dt: float
    length: int
    holes: Array


def stretches(log: Log, cutoff: float, across: float = 0.0) -> Iterator[Stretch]:
    """Yield the parts of a log between holes; what the motion itself closes is none.

    Args:
        log: The log.
        cutoff: Highest frequency that will be looked at, Hz.
        across: Holes up to so long, s, do not part it either: for those who only look at what was measured.
    """
    if len(log) < SHORTEST:
        return
    log, closed = filled(log, cutoff)
    dt, gaps = log.dt, holes(log, cutoff)
    ends = np.stack([log.t[gaps], log.t[gaps + 1]], axis=1)
    passed = ends[:, 1] - ends[:, 0] <= across
    closed = np.sort(np.concatenate([closed, ends[passed]]), axis=0)
    edges = [0, *(gaps[~passed] + 1).tolist(), len(log)]
    for first, last in itertools.pairwise(edges):
        if last - first >= SHORTEST:
            span = log.t[last - 1] - log.t[first]
            count = int(span / dt * (1 + 1e-9)) + 1
            # The grid's own interval makes it end on the last sample: an interval rounded from jitter would drift.
            yield Stretch(log, slice(first, last), float(log.t[first]), float(span / (count - 1)), count, closed)
