"""Samples as they come → frames on a uniform grid, the same frames however the samples were cut into blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimbal_pin import signals
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log import Array, Log

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
        pending: Blocks that came since `raw` was put together.
    """

    joints: int
    raw: Array
    dt: float = 0.0
    start: float = 0.0
    passed: int = 0
    pending: tuple[Array, ...] = ()

    @property
    def newest(self) -> float:
        """Time of the newest sample, s; minus infinity before the first."""
        last = self.pending[-1] if self.pending else self.raw
        return float(last[-1, 0]) if len(last) else -np.inf

    def with_samples(self, samples: Array, name: str) -> Grid:
        """Return the grid with more samples, (m, 1 + c); `LogError` unless they are later than those before."""
        if samples[0, 0] <= self.newest:
            what = f"time goes from {self.newest!r} back to {float(samples[0, 0])!r} s"
            raise LogError(name, what, "give the samples in the order of time")
        return self._replace(pending=(*self.pending, samples))

    def merged(self) -> Grid:
        """Return the grid with the blocks that came put together."""
        return self._replace(raw=np.concatenate([self.raw, *self.pending]), pending=())

    def due(self, count: int, alignment: float) -> float:
        """Time after which a sample completes a frame of `count`, s."""
        return self.start + self.dt * (self.passed + count - 1 + AHEAD) + abs(alignment)


def rows_of(log: Log) -> Array:
    """Return time, angles, torques and, where there are some, rates side by side, (m, 1 + 2 n) or (m, 1 + 3 n)."""
    if log.tau is None:
        raise UsageError(log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory")
    parts = (log.t[:, None], log.q, log.tau) if log.v is None else (log.t[:, None], log.q, log.tau, log.v)
    return np.concatenate(parts, axis=1)


def interval(t: Array) -> float:
    """Sampling interval of the first samples, s: the mean of those intervals that are not lost samples."""
    steps = np.diff(t)
    return float(np.mean(steps[steps < 1.5 * np.median(steps)]))


def next_frame(grid: Grid, count: int, alignment: float, gap: float) -> tuple[Frame | None, Grid]:
    """Return the next frame, None if it is not complete yet, and the grid after it.

    Where two samples are more than `gap` s apart, the grid starts anew at the second; what was no whole frame is lost.

    Args:
        grid: Merged, its `dt` known.
        count: Samples per frame.
        alignment: Time by which the torque acts later than its stamp, s.
        gap: As above, s.
    """
    t = grid.raw[:, 0]
    last = int(np.searchsorted(t, grid.due(count, alignment), side="right"))
    # What is looked at ends there, whatever else has come: the frame does not depend on it.
    seen = grid.raw[: last + 1]
    gaps = np.flatnonzero(np.diff(seen[:, 0]) > gap)
    if not len(gaps):
        whole = last < len(t)
        return (resampled(grid, seen, count, alignment), advanced(grid, count, alignment)) if whole else (None, grid)
    cut = int(gaps[0]) + 1
    return next_frame(grid._replace(raw=grid.raw[cut:], start=float(t[cut]), passed=0), count, alignment, gap)


def advanced(grid: Grid, count: int, alignment: float) -> Grid:
    """Return the grid after a frame, without the samples that no later one looks at."""
    passed = grid.passed + count
    oldest = grid.start + grid.dt * passed - abs(alignment)
    first = max(int(np.searchsorted(grid.raw[:, 0], oldest)) - BEHIND, 0)
    return grid._replace(raw=grid.raw[first:], passed=passed)


def resampled(grid: Grid, raw: Array, count: int, alignment: float) -> Frame:
    """Interpolate a frame; the torque at the time at which it acts."""
    at = grid.start + grid.dt * (grid.passed + np.arange(count))
    n, values = grid.joints, raw[:, 1:]
    channels = signals.resample(raw[:, 0], values, at)
    torques = signals.resample(raw[:, 0] + alignment, values[:, n : 2 * n], at)
    return Frame(at, np.column_stack([channels[:, :n], torques, channels[:, 2 * n :]]), grid.passed == 0)
