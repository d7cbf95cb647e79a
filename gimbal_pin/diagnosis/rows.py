"""Logs as rows: smoothed channels, weighted to zero near standstill, low-passed and decimated to twice the band."""

from __future__ import annotations

import re
from collections.abc import Sequence
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
from gimbal_pin.log.io.columns import LEAST_TRAVEL
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
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
FEWEST_FOLDS = 4
"""Fewest blocks that are left out in turn."""
FADE_SHARE = 0.25
"""Upper share of the band over which rows fade out."""
FADE_ROWS = 0.85
"""Rows that count of those that a faded band has."""
WIDEST_BAND = 0.199
"""Widest band, as a share of the sampling rate: five samples per period."""
WIDEST_DOUBLED_BAND = 0.1
"""Widest band that lines may ask for, as a share of the sampling rate."""
LINE_POWER = 20.0
"""Power over the median around it from which a frequency is a line: noise is so with probability 2^-20."""
SPECTRUM_SECONDS = 8.0
"""Length of the segments of that spectrum, s."""
LINE_NEIGHBOURS = 33
"""Number of frequencies that the median is taken over."""

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

    def project(self, signals: Array, joint: int) -> Array:
        """Return the rows of signals (m, k) at a joint: weighted, band-limited and decimated, (M, k)."""
        spectrum = fft.rfft(signals * self.weight[:, joint, None], axis=0)[: len(self.fade)]
        spectrum *= (self.fade * (self.count / len(signals)))[:, None]
        return np.asarray(fft.irfft(spectrum, self.count, axis=0))

    @property
    def frequencies(self) -> Array:
        """Frequencies of the rows, Hz, (M // 2 + 1,)."""
        return np.arange(self.count // 2 + 1) / (len(self.time) * self.dt)


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
        channels = list[Array]()
        for part in self.stretches:
            own = part if name in ("time", "weight") else part.samples
            picked = np.arange(part.count) * len(part.time) // part.count
            channels.append(getattr(own, name)[picked])
        return np.concatenate(channels)

    @property
    def inner_samples(self) -> NDArray[np.bool_]:
        """True for samples of all stretches that belong to inner rows, (all m,)."""
        masks = list[NDArray[np.bool_]]()
        for part in self.stretches:
            row = np.arange(len(part.time)) * part.count // len(part.time)
            masks.append(part.block[row] != OUTER)
        return np.concatenate(masks)

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
        return np.repeat(
            np.arange(len(self.folds)), [fold.stop - fold.start for fold in self.folds]
        )

    def count_effective_rows(self) -> Array:
        """Return effective rows of each fold at each joint, (K, n): squared weights, less what fades."""
        lengths = np.array([fold.stop - fold.start for fold in self.folds])
        return np.maximum(FADE_ROWS * lengths[:, None] * self.used, 1e-6)

    def project(self, signals: Sequence[Array], joint: int) -> Array:
        """Return the rows of signals, (m,) or (m, k) per stretch, at a joint, (N, k)."""
        pairs = zip(self.stretches, signals)
        return np.concatenate(
            [part.project(x[:, None] if x.ndim == 1 else x, joint) for part, x in pairs]
        )

    def join(self, name: str) -> Array:
        """Return a channel of all stretches, (all m, n)."""
        return np.concatenate([getattr(part.samples, name) for part in self.stretches])

    def filter(self, rows: Array, gain: Array, frequencies: Array) -> Array:
        """Return rows (N, k) filtered without phase by a gain over some frequencies."""
        filtered = np.empty_like(rows)
        first = 0
        for part in self.stretches:
            own = slice(first, first + part.count)
            first += part.count
            spectrum = fft.rfft(rows[own], axis=0)
            spectrum *= np.interp(part.frequencies, frequencies, gain)[:, None]
            filtered[own] = fft.irfft(spectrum, part.count, axis=0)
        return filtered

    def estimate_spectrum(self, rows: Array, joint: int, frequencies: Array) -> Array:
        """Return the smoothed power of rows (N,) at a joint over evenly spaced frequencies, per effective row."""
        power = np.zeros(len(frequencies))
        count = np.zeros(len(frequencies))
        first = 0
        for part in self.stretches:
            own = np.abs(fft.rfft(rows[first : first + part.count])) ** 2 / part.count
            first += part.count
            bins = (part.frequencies / frequencies[1] + 0.5).astype(int)
            bins = np.minimum(bins, len(power) - 1)
            np.add.at(power, bins, own)
            np.add.at(count, bins, 1)
        filled = count > 0
        mean = np.interp(frequencies, frequencies[filled], power[filled] / count[filled])
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
        lines = np.where(power > LINE_POWER * around, power, 0.0)
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
    given = filtering or Filtering(smoothing=settings.smoothing)
    filtering = replace(given, cutoff=band)
    stretches = list[Stretch]()
    for number, log in enumerate(logs):
        for segment in split_segments(log, band):
            stretch = _build_stretch(rig, segment, number, filtering, settings)
            if stretch is not None:
                stretches.append(stretch)
    if not stretches:
        raise DataError(
            logs[0].name, "has no stretch of time long enough to judge", "record at least 10 s"
        )
    if holdout is None:
        return _divide_rows(rig, stretches, band, settings)
    outer, how = _choose_outer_rows(stretches, len(logs), holdout)
    return _divide_rows(rig, stretches, band, settings, outer, how)


def _choose_outer_rows(
    stretches: Sequence[Stretch], logs: int, holdout: str
) -> tuple[list[NDArray[np.bool_]], str]:
    """Return the outer rows of each stretch that were asked for, and how they are told."""
    if holdout == "none":
        return [np.zeros(part.count, bool) for part in stretches], "none"
    if holdout == "last-third":
        ends = {part.log: float(part.time[-1]) for part in stretches}
        times = [
            part.time[np.arange(part.count) * len(part.time) // part.count] for part in stretches
        ]
        outer = [t > 2 / 3 * ends[part.log] for t, part in zip(times, stretches)]
        return outer, "last third"
    match = re.fullmatch(r"log:(\d+)", holdout)
    number = int(match[1]) if match else 0
    if not 1 <= number <= logs or logs < 2:
        several = f", or log:1 to log:{logs}" if logs > 1 else "; log:N takes several logs"
        raise UsageError("--holdout", f"cannot be '{holdout}'", f"use last-third or none{several}")
    return [
        np.full(part.count, part.log == number - 1) for part in stretches
    ], f"log {number} of {logs}"


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
    return Stretch(
        log=log,
        samples=samples,
        direction=compute_direction(samples.v, samples.a, dt),
        weight=np.asfortranarray(weight),
        dt=dt,
        time=samples.t - float(segment.log.t[0]),
        count=count,
        fade=0.5 - 0.5 * np.cos(np.pi * left),
        block=np.zeros(count, np.intp),
        logged=UnfilteredTorque.of(segment, filtering, grid, step),
        temperature=_resample_temperature(segment.log, samples.t),
        losses=_collect_losses(segment.log, samples.t),
    )


def _collect_losses(log: Log, t: Array) -> tuple[Losses, ...]:
    """Return what each motor turned into heat since a log began, at some times."""
    assert log.tau is not None
    start = float(log.t[0])
    return tuple(Losses.along(log.t - start, tau, t - start) for tau in log.tau.T)


def _resample_temperature(log: Log, t: Array) -> Array | None:
    """Return motor temperatures at some times, °C, (m, n)."""
    if log.temperature is None:
        return None
    return np.stack([np.interp(t, log.t, x) for x in log.temperature.T], axis=1)


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
    narrow = open_mask(settings.slow_sign_deviations, max(1, reach // 4))
    return np.where(np.mean(wide**2, axis=0) > 1 - settings.mask_share, wide, narrow)


def _divide_rows(
    rig: Rig,
    stretches: Sequence[Stretch],
    band: float,
    settings: Settings,
    asked: Sequence[NDArray[np.bool_]] | None = None,
    how: str = "every fifth block",
) -> Rows:
    """Number the blocks; of a long log every so manieth is an outer one. Joints that stand throughout weigh nothing.

    Args:
        rig: The rig.
        stretches: The stretches.
        band: Highest frequency, Hz.
        settings: Constants.
        asked: The outer rows of each stretch that were asked for.
        how: How the outer rows were chosen.
    """
    seconds = sum(part.count for part in stretches) / (2 * band)
    is_long = seconds >= settings.long_seconds and asked is None
    outer_share = settings.outer_share if is_long else 0
    blocks = settings.folds + (settings.folds // (outer_share - 1) if is_long else 0)
    size = max(settings.block_seconds, seconds / blocks)
    counts = [max(1, round(part.count / (2 * band) / size)) for part in stretches]
    if sum(counts) < FEWEST_FOLDS:
        counts = [-(-FEWEST_FOLDS // len(stretches))] * len(stretches)
    divided = list[Stretch]()
    number = 0
    fold = 0
    for part, count in zip(stretches, counts):
        own = np.empty(part.count, np.intp)
        edges = np.linspace(0, part.count, count + 1).round().astype(int)
        for first, last in pairwise(edges):
            is_outer = outer_share and number % outer_share == outer_share // 2
            own[first:last] = OUTER if is_outer else fold
            fold += not is_outer
            number += 1
        if asked is not None:
            own[asked[len(divided)]] = OUTER
        divided.append(replace(part, block=own))
    block = np.concatenate([part.block for part in divided])
    inner = block != OUTER
    if asked is not None and how != "none" and (inner.all() or not inner.any()):
        raise UsageError(
            "--holdout", f"{how} leaves no row on one side", "hold out another part, or 'none'"
        )
    ends = np.r_[0, np.flatnonzero(np.diff(block[inner])) + 1, np.count_nonzero(inner)].tolist()
    folds = tuple(slice(first, last) for first, last in pairwise(ends))
    q = np.concatenate([part.samples.q for part in divided])
    moves = np.ptp(q, axis=0) >= LEAST_TRAVEL
    divided = [replace(part, weight=part.weight * moves) for part in divided]
    weights = np.concatenate([part.weight for part in divided])
    return Rows(rig, tuple(divided), band, inner, folds, np.mean(weights**2, axis=0), how)
