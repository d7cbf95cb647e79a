"""A stretch of a log, resampled, smoothed and differentiated: what the regressor is evaluated at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.rows.filtering import Filtering
from gimbal_pin.estimation.rows.grid import Stretch
from gimbal_pin.estimation.rows.rate import fused
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.missing_samples import inside
from gimbal_pin.log.platform import Platform

Flags = NDArray[np.bool_]


class Channels(NamedTuple):
    """A stretch of a log on a uniform grid, smoothed, (m,) and (m, n); `rate_std` is the rate's own noise, (n,).

    `platform` is the motion of the base, through the same filter; None where it stands upright. `lost` flags the
    samples in holes of the log, (m,): nobody measured them; None where there is no hole.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    rate_std: Array
    platform: Platform | None = None
    lost: Flags | None = None

    def every(self, rows: slice) -> Channels:
        """Return the samples in `rows`."""
        platform = None if self.platform is None else self.platform.part(rows)
        t, q, v, a, tau = (x[rows] for x in (self.t, self.q, self.v, self.a, self.tau))
        lost = None if self.lost is None else self.lost[rows]
        return Channels(t, q, v, a, tau, self.rate_std, platform, lost)


def smoothed(stretch: Stretch, filtering: Filtering, first: int, last: int, carrier: str | None = None) -> Channels:
    """Return grid samples first ... last - 1 of a stretch: resampled, smoothed and differentiated.

    Args:
        stretch: The stretch.
        filtering: Filter and alignment.
        first: First sample of the grid.
        last: The one after the last.
        carrier: Link whose IMU says how the base moves, its rate and specific force passing the same filter.
    """
    log, dt = stretch.log, stretch.dt
    if log.tau is None:
        raise UsageError(log.name, "holds no torque (tau_<joint>)", "give a log, not a bare trajectory")
    grid = np.asarray(stretch.start + dt * np.arange(first, last), dtype=np.float64)
    near = rows_of(stretch, filtering, grid)
    t = log.t[near]
    sections = signals.lowpass(filtering.cutoff * filtering.smoothing, 1 / dt)
    raw_q = signals.resample(t, log.q[near], grid)
    q = signals.zero_phase(raw_q, sections)
    v = signals.differentiate(q, dt)
    rate_std = signals.noise_std(raw_q) * signals.noise_gain(sections, 1 / dt, 1)
    if log.v is not None:
        raw_v = signals.resample(t, log.v[near], grid)
        v, rate_std = fused(v, raw_q, raw_v, filtering.cutoff * filtering.smoothing, dt)
    tau = signals.zero_phase(torque(stretch, filtering, grid), sections)
    platform = None if carrier is None else carried(log, carrier, near, grid, sections)
    lost = inside(stretch.holes, grid) if len(stretch.holes) else None
    return Channels(grid, q, v, signals.differentiate(v, dt), tau, rate_std, platform, lost)


def aligned(stretch: Stretch, filtering: Filtering) -> float:
    """Time by which the torque acts later than its stamp, s."""
    return stretch.dt / 2 if filtering.alignment is None else filtering.alignment


def rows_of(stretch: Stretch, filtering: Filtering, grid: Array) -> slice:
    """Rows of the log that a grid is resampled from."""
    reach = 4 * stretch.dt + abs(aligned(stretch, filtering))
    begin, end = np.searchsorted(stretch.log.t, [grid[0] - reach, grid[-1] + reach])
    return slice(max(begin, stretch.rows.start), min(end, stretch.rows.stop))


def torque(stretch: Stretch, filtering: Filtering, grid: Array) -> Array:
    """The measured torque as it acts at the times of a grid, N m, (m, n), not smoothed."""
    log, near = stretch.log, rows_of(stretch, filtering, grid)
    assert log.tau is not None
    return signals.resample(log.t[near] + aligned(stretch, filtering), log.tau[near], grid)


class Logged(NamedTuple):
    """The torque of a stretch before it was smoothed, and how another comes from it to the samples of its channels.

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

    @staticmethod
    def of(stretch: Stretch, filtering: Filtering, grid: Array, step: int) -> Logged:
        """What `smoothed` was given to come to every `step`-th sample of a grid."""
        log, near = stretch.log, rows_of(stretch, filtering, grid)
        assert log.tau is not None
        cutoff = filtering.cutoff * filtering.smoothing
        sections = signals.lowpass(cutoff, 1 / stretch.dt)
        return Logged(log.t[near] + aligned(stretch, filtering), log.tau[near], grid, sections, step, cutoff)

    def smoothed(self, torque: Array) -> Array:
        """Resample and smooth a torque at the samples of the log, N m, (L,), as theirs was: (m,)."""
        even = signals.resample(self.t, torque[:, None], self.grid)
        return np.asarray(signals.zero_phase(even, self.sections)[:: self.step, 0])


def impulse(stretch: Stretch, filtering: Filtering, grid: Array) -> Array:
    """``∫τ dt - h * ∫τ dt``: what the smoother h takes off the torque's impulse, N m s, (m, n)."""
    tau = torque(stretch, filtering, grid)
    whole = cumulative_trapezoid(tau, dx=stretch.dt, axis=0, initial=0.0)
    return whole - signals.zero_phase(whole, signals.lowpass(filtering.cutoff * filtering.smoothing, 1 / stretch.dt))


def carried(log: Log, carrier: str, near: slice, grid: Array, sections: Array) -> Platform:
    """Return the base's motion on a uniform grid, smoothed like the other channels."""
    imu, t = log.imus[carrier], log.t[near]
    if imu.gyro is None or imu.accel is None:
        raise UsageError(log.name, f"lacks the gyro or the accelerometer of {carrier}", "give both, or neither")
    w, f = (signals.zero_phase(signals.resample(t, x[near], grid), sections) for x in (imu.gyro, imu.accel))
    return Platform(grid, f, w, signals.differentiate(w, float(grid[1] - grid[0])))
