"""Samples as they come → frames on a uniform grid, the same frames however the samples were cut into blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log

FIRST = 64
"""Samples whose intervals tell the sampling interval."""
BEHIND, AHEAD = 3, 3.0
"""Samples kept before a frame, and intervals waited for after it: the interpolation looks at two on either side."""


class Frame(NamedTuple):
    """Consecutive samples of the grid: time, s, (F,), and the channels side by side (q, tau, and v where there is one).

    `fresh` says that they do not continue the frame before.
    """

    t: Array
    channels: Array
    fresh: bool


class Grid(NamedTuple):
    """What has come and is not in a frame yet.

    Attributes:
        joints: n; the channels are n angles, n torques, and n rates where there are some.
        raw: Time and channels of the newest samples, (m, 1 + c).
        dt: Interval of the grid, s; 0 until it is known.
        start: Time of the first sample since the last gap, s.
        passed: Samples of the grid since then.
    """

    joints: int
    raw: Array
    dt: float = 0.0
    start: float = 0.0
    passed: int = 0

    def with_logs(self, logs: Sequence[Log]) -> Grid:
        """Return the grid with more samples."""
        names = ("q", "tau") if logs[0].v is None else ("q", "tau", "v")
        t = np.concatenate([log.t for log in logs])[:, None]
        new = np.concatenate([t, *(np.concatenate([getattr(log, name) for log in logs]) for name in names)], axis=1)
        if not len(self.raw):
            return self._replace(raw=new, start=float(new[0, 0]))
        return self._replace(raw=np.concatenate([self.raw, new]))

    def due(self, count: int, alignment: float) -> float:
        """Time after which a sample completes a frame of `count`, s."""
        return self.start + self.dt * (self.passed + count - 1 + AHEAD) + abs(alignment)


def interval(t: Array) -> float:
    """Sampling interval of the first samples, s: the mean of those intervals that are not lost samples."""
    steps = np.diff(t)
    return float(np.mean(steps[steps < 1.5 * np.median(steps)]))


def next_frame(grid: Grid, count: int, alignment: float, gap: float) -> tuple[Frame | None, Grid]:
    """Return the next frame, None if it is not complete yet, and the grid after it.

    Where two samples are more than `gap` s apart, the grid starts anew at the second; what was no whole frame is lost.

    Args:
        grid: Its `dt` is known.
        count: Samples per frame.
        alignment: Time by which the torque acts later than its stamp, s.
        gap: As above, s.
    """
    while True:
        t = grid.raw[:, 0]
        last = int(np.searchsorted(t, grid.due(count, alignment), side="right"))
        # What is looked at ends there, whatever else has come: the frame does not depend on it.
        seen = grid.raw[: last + 1]
        gaps = np.flatnonzero(np.diff(seen[:, 0]) > gap)
        if not len(gaps):
            break
        cut = int(gaps[0]) + 1
        grid = grid._replace(raw=grid.raw[cut:], start=float(t[cut]), passed=0)
    if last == len(t):
        return None, grid
    return resampled(grid, seen, count, alignment), advanced(grid, count, alignment)


def advanced(grid: Grid, count: int, alignment: float) -> Grid:
    """Return the grid after a frame, without the samples that no later one looks at."""
    passed = grid.passed + count
    oldest = grid.start + grid.dt * passed - abs(alignment)
    first = max(int(np.searchsorted(grid.raw[:, 0], oldest)) - BEHIND, 0)
    return grid._replace(raw=grid.raw[first:], passed=passed)


def resampled(grid: Grid, raw: Array, count: int, alignment: float) -> Frame:
    """Interpolate a frame; the torque at the time at which it acts."""
    at = grid.start + grid.dt * (grid.passed + np.arange(count))
    n = grid.joints
    # One call for both: its cost is that of calling.
    both = signals.resample(raw[:, 0], raw[:, 1:], np.concatenate([at, at - alignment]))
    channels = both[:count].copy()
    channels[:, n : 2 * n] = both[count:, n : 2 * n]
    return Frame(at, channels, grid.passed == 0)
