"""From logs to regression rows: the same filter on every column and on the torque, chunk by chunk.

log → uniform grid → smoothed q, v, a → columns at full rate → low-pass → one row every half period of the cutoff
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from gimbal_pin import signals
from gimbal_pin.effects import Effect, Sample
from gimbal_pin.errors import UsageError
from gimbal_pin.holes import filled, holes, inside
from gimbal_pin.log import Array, Log
from gimbal_pin.platform import BaseMotion, Platform
from gimbal_pin.reduction import Reduction
from gimbal_pin.regressor import columns, regressor, rnea
from gimbal_pin.rig import Rig

Flags = NDArray[np.bool_]

CHUNK = 4096
SHORTEST = 8
"""A stretch of fewer samples than this has no noise that could be told, and no row survives its filters."""
STANDSTILL = 4.0
"""A rate under this many of its own standard deviations does not tell its sign."""
TAPER = 0.5
"""Width over which the mask around a standstill opens, in periods of the cutoff."""
MEMORY = 0.5
"""Reach of the smoother around a standstill, in periods of its cutoff."""


@dataclass(frozen=True)
class Filtering:
    """How a log becomes rows.

    Attributes:
        cutoff: Low-pass on every column and on the torque, Hz.
        smoothing: Low-pass on the channels before they are differentiated, in multiples of the cutoff.
        alignment: Time by which the torque acts later than its stamp, s; None: half a sample, for a torque that is
            held from its sample to the next.
    """

    cutoff: float = 4.0
    smoothing: float = 8.0
    alignment: float | None = None


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


class Block(NamedTuple):
    """Rows of one stretch of one trajectory.

    Attributes:
        t: Time, s, (m,).
        A: Torque per parameter, filtered, (m, n, k).
        b: Torque, filtered, N m, (m, n).
        v: Rates, rad/s, (m, n).
        share: How much of a row's samples were not masked out, in [0, 1], (m, n).
    """

    t: Array
    A: Array
    b: Array
    v: Array
    share: Array


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


@dataclass(frozen=True, eq=False)
class Rows:
    """The regression ``A theta = b`` of logs against base parameters and effects; iterating recomputes the blocks.

    Attributes:
        rig: The rig.
        reduction: Its base parameters.
        effects: Effects whose coefficients follow the base parameters in theta.
        logs: Trajectories, never joined.
        filtering: Filter and alignment.
        masked: Leave out what dry friction makes unpredictable: a joint at rest takes any torque within its dry
            friction without moving, so near standstill its motion does not tell the torque. False: every sample, with
            the sign of the rate as it is, for those who want to see all.
    """

    rig: Rig
    reduction: Reduction
    effects: tuple[Effect, ...]
    logs: tuple[Log, ...]
    filtering: Filtering
    masked: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta: base parameters, then ``joint.coefficient``."""
        return self.reduction.base_names + tuple(
            f"{effect.joint}.{coefficient.name}" for effect in self.effects for coefficient in effect.coefficients
        )

    def __iter__(self) -> Iterator[Block]:
        """Yield the blocks of every trajectory in time order."""
        for log in self.logs:
            carrier = carrying(self.rig, log)
            for stretch in stretches(log, self.filtering.cutoff):
                yield from self.blocks(stretch, carrier)

    def blocks(self, stretch: Stretch, carrier: str | None = None) -> Iterator[Block]:
        """Yield one stretch's blocks; each is computed with enough samples around it for the filters to settle.

        Args:
            stretch: The stretch.
            carrier: The link whose IMU says how the base moves, see `carrying`.
        """
        pad = int(np.ceil(settling(self.filtering) / stretch.dt))
        step = max(1, round(1.0 / (2 * self.filtering.cutoff * stretch.dt)))
        for begin in range(pad, stretch.length - pad, CHUNK):
            end = min(begin + CHUNK, stretch.length - pad)
            first, last = begin - pad, end + pad
            channels = smoothed(stretch, self.filtering, first, last, carrier)
            keep = slice(pad + -begin % step, pad + end - begin, step)
            if keep.start < keep.stop:
                yield self.block(channels, keep, 1.0 / stretch.dt)

    def block(self, channels: Channels, keep: slice, rate: float) -> Block:
        """Return the rows at the samples `keep` of the channels.

        A joint's equation holds at every sample, so it may be multiplied by any mask before the filter: the samples
        near standstill, where the direction of dry friction is unknown, are masked out, and the equation stays exact.
        """
        still = standstill(channels, self.filtering)
        # The torque has been smoothed with the channels; columns that jump where a joint turns must be, too.
        smoother = signals.lowpass(self.filtering.cutoff * self.filtering.smoothing, rate)
        jumping = signals.zero_phase(self.effect_columns(channels), smoother)
        rigid = self.rigid_columns(channels)
        tau = channels.tau - self.unfitted(channels, rigid)
        A = np.concatenate([rigid, jumping], axis=2)
        moving = mask(still, round(TAPER / self.filtering.cutoff * rate)) if self.masked else np.ones(still.shape)
        A *= moving[:, :, None]
        sections = signals.lowpass(self.filtering.cutoff, rate)
        present = np.any(A != 0.0, axis=0)
        filtered = np.zeros((len(range(*keep.indices(len(A)))), *A.shape[1:]))
        filtered[:, present] = signals.zero_phase(A[:, present], sections)[keep]
        b, share = (signals.zero_phase(x, sections)[keep] for x in (tau * moving, moving))
        # Copies: a view would keep the whole chunk alive behind the few rows that it shows.
        return Block(channels.t[keep].copy(), filtered, b.copy(), channels.v[keep].copy(), np.clip(share, 0.0, 1.0))

    def rigid_columns(self, channels: Channels) -> Array:
        """Base columns of the regressor, (m, n, b)."""
        places = columns_of(self.rig, self.reduction)
        return regressor(self.rig, channels.q, channels.v, channels.a, channels.platform)[:, :, places]

    def unfitted(self, channels: Channels, rigid: Array) -> Array | float:
        """``Y phi - Y_base beta`` of the rig as given, N m, (m, n): what its base parameters do not hold.

        Nothing, unless the base moves in a way that shows parameters which are not among them: these stay as given.
        """
        if channels.platform is None or self.reduction.base == "rotating":
            return 0.0
        whole = rnea(self.rig, channels.q, channels.v, channels.a, channels.platform)
        return whole - rigid @ (self.reduction.mixing @ self.rig.phi[columns(self.rig)[1]])

    def effect_columns(self, channels: Channels) -> Array:
        """Columns of the effects, (m, n, e)."""
        slide = np.sign(channels.v)
        width = sum(len(effect.coefficients) for effect in self.effects)
        out, column = np.zeros((*channels.q.shape, width)), 0
        for effect in self.effects:
            j = self.rig.joint_index(effect.joint)
            at = Sample(channels.t, *(x[:, j] for x in (channels.q, channels.v, channels.a, slide, channels.tau)))
            for basis in effect.basis(at):
                out[:, j, column] = basis
                column += 1
        return out


def standstill(channels: Channels, filtering: Filtering) -> Flags:
    """Samples at which the smoothed rate does not tell its sign, or that nobody measured, (m, n).

    It is under a few of its own standard deviations, or changes its sign, or is within the smoother's memory of such
    a place: smoothing rounds the corners of a joint that sticks, and carries what fills a hole to its neighbours.
    """
    still = np.abs(channels.v) < STANDSTILL * channels.rate_std
    still[1:] |= channels.v[1:] * channels.v[:-1] < 0
    if channels.lost is not None:
        still |= channels.lost[:, None]
    reach = int(np.ceil(MEMORY / (filtering.cutoff * filtering.smoothing * (channels.t[1] - channels.t[0]))))
    return dilated(still, reach)


def mask(still: Flags, taper: int) -> Array:
    """Weight 0 at standstill, rising smoothly to 1 over `taper` samples, (m, n).

    A mask with sharp edges would fold the noise above the cutoff into the band that the filter keeps.
    """
    half = max(taper // 2, 1)
    opened = 1.0 - dilated(still, 2 * half)
    for _ in range(2):
        opened = uniform_filter1d(opened, 2 * (half // 2) + 1, axis=0, mode="nearest")
    return np.where(still, 0.0, np.clip(opened, 0.0, 1.0))


def dilated(still: Flags, reach: int) -> Flags:
    """Whether a sample is within `reach` samples of one of `still`, (m, n)."""
    return uniform_filter1d(still.astype(float), 2 * reach + 1, axis=0, mode="constant") > 1e-9


def columns_of(rig: Rig, reduction: Reduction) -> Array:
    """Places in `Rig.phi` of the reduction's independent columns."""
    names, places = columns(rig)
    index = dict(zip(names, places))
    return np.array([index[reduction.names[j]] for j in reduction.independent])


def carrying(rig: Rig, log: Log) -> str | None:
    """Return the base link if its IMU says that the base moves or leans; None where it stands or nobody says."""
    return None if base_motion(rig, log) == "fixed" else rig.base


def base_motion(rig: Rig, log: Log) -> BaseMotion:
    """Return what the base does in a log, as its IMU says; "fixed" where it has none."""
    imu = log.imus.get(rig.base)
    if imu is None or imu.gyro is None or imu.accel is None or len(log) < SHORTEST:
        return "fixed"
    return Platform.measured(log.t, imu, log.name).motion


def settling(filtering: Filtering) -> float:
    """Time around a sample that its row depends on, s: both filters' memory."""
    return signals.settling(filtering.cutoff) + signals.settling(filtering.cutoff * filtering.smoothing)


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
    alignment = dt / 2 if filtering.alignment is None else filtering.alignment
    begin, end = np.searchsorted(log.t, [grid[0] - 4 * dt - abs(alignment), grid[-1] + 4 * dt + abs(alignment)])
    near = slice(max(begin, stretch.rows.start), min(end, stretch.rows.stop))
    t = log.t[near]
    sections = signals.lowpass(filtering.cutoff * filtering.smoothing, 1 / dt)
    raw_q = signals.resample(t, log.q[near], grid)
    q = signals.zero_phase(raw_q, sections)
    v = signals.differentiate(q, dt)
    rate_std = signals.noise_std(raw_q) * signals.noise_gain(sections, 1 / dt, 1)
    if log.v is not None:
        raw_v = signals.resample(t, log.v[near], grid)
        v, rate_std = fused(v, raw_q, raw_v, filtering.cutoff * filtering.smoothing, dt)
    tau = signals.zero_phase(signals.resample(t + alignment, log.tau[near], grid), sections)
    platform = None if carrier is None else carried(log, carrier, near, grid, sections)
    lost = inside(stretch.holes, grid) if len(stretch.holes) else None
    return Channels(grid, q, v, signals.differentiate(v, dt), tau, rate_std, platform, lost)


def carried(log: Log, carrier: str, near: slice, grid: Array, sections: Array) -> Platform:
    """Return the base's motion on a uniform grid, smoothed like the other channels."""
    imu, t = log.imus[carrier], log.t[near]
    if imu.gyro is None or imu.accel is None:
        raise UsageError(log.name, f"lacks the gyro or the accelerometer of {carrier}", "give both, or neither")
    w, f = (signals.zero_phase(signals.resample(t, x[near], grid), sections) for x in (imu.gyro, imu.accel))
    return Platform(grid, f, w, signals.differentiate(w, float(grid[1] - grid[0])))


def fused(derived: Array, raw_q: Array, raw_v: Array, cutoff: float, dt: float) -> tuple[Array, Array]:
    """Combine the angle's derivative with the measured rate; return rate and its standard deviation.

    The derivative of an angle with white noise σ_q is the better rate below the frequency where 2π f σ_q = σ_v, the
    measured rate above it: a complementary filter at that crossover takes each where it is better, and removes a
    gyro's bias on the way.
    """
    sections = signals.lowpass(cutoff, 1 / dt)
    angle_noise, rate_noise = signals.noise_std(raw_q), signals.noise_std(raw_v)
    rate = signals.zero_phase(raw_v, sections)
    rate_std = rate_noise * signals.noise_gain(sections, 1 / dt, 0)
    out = rate.copy()
    difference = derived - rate
    # The smoothed angle is wrong at its two ends; a slow crossover would carry that far inwards.
    edge = min(round(signals.settling(cutoff) / dt), len(rate) // 2 - 1)
    difference[:edge], difference[-edge:] = difference[edge], difference[-edge - 1]
    for j, (sigma_q, sigma_v) in enumerate(zip(angle_noise, rate_noise)):
        crossover = sigma_v / (2 * np.pi * max(sigma_q, 1e-12))
        if crossover * dt < 1e-4:
            continue
        if crossover * dt > 0.4:
            out[:, j] = derived[:, j]
            rate_std[j] = angle_noise[j] * signals.noise_gain(sections, 1 / dt, 1)
            continue
        slow = signals.lowpass(crossover, 1 / dt)
        out[:, j] += signals.zero_phase(difference[:, j : j + 1], slow)[:, 0]
    return out, rate_std


def kept(rows: Rows) -> tuple[Block, ...]:
    """Compute every block once and keep them: after decimation even a million samples are some 20 MB."""
    return tuple(rows)
