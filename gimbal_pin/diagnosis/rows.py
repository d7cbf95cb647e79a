"""Logs as rows: smoothed channels, weighted to zero near standstill, low-passed and decimated to twice the band."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import median_filter
from scipy.signal import welch

from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.effects.losses import Losses
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.log import signals
from gimbal_pin.log.io.columns import LEAST_TRAVEL
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    HIGHEST_CUTOFF,
    Filtering,
    Samples,
    Segment,
    build_mask,
    compute_decimation,
    compute_direction,
    compute_settling_time,
    count_smoother_memory,
    dilate_flags,
    find_moving_base,
    find_slow_samples,
    smooth_samples,
    split_segments,
)
from gimbal_pin.regression.samples import UnfilteredTorque
from gimbal_pin.rig.rig import Rig

OUTER = -1
"""Number of a block that serves for the shown figures alone."""
FADE_SHARE = 0.25
"""Upper share of the band over which rows fade out, so that a sharp end does not ring."""
FADE_ROWS = 0.85
"""Rows that count of those of a faded band, ``1 - 5/8 FADE_SHARE``: the fade's mean square is 3/8."""
WIDEST_BAND = 0.995 * HIGHEST_CUTOFF
"""Widest band, as a share of the sampling rate: just within what a filter may have."""
WIDEST_DOUBLED_BAND = 0.5 * HIGHEST_CUTOFF
"""Widest band that lines may ask for, as a share of the sampling rate: ten samples a period."""
SPECTRUM_SECONDS = 8.0
"""Length of the segments of the spectrum in which lines are looked for, s: lines an eighth of a hertz apart differ."""
LINE_NEIGHBOURS = 33
"""Number of its frequencies that the median around a line is taken over: 4 Hz."""
SIGNALS_AT_A_TIME = 16
"""Signals that are transformed together: a minute of them stays in a processor's cache."""

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Part of a log between gaps.

    Attributes:
        log: Number of the log.
        samples: Smoothed channels at some hundred hertz, (m,) and (m, n).
        direction: Mean direction of sliding over each sample, (m, n), in [-1, 1].
        weight: Weight of each sample, (m, n), 0 near standstill and at the ends.
        dt: Interval of the samples, s.
        time: Time since the log began, s, (m,).
        count: Number of rows M.
        fade: Gain over frequency that ends the band, (M // 2 + 1,).
        block: Block of each row, (M,); `OUTER` for the shown figures.
        logged: The torque before it was smoothed, on which a drive's law without memory acts.
        temperature: Motor temperatures, °C, (m, n); None: not logged.
        losses: What each motor turned into heat since its log began, (n).
    """

    log: int
    samples: Samples
    direction: Array
    weight: Array
    dt: float
    time: Array
    count: int
    fade: Array
    block: Indices
    logged: UnfilteredTorque
    temperature: Array | None
    losses: tuple[Losses, ...]

    def project(self, signals: Iterable[Array], joint: int) -> Array:
        """Return the rows of k signals (m,) at a joint: weighted, band-limited and decimated, (M, k)."""
        rows = [np.empty((0, self.count))]
        gain = self.fade * (self.count / len(self.time))
        weight = self.weight[:, joint]
        block = np.empty((SIGNALS_AT_A_TIME, len(weight)))
        left = iter(signals)
        while some := [np.multiply(x, weight, row) for row, x in zip(block, left)]:
            spectrum = fft.rfft(block[: len(some)])
            rows.append(fft.irfft(spectrum[:, : len(gain)] * gain, self.count))
        return np.concatenate(rows).T

    @property
    def frequencies(self) -> Array:
        """Frequencies of the rows, Hz, (M // 2 + 1,)."""
        return np.arange(self.count // 2 + 1) / (len(self.time) * self.dt)

    @property
    def places(self) -> Indices:
        """Sample at the time of each row, (M,)."""
        return np.arange(self.count) * len(self.time) // self.count


@dataclass(frozen=True, eq=False)
class Rows:
    """Stretches of one or several logs and their division into blocks.

    Rows of all stretches stand one below the other, (N, ...). Those of the folds come without the outer ones as
    "inner" rows; `folds` are their slices.

    Attributes:
        rig: The rig.
        stretches: The stretches.
        band: Highest frequency, Hz.
        inner: Whether a row is of a fold, (N,).
        folds: Slices of the inner rows, in their order.
        used: Mean squared weight of the inner rows at each joint, (n,).
        how: How the outer rows were chosen.
    """

    rig: Rig
    stretches: tuple[Stretch, ...]
    band: float
    inner: NDArray[np.bool_]
    folds: tuple[slice, ...]
    used: Array
    how: str

    def sample(self, name: str) -> Array:
        """Return a channel, or "time", "weight", at the times of the rows, (N, ...)."""
        owners = [x if name in ("time", "weight") else x.samples for x in self.stretches]
        pairs = zip(owners, self.stretches)
        return np.concatenate([getattr(owner, name)[part.places] for owner, part in pairs])

    @property
    def inner_samples(self) -> NDArray[np.bool_]:
        """True for samples of all stretches that belong to inner rows, (all m,)."""
        rows = [np.arange(len(x.time)) * x.count // len(x.time) for x in self.stretches]
        return np.concatenate([x.block[at] != OUTER for x, at in zip(self.stretches, rows)])

    @property
    def has_outer(self) -> bool:
        """True if some blocks serve for the shown figures alone."""
        return not bool(self.inner.all())

    @property
    def seconds(self) -> float:
        """Length of all stretches, s."""
        return float(sum(part.dt * len(part.time) for part in self.stretches))

    @property
    def starts(self) -> Indices:
        """First inner row of each fold, (K,)."""
        return np.array([fold.start for fold in self.folds])

    @property
    def fold_of_rows(self) -> Indices:
        """Fold of each inner row."""
        block = np.concatenate([part.block for part in self.stretches])
        return block[self.inner]

    def count_effective_rows(self) -> Array:
        """Return effective rows of each fold at each joint, (K, n): squared weights, less what fades."""
        lengths = np.bincount(self.fold_of_rows)
        return np.maximum(FADE_ROWS * lengths[:, None] * self.used, 1e-6)

    def split(self, rows: Array) -> list[Array]:
        """Return rows (N, ...) by stretch."""
        return np.split(rows, np.cumsum([part.count for part in self.stretches])[:-1])

    def project(self, signals: Sequence[Array], joint: int) -> Array:
        """Return the rows of signals, (m,) or (m, k) per stretch, at a joint, (N, k)."""
        pairs = zip(self.stretches, signals)
        return np.concatenate([part.project(np.atleast_2d(x.T), joint) for part, x in pairs])

    def join(self, name: str) -> Array:
        """Return a channel of all stretches, (all m, n)."""
        return np.concatenate([getattr(part.samples, name) for part in self.stretches])

    def filter(self, rows: Array, gain: Array, frequencies: Array) -> Array:
        """Return rows (N, k) filtered without phase by a gain over some frequencies."""
        filtered = list[Array]()
        for part, own in zip(self.stretches, self.split(rows)):
            spectrum = fft.rfft(own, axis=0)
            spectrum *= np.interp(part.frequencies, frequencies, gain)[:, None]
            filtered.append(fft.irfft(spectrum, part.count, axis=0))
        return np.concatenate(filtered)

    def estimate_spectrum(self, rows: Array, joint: int, frequencies: Array) -> Array:
        """Return the smoothed power of rows (N,) at a joint over evenly spaced frequencies, per effective row."""
        power = np.concatenate([np.abs(fft.rfft(x)) ** 2 / len(x) for x in self.split(rows)])
        bins = np.concatenate([part.frequencies for part in self.stretches]) / frequencies[1]
        bins = np.minimum((bins + 0.5).astype(int), len(frequencies) - 1)
        count = np.bincount(bins, minlength=len(frequencies))
        total = np.bincount(bins, power, len(frequencies))
        filled = count > 0
        mean = np.interp(frequencies, frequencies[filled], total[filled] / count[filled])
        smooth = np.convolve(np.pad(mean, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
        return smooth / max(float(self.used[joint]), 1e-9)


def choose_band(logs: Sequence[Log], settings: Settings) -> float:
    """Return the highest frequency to look at, Hz.

    `Settings.band_hz`, or a fifth of the lowest sampling rate; doubled while lines above it hold more power at some
    joint than all below it, as the teeth of a turning motor do.
    """
    band = min(settings.band_hz, *(WIDEST_BAND / log.dt for log in logs))
    for log in logs:
        if log.tau is None or len(log) <= LINE_NEIGHBOURS:
            continue
        length = min(len(log), round(SPECTRUM_SECONDS / log.dt))
        frequency, power = welch(log.tau, 1 / log.dt, nperseg=length, axis=0)
        around = median_filter(power, (LINE_NEIGHBOURS, 1))
        lines = np.where(power > settings.line_power * around, power, 0.0)
        while 2 * band <= WIDEST_DOUBLED_BAND / log.dt:
            above = frequency > band
            if not np.any(lines[above].sum(axis=0) > power[~above].sum(axis=0)):
                break
            band *= 2
    return band


def build_rows(
    rig: Rig,
    logs: Sequence[Log],
    band: float,
    settings: Settings,
    holdout: str | None = None,
    filtering: Filtering | None = None,
) -> Rows:
    """Smooth logs, weight their samples and divide their rows into blocks.

    Args:
        rig: The rig.
        logs: Its logs.
        band: Highest frequency, Hz.
        settings: Constants.
        holdout: Rows for the shown figures alone: "last-third", "log:N" of several logs, or "none". None: every fifth
            block of long logs.
        filtering: Smoothing and time of the torque; its cutoff is not read. None: the settings' smoothing, and a torque
            that is held from its sample to the next.

    Raises:
        UsageError: There is no such holdout.
        DataError: No part of the logs is long enough.
    """
    filtering = replace(filtering or Filtering(smoothing=settings.smoothing), cutoff=band)
    tried = [
        _build_stretch(rig, segment, number, filtering, settings)
        for number, log in enumerate(logs)
        for segment in split_segments(log, band)
    ]
    stretches = [part for part in tried if part is not None]
    if not stretches:
        raise DataError(
            logs[0].name, "has no stretch of time long enough to judge", "record at least 10 s"
        )
    return _divide_rows(rig, stretches, band, settings, len(logs), holdout)


def _build_stretch(
    rig: Rig, segment: Segment, log: int, filtering: Filtering, settings: Settings
) -> Stretch | None:
    """Return the rows of a segment; None: it is shorter than the filters' memory."""
    step = compute_decimation(filtering, segment.dt)
    half = fft.prev_fast_len(max(segment.length // (2 * step), 1), real=True)
    length = 2 * step * half
    edge = int(np.ceil(compute_settling_time(filtering) / segment.dt))
    if 4 * edge > length:
        return None
    base_link = find_moving_base(rig, segment.log)
    samples = smooth_samples(segment, filtering, 0, length, base_link)
    kept = slice(0, length, step)
    weight = _weigh_samples(samples, segment.dt, edge, filtering, settings)[kept]
    grid = samples.t
    samples = samples.select(kept)
    dt = segment.dt * step
    # Rows of a length whose transform is fast: up to 2 % more than two per period of the cutoff.
    count = 2 * fft.next_fast_len(max(round(len(samples.t) * dt * filtering.cutoff), 4))
    frequencies = fft.rfftfreq(len(samples.t), dt)[: count // 2 + 1]
    left = np.clip((filtering.cutoff - frequencies) / (FADE_SHARE * filtering.cutoff), 0.0, 1.0)
    start = float(segment.log.t[0])
    warm = segment.log.temperature
    assert segment.log.tau is not None
    return Stretch(
        log=log,
        samples=samples,
        direction=compute_direction(samples.v, samples.a, dt),
        weight=np.asfortranarray(weight),
        dt=dt,
        time=samples.t - start,
        count=count,
        fade=0.5 - 0.5 * np.cos(np.pi * left),
        block=np.zeros(count, np.intp),
        logged=UnfilteredTorque.of(segment, filtering, grid, step),
        temperature=None if warm is None else signals.resample(segment.log.t, warm, samples.t),
        losses=tuple(
            Losses.along(segment.log.t - start, tau, samples.t - start) for tau in segment.log.tau.T
        ),
    )


def _weigh_samples(
    samples: Samples, dt: float, edge: int, filtering: Filtering, settings: Settings
) -> Array:
    """Return weights that fall to zero near standstill and at the ends, (m, n)."""
    reach = count_smoother_memory(samples, filtering)
    taper = max(1, round(0.5 / filtering.cutoff / dt))
    place = np.arange(len(samples.t))
    from_end = np.minimum(place, place[::-1])
    rise = np.clip((from_end - edge / 2) / (edge / 2), 0.0, 1.0)
    ends = (0.5 - 0.5 * np.cos(np.pi * rise))[:, None]

    def open_mask(deviations: float, reach: int) -> Array:
        still = dilate_flags(find_slow_samples(samples, deviations), reach)
        return build_mask(still, taper) * ends

    wide = open_mask(settings.sign_deviations, reach)
    narrow = open_mask(settings.clear_deviations, max(1, reach // 4))
    return np.where(np.mean(wide**2, axis=0) > 1 - settings.mask_share, wide, narrow)


def _divide_rows(
    rig: Rig,
    stretches: Sequence[Stretch],
    band: float,
    settings: Settings,
    logs: int,
    holdout: str | None,
) -> Rows:
    """Number the blocks of rows and choose the outer ones; joints that stand throughout weigh nothing.

    Args:
        rig: The rig.
        stretches: The stretches.
        band: Highest frequency, Hz.
        settings: Constants.
        logs: Number of logs.
        holdout: As for `build_rows`.
    """
    seconds = np.array([part.dt * len(part.time) for part in stretches])
    is_long = seconds.sum() >= settings.blocks * settings.block_seconds and holdout is None
    every = settings.outer_every if is_long else 0
    blocks = settings.blocks if is_long else settings.folds
    size = max(settings.block_seconds, seconds.sum() / blocks)
    counts = np.maximum(np.round(seconds / size), 1).astype(int)
    if counts.sum() < settings.min_folds:
        counts[:] = -(-settings.min_folds // len(stretches))
    numbers = [np.arange(x.count) * count // x.count for x, count in zip(stretches, counts)]
    number = np.concatenate([x + first for x, first in zip(numbers, np.cumsum(counts) - counts)])
    if holdout is None:
        outer = number % every == every // 2 if every else number < 0
        how = "every fifth block"
    else:
        outer, how = _choose_outer_rows(stretches, logs, holdout)
    inner = ~outer
    begins = np.diff(number[inner], prepend=-1) != 0
    block = np.full(len(number), OUTER)
    block[inner] = np.cumsum(begins) - 1
    edges = [*np.flatnonzero(begins).tolist(), len(begins)]
    folds = tuple(slice(first, last) for first, last in pairwise(edges))
    moves = np.ptp(np.concatenate([part.samples.q for part in stretches]), axis=0) >= LEAST_TRAVEL
    divided = tuple(
        replace(part, block=own, weight=part.weight * moves)
        for part, own in zip(
            stretches, np.split(block, np.cumsum([x.count for x in stretches])[:-1])
        )
    )
    used = np.mean(np.concatenate([part.weight for part in divided]) ** 2, axis=0)
    return Rows(rig, divided, band, inner, folds, used, how)


def _choose_outer_rows(
    stretches: Sequence[Stretch], logs: int, holdout: str
) -> tuple[NDArray[np.bool_], str]:
    """Return the outer rows that were asked for, (N,), and how they are described."""
    log = np.repeat([part.log for part in stretches], [part.count for part in stretches])
    time = np.concatenate([part.time[part.places] for part in stretches])
    if holdout == "none":
        return log < 0, "none"
    match = re.fullmatch(r"log:(\d+)", holdout)
    number = int(match[1]) if match else 0
    if holdout == "last-third":
        ends = np.zeros(logs)
        np.maximum.at(ends, log, time)
        outer = time > 2 / 3 * ends[log]
        how = "last third"
    elif 1 <= number <= logs and logs > 1:
        outer = log == number - 1
        how = f"log {number} of {logs}"
    else:
        several = f", or log:1 to log:{logs}" if logs > 1 else "; log:N takes several logs"
        raise UsageError("--holdout", f"cannot be '{holdout}'", f"use last-third or none{several}")
    if outer.all() or not outer.any():
        raise UsageError(
            "--holdout", f"{how} leaves no row on one side", "hold out another part, or 'none'"
        )
    return outer, how
