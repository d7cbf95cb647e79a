"""Samples to frames on a uniform grid to rows, causally: what `Design` does to a whole log, as it is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter, sosfilt, sosfilt_zi

from gimbal_pin.dynamics.reduction import samples
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    MASK_TAPER,
    SMOOTHER_MEMORY,
    Design,
    Filtering,
    Samples,
    build_mask,
    compute_settling_time,
    find_standstill,
)
from gimbal_pin.rig.brief import brief

FIRST = 64
"""Samples whose intervals tell the sampling interval."""
BEHIND, AHEAD = 3, 3.0
"""Samples kept before a frame, and intervals waited for after it: the interpolation looks at two on either side."""
SETTLING = 1.5
"""Time to skip after a start, in memories of the batch's filters: what runs forwards twice forgets later."""
NOISE = 64
"""Samples before a frame from which its noise is estimated, too."""
AVERAGED = 5.0
"""Time over which the noise of the sensors is averaged, s."""
CENTRAL = 4
"""Samples that a central difference of a central difference looks ahead and back."""


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

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

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


class Blockwise(NamedTuple):
    """Second-order sections over blocks of one length as one matrix: ``[y; z'] = M [z; x]``, z the sections' memory.

    A product of small matrices takes a tenth of the time of the recursion, and gives the same to rounding.
    """

    matrix: Array
    rest: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @staticmethod
    def of(sections: Array, count: int, last: bool = False) -> Blockwise:
        """Return it for blocks of `count` samples, of whose output all or the last is wanted."""
        size = 2 * len(sections)
        inputs = np.hstack([np.zeros((count, size)), np.eye(count)])
        memory = np.hstack([np.eye(size), np.zeros((size, count))]).reshape(len(sections), 2, -1)
        out, memory = sosfilt(sections, inputs, axis=0, zi=memory)
        return Blockwise(np.vstack([out[-1 if last else 0 :], memory.reshape(size, -1)]), sosfilt_zi(sections).ravel())

    def at_rest(self, x: Array) -> Array:
        """Memory after x, (c,), has stood for ever, (2 s, c)."""
        return np.outer(self.rest, x)

    def __call__(self, x: Array, memory: Array) -> tuple[Array, Array]:
        """Return the output for a block x, (count, c), and the memory after it."""
        both = self.matrix @ np.concatenate([memory, x])
        return both[: -len(memory)], both[-len(memory) :]


class Row(NamedTuple):
    """One row per joint: time, s, of the motion that it speaks of; ``[A b share]``, (n, k + 2); rates, rad/s, (n,)."""

    t: float
    values: Array
    v: Array

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)


@dataclass(frozen=True, eq=False)
class StreamDesign:
    """What follows from the rig, the filters and the sampling interval: constants.

    Attributes:
        rows: Rig, base parameters, effects and filters.
        dt: Sampling interval, s.
        count: Samples per frame and row: half a period of the cutoff.
        smoother: The smoother, twice.
        lowpass: The low-pass, twice; its last output alone.
        delay: Samples by which the smoother delays.
        look: Samples that the mask looks ahead and back.
        skip: Samples after a start that give no row.
        gains: Standard deviation of a rate from an angle's, 1/s, and from a rate's.
        present: Columns that a joint can feel, (n, k).
        alignment: Time by which the torque acts later than its stamp, s.
    """

    rows: Design
    dt: float
    count: int
    smoother: Blockwise
    lowpass: Blockwise
    delay: int
    look: int
    skip: int
    gains: tuple[float, float]
    present: Array
    alignment: float

    __repr__ = brief

    @property
    def filtering(self) -> Filtering:
        """The filters."""
        return self.rows.filtering

    @property
    def taper(self) -> int:
        """Samples over which the mask opens."""
        return round(MASK_TAPER / (self.filtering.cutoff * self.dt))

    @property
    def gap(self) -> float:
        """Time between two samples from which on the second starts anew, s: as for the batch."""
        return max(4.5 * self.dt, 0.1 / self.filtering.cutoff)


def designed(rows: Design, dt: float) -> StreamDesign:
    """Return the constants for a sampling interval."""
    filtering, rate = rows.filtering, 1 / dt
    once = signals.lowpass(filtering.cutoff * filtering.smoothing, rate)
    slow = signals.lowpass(filtering.cutoff, rate)
    twice = np.concatenate([once, once])
    count = max(1, round(rate / (2 * filtering.cutoff)))
    half = max(round(MASK_TAPER / filtering.cutoff * rate) // 2, 1)
    reach = int(np.ceil(SMOOTHER_MEMORY / (filtering.cutoff * filtering.smoothing * dt)))
    return StreamDesign(
        rows=rows,
        dt=dt,
        count=count,
        smoother=Blockwise.of(twice, count),
        lowpass=Blockwise.of(np.concatenate([slow, slow]), count, last=True),
        delay=delay(twice),
        look=reach + 2 * half + 2 * (half // 2) + 1,
        skip=int(np.ceil(SETTLING * compute_settling_time(filtering) * rate)),
        gains=(signals.compute_noise_gain(once, rate, 1), signals.compute_noise_gain(once, rate, 0)),
        present=present(rows),
        alignment=dt / 2 if filtering.alignment is None else filtering.alignment,
    )


def delay(sections: Array) -> int:
    """Samples by which a low-pass delays what is slow: the mean time of its impulse response."""
    response = sosfilt(sections, np.eye(1, 4096)[0])
    return round(float(response @ np.arange(4096) / response.sum()))


def present(rows: Design) -> Array:
    """Which joint feels which column at all, (n, k)."""
    q, v, a = samples(rows.rig)
    channels = Samples(np.zeros(len(q)), q, v, a, v, v, np.zeros(rows.rig.n))
    columns = np.concatenate([rows.compute_rigid_columns(channels), rows.compute_effect_columns(channels)], axis=2)
    return np.any(columns != 0.0, axis=0)


class Noise(NamedTuple):
    """Variance of the white noise on angles and rates, (2, n), and the frames that it was averaged over."""

    variance: Array
    frames: int

    def after(self, raw: Array, gain: float) -> Noise:
        """Return it after more samples, (m, 2 n); a frame in which a sensor stood still tells nothing of it."""
        found = np.reshape(signals.noise_std(raw) ** 2, self.variance.shape)
        step = np.where(self.variance > 0, max(1.0 / (self.frames + 1), gain), 1.0)
        return Noise(
            np.where(found > 0, self.variance + step * (found - self.variance), self.variance), self.frames + 1
        )


@dataclass(frozen=True, eq=False)
class Running:
    """Memory of the filters since the last gap: arrays of fixed sizes.

    Attributes:
        raw: Newest samples of angles and rates, for their noise, (NOISE, 2 n).
        smoother: Of angles, torques and rates.
        window: The last `CENTRAL` of these, smoothed.
        rates: The last `CENTRAL` rates.
        slow: Of the complementary filter between the angles' derivative and the rates, (n,).
        waiting: Channels that wait for the mask.
        jumping: Smoother of the columns that jump; None before they first come.
        lowpass: Of columns, torque and mask.
        passed: Samples that left `waiting`, those skipped included.
    """

    raw: Array
    smoother: Array
    window: Array
    rates: Array
    slow: Array
    waiting: Samples
    jumping: Array | None
    lowpass: Array
    passed: int = 0

    __repr__ = brief


def initial_state(design: StreamDesign, frame: Frame) -> Running:
    """Return the memory at a first frame: as if the first sample had stood for ever."""
    n, first = design.rows.rig.n, frame.channels[0]
    width = int(design.present.sum()) + 2 * n
    nothing = np.zeros((0, n))
    return Running(
        raw=np.zeros((0, 2 * n)),
        smoother=design.smoother.at_rest(first),
        window=np.tile(first, (CENTRAL, 1)),
        rates=np.zeros((CENTRAL, n)),
        slow=np.zeros(n),
        waiting=Samples(np.zeros(0), *(nothing,) * 5, np.zeros(n)),
        jumping=None,
        lowpass=design.lowpass.at_rest(np.zeros(width)),
    )


def process_frame(
    design: StreamDesign, running: Running | None, noise: Noise, frame: Frame
) -> tuple[Row | None, Running, Noise]:
    """Take one frame: its row, None while the filters settle, and the memory after it."""
    if running is None or frame.fresh:
        running = initial_state(design, frame)
    n, count = design.rows.rig.n, design.count
    measured = frame.channels[:, 2 * n :] if frame.channels.shape[1] > 2 * n else np.zeros((count, n))
    raw = np.concatenate([running.raw, np.column_stack([frame.channels[:, :n], measured])])
    noise = noise.after(raw, count * design.dt / AVERAGED)
    state = smoothed(design, running, noise, frame)
    state["raw"] = raw[-NOISE:]
    running = Running(**{**vars(running), **state})
    ready = len(running.waiting.t) >= 2 * design.look + count
    row, running = emit_row(design, running) if ready else (None, running)
    return (row if running.passed > design.skip else None), running, noise


def smoothed(design: StreamDesign, running: Running, noise: Noise, frame: Frame) -> dict[str, Any]:
    """Smooth and differentiate a frame; return what changes in the memory, the channels appended to those waiting."""
    n, dt = design.rows.rig.n, design.dt
    filtered, smoother = design.smoother(frame.channels, running.smoother)
    window = np.concatenate([running.window, filtered])
    v = signals.differentiate_centrally(window[:, :n], dt)
    slow, std = running.slow, np.sqrt(noise.variance[0]) * design.gains[0]
    if window.shape[1] > 2 * n:
        v, slow, std = fused(design, noise, v, window[2:-2, 2 * n :], slow)
    rates = np.concatenate([running.rates, v])
    a = signals.differentiate_centrally(rates, dt)
    late, old = CENTRAL + design.delay, running.waiting
    waiting = Samples(
        t=np.concatenate([old.t, frame.t - late * dt]),
        q=np.concatenate([old.q, window[:-CENTRAL, :n]]),
        v=np.concatenate([old.v, rates[2:-2]]),
        a=np.concatenate([old.a, a]),
        tau=np.concatenate([old.tau, window[:-CENTRAL, n : 2 * n]]),
        slide=np.concatenate([old.v, rates[2:-2]]),
        rate_std=std,
    )
    tails = {"window": window[-CENTRAL:], "rates": rates[-CENTRAL:]}
    return {"smoother": smoother, "slow": slow, "waiting": waiting, **tails}


def fused(design: StreamDesign, noise: Noise, derived: Array, rate: Array, slow: Array) -> tuple[Array, Array, Array]:
    """Combine the angle's derivative with the measured rate, each where it is better, as `regression.samples` does.

    ``v = rate + L (derived - rate)`` with a low-pass L of first order at the crossover 2π f = σ_v/σ_q, the steady
    Kalman filter of an angle and its rate; its memory is its output, so that the crossover may follow the noise.

    Returns:
        Rates; the memory of L; the rates' standard deviation.
    """
    angle, measured = np.sqrt(noise.variance)
    crossover = measured / np.maximum(angle, 1e-12)
    share = -np.expm1(-crossover * design.dt)
    rate_std = measured * design.gains[1]
    out, last = np.empty_like(rate), np.empty_like(slow)
    for j, gain in enumerate(np.clip(share, 1e-9, 1.0).tolist()):
        if measured[j] == 0 or crossover[j] * design.dt > 0.8 * np.pi:
            gain, rate_std[j] = 1.0, angle[j] * design.gains[0]
        difference = derived[:, j] - rate[:, j]
        low, _ = lfilter([gain], [1.0, gain - 1.0], difference, zi=[(1.0 - gain) * slow[j]])
        out[:, j], last[j] = rate[:, j] + low, low[-1]
    return out, last, rate_std


def emit_row(design: StreamDesign, running: Running) -> tuple[Row, Running]:
    """Turn the next frame that has waited long enough into columns, filter these, and keep the last as a row."""
    look, count, waiting = design.look, design.count, running.waiting
    here = slice(look, look + count)
    channels = waiting.select(here)
    moving = build_mask(find_standstill(waiting, design.filtering), design.taper)[here]
    ahead = waiting.select(slice(look + design.delay, look + design.delay + count))
    jumping, memory = smoothed_jumps(design, running.jumping, design.rows.compute_effect_columns(ahead))
    A = np.concatenate([design.rows.compute_rigid_columns(channels), jumping], axis=2) * moving[:, :, None]
    tau = channels.tau - design.rows.compute_stated_torque(channels)
    flat = np.column_stack([A[:, design.present], tau * moving, moving])
    filtered, lowpass = design.lowpass(flat, running.lowpass)
    n, width = design.present.shape
    values = np.zeros((n, width + 2))
    values[:, :-2][design.present] = filtered[-1, : -2 * n]
    values[:, -2], values[:, -1] = filtered[-1, -2 * n : -n], np.clip(filtered[-1, -n:], 0.0, 1.0)
    row = Row(float(channels.t[-1]), values, channels.v[-1].copy())
    rest = waiting.select(slice(count, None))
    state = {"waiting": rest, "jumping": memory, "lowpass": lowpass, "passed": running.passed + count}
    return row, Running(**{**vars(running), **state})


def smoothed_jumps(design: StreamDesign, memory: Array | None, columns: Array) -> tuple[Array, Array]:
    """Smooth the effects' columns, (F, n, e), which jump where a joint turns, as the torque was smoothed."""
    felt = design.present[:, -columns.shape[2] :]
    flat = columns[:, felt]
    out = np.zeros_like(columns)
    out[:, felt], after = design.smoother(flat, design.smoother.at_rest(flat[0]) if memory is None else memory)
    return out, after
