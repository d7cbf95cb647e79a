"""How far two recorders' clocks are apart, by what both saw of one motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate, correlation_lags

from gimbal_pin.log.log import Array

_CHANNELS = 16
"""Channels of a recorder that are compared with each of the other's."""


def find_clock_offset(t: Array, one: Mapping[str, Array], u: Array, other: Mapping[str, Array]) -> tuple[float, str]:
    """Return what is added to a second recorder's times, s, and why: by a channel that both have, or angle and rate.

    The rates of both channels of a pair are compared, or one's rate with the other itself, on a grid of the coarser
    interval; the offset is the peak of the normalised correlation, refined by a parabola. It is taken from a
    correlation of 0.9 on, where no other peak reaches 98 % of it: else the motion is periodic.

    Args:
        t: The first's times, s, (N,).
        one: The first's channels, (N,) each.
        u: The second's times, (M,).
        other: Its channels, (M,) each.
    """
    if np.isin(u, t).mean() > 0.5:
        return 0.0, "has the first's times: one clock"
    if min(len(t), len(u)) < 8:
        return 0.0, "has too few samples to tell its clock's offset: taken as zero"
    usual, span = max(np.median(np.diff(t)), np.median(np.diff(u))), max(np.ptp(t), np.ptp(u))
    if not usual > 0:
        return 0.0, "has times that do not increase: its clock's offset is taken as zero"
    # All pairs on a coarse grid, the best again on a fine one: 2 ms and 50 ms a pair.
    step, most = (float(max(usual, span / size)) for size in (2**16, 2**12))
    best = max((_find_peak(*pair) for pair in _pair_channels(t, one, u, other, most)), default=None)
    if best is not None and step < most:
        a, b = best.channels
        best = max(_find_peak(*pair) for pair in _pair_channels(t, {a: one[a]}, u, {b: other[b]}, step))
    if best is None or best.correlation < 0.9:
        return 0.0, "has no channel that is alike in the first: its clock's offset is taken as zero"
    if best.rival > 0.98 * best.correlation:
        return 0.0, "moves periodically, which does not tell its clock's offset: taken as zero"
    seconds = t[0] - u[0] + best.lag * step
    if abs(seconds) < step / 2:
        return 0.0, f"has the first's clock to less than half a sample (by its {best.names})"
    return float(seconds), f"by {best.names} its times are {-seconds:+.4g} s off the first's: shifted"


class _Peak(NamedTuple):
    """The best lag of a pair of channels: correlation there, lag in steps, the best of any other peak, and the pair."""

    correlation: float
    lag: float
    rival: float
    names: str
    channels: tuple[str, str]


_Pair = tuple[Array, Array, str, tuple[str, str]]


def _pair_channels(
    t: Array, one: Mapping[str, Array], u: Array, other: Mapping[str, Array], step: float
) -> Iterator[_Pair]:
    """Yield two sampled channels, what they are, and their names: of one name, or else rates against channels."""
    grids = [(x[0] + step * np.arange(int(np.ptp(x) / step) + 1)) for x in (t, u)]
    a = {name: np.interp(grids[0], t, x) for name, x in list(one.items())[:_CHANNELS] if np.ptp(x)}
    b = {name: np.interp(grids[1], u, x) for name, x in list(other.items())[:_CHANNELS] if np.ptp(x)}
    if both := a.keys() & b.keys():
        yield from (
            (np.gradient(a[name], step), np.gradient(b[name], step), name, (name, name)) for name in sorted(both)
        )
        return
    for name, x in a.items():
        for its, y in b.items():
            yield np.gradient(x, step), y, f"{its} and the rate of {name}", (name, its)
            yield x, np.gradient(y, step), f"{name} and the rate of {its}", (name, its)


def _find_peak(x: Array, y: Array, names: str, channels: tuple[str, str]) -> _Peak:
    """Return the lag by which y, (M,), comes after its like in x, (N,), where at least half of the shorter overlaps."""
    x, y = x - x.mean(), y - y.mean()
    lags = correlation_lags(len(x), len(y))
    products, power, other = (
        correlate(p, q, method="fft") for p, q in ((x, y), (x**2, np.ones(len(y))), (np.ones(len(x)), y**2))
    )
    overlap = np.minimum(len(x), lags + len(y)) - np.maximum(0, lags)
    scale = np.sqrt(np.maximum(power, 1e-12 * power.max()) * np.maximum(other, 1e-12 * other.max()))
    values = np.where(overlap >= min(len(x), len(y)) / 2, products / scale, -1.0)
    k = int(np.argmax(values))
    # Beyond the main lobe: from where the correlation has gone below zero, or below half of its peak.
    low = np.flatnonzero(values < values[k] / 2)
    left, right = low[low < k], low[low > k]
    others = np.concatenate([values[: left[-1] + 1] if len(left) else [], values[right[0] :] if len(right) else []])
    bend = 0.0
    if 0 < k < len(values) - 1 and values[k - 1] > -1 and values[k + 1] > -1:
        before, at, after = values[k - 1 : k + 2]
        bend = 0.5 * (before - after) / curve if (curve := before - 2 * at + after) < 0 else 0.0
    return _Peak(float(values[k]), float(lags[k] + bend), float(max(others, default=-1.0)), names, channels)
