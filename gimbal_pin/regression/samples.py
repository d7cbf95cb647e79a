"""A log resampled, smoothed and differentiated, segment by segment: what the regressor is evaluated at."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gimbal_pin.effects.signal import Flags
from gimbal_pin.errors import UsageError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BaseMotion, Platform
from gimbal_pin.regression.missing_samples import fill_gaps, holes, inside
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

LEAST_RATE = 200.0
"""Least rate of decimated channels, samples per second."""
LEAST_CORNERS = 6.0
"""The same in corners of the smoother."""
GAUSSIAN_REACH = 3.0
"""Reach of the compact low-pass, in its deviations."""
REST = 5e-4
"""A slow rate's deviation is taken to be at least this share of its rms: a joint at rest moves by rounding alone."""
SHORTEST_SEGMENT = 8
"""A segment of fewer samples than this is too short to estimate noise from, and its filters leave no row."""
HIGHEST_CUTOFF = 0.2
"""Highest cutoff, as a share of the sampling rate: five samples per period of the fastest motion that is looked at.

Twice as much would leave the third-order low-pass within a tenth of the rate of Nyquist's frequency.
"""
EXCERPT_SECONDS = 120.0
"""Time that is looked at, s, or as many rows as that has at `LEAST_RATE`."""
EXCERPT_PARTS = 8
"""Stretches: 15 s each, forty times what filters lose at their ends; a drift is seen at eight times."""
EXCERPT_FROM = 2.0
"""Logs of so many times that are not looked at as a whole: what is left out between two segments is then a pause."""


@dataclass(frozen=True)
class Filtering:
    """How a log becomes rows.

    Attributes:
        cutoff: Low-pass on every column and on the torque, Hz.
        smoothing: Low-pass on the channels before they are differentiated, in multiples of the cutoff.
        alignment: Time by which the torque acts later than its stamp, s; None: half a sample, for a torque that is
            held from its sample to the next.
        lags: By how much later than that each joint's torque acts, s, (n,), see `align_rows`; empty: none.
        direction: Low-pass on the rate whose sign dry friction takes, in multiples of the cutoff; None: the smoother's.
            A rate full of noise tells no sign, its slow part does.
        compact: Rows through a Gaussian with the same half at the cutoff, in the place of Butterworth's: it falls more
            slowly, and forgets an edge in a fifth of the time, for checks that have to do with seconds of a log.
    """

    cutoff: float = 4.0
    smoothing: float = 8.0
    alignment: float | None = None
    lags: tuple[float, ...] = ()
    direction: float | None = None
    compact: bool = False


def limit_cutoff(
    filtering: Filtering, logs: Sequence[Log], share: float = HIGHEST_CUTOFF
) -> Filtering:
    """Return a filter whose cutoff is at most a share of the sampling rate of the slowest of some logs."""
    highest = [share / log.dt for log in logs if len(log) > 1]
    return replace(filtering, cutoff=min([filtering.cutoff, *highest]))


def compute_settling_time(filtering: Filtering) -> float:
    """Time around a sample that its row depends on, s: both filters' memory."""
    own = GAUSSIAN_REACH * _compute_gaussian_deviation(filtering.cutoff)
    own = own if filtering.compact else signals.compute_lowpass_settling(filtering.cutoff)
    return own + signals.compute_lowpass_settling(filtering.cutoff * filtering.smoothing)


def _compute_gaussian_deviation(cutoff: float) -> float:
    """Deviation of the Gaussian whose response is one half at a cutoff, s: ``√(ln 2 / 2) / (π f)``."""
    return float(np.sqrt(np.log(2.0) / 2.0) / (np.pi * cutoff))


class SelectiveFilter(Protocol):
    """A low-pass along the first axis of which only some rows are wanted."""

    def __call__(self, signal: Array, rows: slice) -> Array:
        """Return these rows of the filtered signal."""


def design_row_filter(filtering: Filtering, rate: float) -> SelectiveFilter:
    """Return the low-pass that makes rows, for samples at `rate` Hz."""
    if not filtering.compact:
        return partial(filter_rows, sections=signals.lowpass(filtering.cutoff, rate))
    return partial(_smooth_rows, deviation=_compute_gaussian_deviation(filtering.cutoff) * rate)


def filter_rows(signal: Array, rows: slice, sections: Array) -> Array:
    """Return some rows of a signal that was run through sections forwards and backwards."""
    return signals.zero_phase(signal, sections)[rows]


def _smooth_rows(signal: Array, rows: slice, deviation: float) -> Array:
    """Return some rows of a signal, (m, ...), under a Gaussian of so many samples; its ends are held beyond them."""
    reach = int(GAUSSIAN_REACH * deviation + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    padded = np.pad(signal, [(reach, reach), *[(0, 0)] * (signal.ndim - 1)], mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(kernel), axis=0)
    return np.asarray(windows[rows] @ (kernel / kernel.sum()))


def compute_decimation(filtering: Filtering, dt: float) -> int:
    """Return the whole factor by which smoothed channels can be decimated: to `LEAST_CORNERS` of the smoother.

    Of what folds back into the band the noise of the acceleration, which rises with f², is the largest. At a rate of r
    corners c of a smoother of order 3, run twice, it comes from near r c and has ``r² / (1 + r⁶)`` of what it
    has at the corner: 1/1300 at 6. Columns that jump are smoothed before, at the full rate. Beside it, `LEAST_RATE`.
    """
    return max(
        1,
        int(
            1.000001
            / (max(LEAST_RATE, LEAST_CORNERS * filtering.cutoff * filtering.smoothing) * dt)
        ),
    )


def compute_row_step(filtering: Filtering, dt: float) -> int:
    """Samples from row to row, a whole number of decimated ones: half a period of the cutoff, or nearly so."""
    thin = compute_decimation(filtering, dt)
    return thin * max(1, round(1.0 / (2 * filtering.cutoff * dt * thin)))


class Segment(NamedTuple):
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


def split_segments(log: Log, cutoff: float, across: float = 0.0) -> Iterator[Segment]:
    """Yield the parts of a log between holes; what the motion itself closes is none.

    Args:
        log: The log.
        cutoff: Highest frequency that will be looked at, Hz.
        across: Holes up to so long, s, do not part it either: for those who only look at what was measured.
    """
    if len(log) < SHORTEST_SEGMENT:
        return
    log, closed = fill_gaps(log, cutoff)
    dt = log.dt
    gaps = holes(log, cutoff)
    ends = np.stack([log.t[gaps], log.t[gaps + 1]], axis=1)
    passed = ends[:, 1] - ends[:, 0] <= across
    closed = np.sort(np.concatenate([closed, ends[passed]]), axis=0)
    edges = [0, *(gaps[~passed] + 1).tolist(), len(log)]
    for first, last in itertools.pairwise(edges):
        if last - first >= SHORTEST_SEGMENT:
            span = log.t[last - 1] - log.t[first]
            count = int(span / dt * (1 + 1e-9)) + 1
            # The grid's own interval makes it end on the last sample: an interval rounded from jitter would drift.
            yield Segment(
                log,
                slice(first, last),
                float(log.t[first]),
                float(span / (count - 1)),
                count,
                closed,
            )


class Samples(NamedTuple):
    """A segment of a log on a uniform grid, smoothed, (m,) and (m, n).

    `slide` is the rate whose sign dry friction takes, `rate_std` that rate's own noise, (n,). `platform` is the motion
    of the base, through the same filter; None where it stands upright. `lost` flags the samples in holes of the log,
    (m,), which were not measured; None where there is no hole.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    slide: Array
    rate_std: Array
    platform: Platform | None = None
    lost: Flags | None = None

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    def select(self, rows: slice) -> Samples:
        """Return the samples in `rows`."""
        platform = None if self.platform is None else self.platform.part(rows)
        t, q, v, a, tau, slide = (
            x[rows] for x in (self.t, self.q, self.v, self.a, self.tau, self.slide)
        )
        lost = None if self.lost is None else self.lost[rows]
        return Samples(t, q, v, a, tau, slide, self.rate_std, platform, lost)


def smooth_samples(
    segment: Segment, filtering: Filtering, first: int, last: int, base_link: str | None = None
) -> Samples:
    """Return grid samples first ... last - 1 of a segment: resampled, smoothed and differentiated.

    Args:
        segment: The segment.
        filtering: Filter and alignment.
        first: First sample of the grid.
        last: The one after the last.
        base_link: Link whose IMU says how the base moves, its rate and specific force passing the same filter.
    """
    log = segment.log
    dt = segment.dt
    if log.tau is None:
        raise UsageError(
            log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory"
        )
    grid = np.asarray(segment.start + dt * np.arange(first, last), dtype=np.float64)
    near = _find_log_rows(segment, filtering, grid)
    t = log.t[near]
    sections = signals.lowpass(filtering.cutoff * filtering.smoothing, 1 / dt)
    raw_q = signals.resample(t, log.q[near], grid)
    q = signals.zero_phase(raw_q, sections)
    v = signals.differentiate(q, dt)
    rate_std = signals.noise_std(raw_q) * signals.compute_noise_gain(sections, 1 / dt, 1)
    if log.v is not None:
        raw_v = signals.resample(t, log.v[near], grid)
        v, rate_std = _fuse_rates(v, raw_q, raw_v, filtering.cutoff * filtering.smoothing, dt)
    slide = v
    if filtering.direction is not None:
        slower = signals.lowpass(filtering.cutoff * filtering.direction, 1 / dt)
        slide = signals.zero_phase(v, slower)
        noise = signals.noise_std(raw_q) * signals.compute_noise_gain(slower, 1 / dt, 1)
        rate_std = np.maximum(noise, REST * np.sqrt(np.mean(slide**2, axis=0)))
    tau = signals.zero_phase(resample_torque(segment, filtering, grid), sections)
    platform = (
        None if base_link is None else _resample_base_motion(log, base_link, near, grid, sections)
    )
    lost = inside(segment.holes, grid) if len(segment.holes) else None
    return Samples(grid, q, v, signals.differentiate(v, dt), tau, slide, rate_std, platform, lost)


def _compute_torque_delay(filtering: Filtering, dt: float) -> float:
    """Time by which the torque acts later than its stamp, lags aside, s."""
    return dt / 2 if filtering.alignment is None else filtering.alignment


def compute_reach(filtering: Filtering, dt: float) -> float:
    """Time around a sample of the grid from which it is resampled, s: four samples, and the torque's delay."""
    return (
        4 * dt
        + abs(_compute_torque_delay(filtering, dt))
        + max(map(abs, filtering.lags), default=0.0)
    )


def _find_log_rows(segment: Segment, filtering: Filtering, grid: Array) -> slice:
    """Rows of the log that a grid is resampled from."""
    reach = compute_reach(filtering, segment.dt)
    begin, end = np.searchsorted(segment.log.t, [grid[0] - reach, grid[-1] + reach])
    return slice(max(begin, segment.rows.start), min(end, segment.rows.stop))


def resample_torque(segment: Segment, filtering: Filtering, grid: Array) -> Array:
    """The measured torque as it acts at the times of a grid, N m, (m, n), not smoothed."""
    log = segment.log
    near = _find_log_rows(segment, filtering, grid)
    assert log.tau is not None
    t = log.t[near] + _compute_torque_delay(filtering, segment.dt)
    tau = log.tau[near]
    if not any(filtering.lags):
        return signals.resample(t, tau, grid)
    return np.column_stack(
        [signals.resample(t + lag, x[:, None], grid) for lag, x in zip(filtering.lags, tau.T)]
    )


class UnfilteredTorque(NamedTuple):
    """The torque of a segment before it was smoothed, and how another comes from it to the samples of its channels.

    Attributes:
        t: Times at which the samples of the log act, s, (L,).
        tau: Its torque, N m, (L, n).
        grid: The uniform grid on which it is smoothed, s, (M,).
        sections: The smoother.
        step: Samples of the grid from one of the channels to the next.
        cutoff: Of the smoother, Hz.
    """

    t: Array
    tau: Array
    grid: Array
    sections: Array
    step: int
    cutoff: float

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @staticmethod
    def of(segment: Segment, filtering: Filtering, grid: Array, step: int) -> UnfilteredTorque:
        """What `smooth_samples` was given to come to every `step`-th sample of a grid."""
        log = segment.log
        near = _find_log_rows(segment, filtering, grid)
        assert log.tau is not None
        cutoff = filtering.cutoff * filtering.smoothing
        sections = signals.lowpass(cutoff, 1 / segment.dt)
        return UnfilteredTorque(
            log.t[near] + _compute_torque_delay(filtering, segment.dt),
            log.tau[near],
            grid,
            sections,
            step,
            cutoff,
        )

    def smoothed(self, torque: Array, late: float = 0.0) -> Array:
        """Return torques at the log's samples, N m, (L, k), resampled and smoothed, (m, k); `late`: delay, s."""
        even = signals.resample(self.t + late, torque, self.grid)
        return np.asarray(signals.zero_phase(even, self.sections)[:: self.step])


def compute_lost_impulse(segment: Segment, filtering: Filtering, grid: Array) -> Array:
    """``∫τ dt - h * ∫τ dt``: what the smoother h takes off the torque's impulse, N m s, (m, n)."""
    tau = resample_torque(segment, filtering, grid)
    whole = cumulative_trapezoid(tau, dx=segment.dt, axis=0, initial=0.0)
    return whole - signals.zero_phase(
        whole, signals.lowpass(filtering.cutoff * filtering.smoothing, 1 / segment.dt)
    )


def _resample_base_motion(
    log: Log, base_link: str, near: slice, grid: Array, sections: Array
) -> Platform:
    """Return the base's motion on a uniform grid, smoothed like the other channels."""
    imu = log.imus[base_link]
    t = log.t[near]
    if imu.gyro is None or imu.accel is None:
        raise UsageError(
            log.name, f"lacks the gyro or the accelerometer of {base_link}", "give both, or neither"
        )
    w, f = (
        signals.zero_phase(signals.resample(t, x[near], grid), sections)
        for x in (imu.gyro, imu.accel)
    )
    return Platform(grid, f, w, signals.differentiate(w, float(grid[1] - grid[0])))


def _fuse_rates(
    derived: Array, raw_q: Array, raw_v: Array, cutoff: float, dt: float
) -> tuple[Array, Array]:
    """Combine the angle's derivative with the measured rate; return rate and its standard deviation.

    The derivative of an angle with white noise σ_q is the better rate below the frequency where 2π f σ_q = σ_v, the
    measured rate above it: a complementary filter at that crossover takes each where it is better, and removes a
    gyro's bias on the way. A column of one value throughout has no noise to weigh it by and is no measurement: where
    the joint is held, the angle says so, too.
    """
    sections = signals.lowpass(cutoff, 1 / dt)
    angle_noise = signals.noise_std(raw_q)
    rate_noise = signals.noise_std(raw_v)
    rate = signals.zero_phase(raw_v, sections)
    rate_std = rate_noise * signals.compute_noise_gain(sections, 1 / dt, 0)
    out = rate.copy()
    difference = derived - rate
    # The smoothed angle is wrong at its two ends; a slow crossover would carry that far inwards.
    edge = min(round(signals.compute_lowpass_settling(cutoff) / dt), len(rate) // 2 - 1)
    difference[:edge], difference[-edge:] = difference[edge], difference[-edge - 1]
    for j, (sigma_q, sigma_v) in enumerate(zip(angle_noise, rate_noise)):
        crossover = sigma_v / (2 * np.pi * max(sigma_q, 1e-12))
        measured = np.ptp(raw_v[:, j]) > 0
        if measured and crossover * dt < 1e-4:
            continue
        if not measured or crossover * dt > 0.4:
            out[:, j] = derived[:, j]
            rate_std[j] = angle_noise[j] * signals.compute_noise_gain(sections, 1 / dt, 1)
            continue
        slow = signals.lowpass(crossover, 1 / dt)
        out[:, j] += signals.zero_phase(difference[:, j : j + 1], slow)[:, 0]
    return out, rate_std


def find_moving_base(rig: Rig, log: Log) -> str | None:
    """Return the base link if its IMU says that the base moves or leans; None where it stands or has no IMU."""
    return None if classify_base_motion(rig, log) == "fixed" else rig.base


def classify_base_motion(rig: Rig, log: Log) -> BaseMotion:
    """Return what the base does in a log, as its IMU says; "fixed" where it has none."""
    imu = log.imus.get(rig.base)
    if imu is None or imu.gyro is None or imu.accel is None or len(log) < SHORTEST_SEGMENT:
        return "fixed"
    return Platform.measured(log.t, imu, log.name).motion


class Excerpt(NamedTuple):
    """A log to look at, and what was used of a longer one: nothing to be said where it is the whole."""

    log: Log
    note: str = ""


def subsample_log(log: Log, used: float = EXCERPT_SECONDS, count: int = EXCERPT_PARTS) -> Excerpt:
    """Return segments that last `used` seconds together, spread evenly over the rows, the first and the last included.

    They are one log with pauses, so that filters end there. A log of less than `EXCERPT_FROM` times that is returned
    whole.
    """
    rows = round(used / count / min(log.dt if len(log) > 1 else np.inf, 1.0 / LEAST_RATE))
    if len(log) <= EXCERPT_FROM * count * rows:
        return Excerpt(log)
    starts = np.linspace(0, len(log) - rows, count).round().astype(int)
    note = f"{log.name}: used {count} segments of {rows * log.dt:.3g} s out of {len(log) * log.dt / 60:.3g} min"
    return Excerpt(log.part((starts[:, None] + np.arange(rows)).ravel()), note)
