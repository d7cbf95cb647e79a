"""Rows of a log that is still being recorded: windows of its samples in, the batch's rows out.

Each window has the filters' memory on both sides of its rows, so that they lie that much behind the newest sample and
differ from the batch's by what a filter of that memory forgets, and by each window's own estimate of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression.design import Block, Design
from gimbal_pin.regression.missing_samples import (
    GAP_SIDE,
    LONGEST_GAP,
    compute_gap_length,
    fill_gaps,
    holes,
)
from gimbal_pin.regression.samples import (
    Filtering,
    Segment,
    compute_reach,
    compute_row_step,
    compute_settling_time,
)
from gimbal_pin.rig.brief import brief

WINDOW_ROWS = 3
"""Rows per window: more cost less processor time each, and come later."""


class Recording(NamedTuple):
    """The newest samples of a log, and how far its rows have come.

    Attributes:
        log: Samples that later rows depend on, those in closed gaps filled in.
        closed: Begin and end of these gaps, s, (k, 2).
        dt: Interval of the grid, s.
        start: First sample of the grid, s: the first one after the last gap.
        first: Samples of the grid before the next window, whole steps from row to row.
    """

    log: Log
    closed: Array
    dt: float
    start: float
    first: int = 0

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    def with_logs(self, logs: Sequence[Log]) -> Recording:
        """Return it with more samples."""
        return self._replace(log=join_logs([self.log, *logs]))

    def count_window(self, filtering: Filtering) -> int:
        """Samples of the grid in a window."""
        step = compute_row_step(filtering, self.dt)
        pad = count_padding(filtering, self.dt)
        return step * (-(-pad // step) + WINDOW_ROWS - 1) + 1 + pad

    def compute_due(self, filtering: Filtering) -> float:
        """Time, s, that a sample must be later than for the next window to be whole, if it has no gap."""
        last = self.first + self.count_window(filtering) - 1
        return self.start + self.dt * last + compute_reach(filtering, self.dt)


def count_padding(filtering: Filtering, dt: float) -> int:
    """Samples on either side of a row that it depends on."""
    return int(np.ceil(compute_settling_time(filtering) / dt))


def join_logs(logs: Sequence[Log]) -> Log:
    """Return parts of one log as one: angles, rates and torques alone."""
    first = logs[0]
    t, q = (np.concatenate([getattr(log, name) for log in logs]) for name in ("t", "q"))
    v, tau = (
        None
        if getattr(first, name) is None
        else np.concatenate([getattr(log, name) for log in logs])
        for name in ("v", "tau")
    )
    return Log(first.name, first.joints, t, q, v, tau)


def read_window(
    design: Design, recording: Recording, ended: bool = False
) -> tuple[list[Block], Recording] | None:
    """Return the rows of the next window and the recording after it; None while it is not whole.

    What is looked at ends at a time, whatever else has come: rows do not depend on how the samples were cut. Where
    samples are missing, the rows end before, and the grid starts anew behind, as in `split_segments`.

    Args:
        design: What rows consist of; its logs are not read.
        recording: The samples.
        ended: Whether no more will come: the last window ends where they do.
    """
    filtering = design.filtering
    dt = recording.dt
    t = recording.log.t
    until = recording.compute_due(filtering)
    stop = (
        len(t)
        if ended
        else _find_end(t, until, compute_gap_length(dt, filtering.cutoff), filtering.cutoff)
    )
    if stop is None:
        return None
    seen, closed = fill_gaps(recording.log.part(slice(0, stop)), filtering.cutoff)
    closed = np.concatenate([recording.closed, closed])
    gaps = holes(seen, filtering.cutoff)
    has_gap = len(gaps) > 0 and bool(seen.t[gaps[0]] <= until)
    end = int(gaps[0]) + 1 if has_gap else len(seen)
    length = recording.count_window(filtering)
    if has_gap or ended:
        length = min(
            length, int((seen.t[end - 1] - recording.start) / dt * (1 + 1e-9)) + 1 - recording.first
        )
    if ended and not has_gap and length <= 2 * count_padding(filtering, dt):
        return None
    segment = Segment(
        seen, slice(0, end), recording.start + recording.first * dt, dt, length, closed
    )
    blocks = list(design.build_blocks(segment))
    if has_gap:
        rest = recording.log.part(slice(int(np.searchsorted(t, seen.t[end])), None))
        return blocks, Recording(rest, closed[:0], dt, float(rest.t[0]))
    first = recording.first + WINDOW_ROWS * compute_row_step(filtering, dt)
    oldest = recording.start + first * dt - compute_reach(filtering, dt)
    kept = seen.part(slice(int(np.searchsorted(seen.t, oldest)), None))
    log = join_logs([kept, recording.log.part(slice(stop, None))])
    return blocks, Recording(log, closed[closed[:, 1] > oldest], dt, recording.start, first)


def _find_end(t: Array, until: float, gap: float, cutoff: float) -> int | None:
    """Count the samples up to the first one after a time, or after what tells the motion behind each gap before it."""
    while (last := int(np.searchsorted(t, until, side="right"))) < len(t):
        behind = t[1 : last + 1][np.diff(t[: last + 1]) > gap]
        if (
            not len(behind)
            or (context := float(behind[-1]) + 2 * GAP_SIDE * LONGEST_GAP / cutoff) <= until
        ):
            return last + 1
        until = context
    return None
