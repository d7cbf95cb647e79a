"""What checks look at in a log's channels: noise, roughness, runs, resolution."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Flags

JOINT_CHANNELS = ("q", "v", "tau")
"""The measured channels of the joints, by their names in `Log`."""
WORDS = {"q": "angle", "v": "rate", "tau": "torque"}


def get_channels(log: Log) -> dict[str, Array]:
    """Return the measured channels that there are, each (N, n)."""
    return {name: value for name in JOINT_CHANNELS if (value := getattr(log, name)) is not None}


def leave_out(t: Array, x: Array) -> Array:
    """Return ``x_k - p(t_k)``, p the cubic through the samples k-2, k-1, k+1, k+2, (N - 4, n), scaled to white noise.

    White noise of deviation σ gives σ whatever the spacing; anything smooth gives nothing.

    Args:
        t: Times, (N,).
        x: Values, (N, n).
    """
    n = len(t) - 4
    places = (0, 1, 3, 4)
    around = [t[i : i + n] for i in places]
    guess = np.zeros((n, x.shape[1]))
    size = np.ones(n)
    for i, own in enumerate(around):
        others = [other for k, other in enumerate(around) if k != i]
        weight = np.prod([(t[2 : 2 + n] - other) / (own - other) for other in others], axis=0)
        guess += weight[:, None] * x[places[i] : places[i] + n]
        size += weight**2
    return np.asarray((x[2 : 2 + n] - guess) / np.sqrt(size)[:, None])


def estimate_local_noise(t: Array, x: Array, parts: int) -> Array:
    """Standard deviation of the white noise in each of so many parts of a log, (parts, n), by `leave_out`.

    Samples beside a hole are left out: a cubic across it is no measure.
    """
    whole = t[4:] - t[:-4] < 6.0 * np.median(np.diff(t))
    split = np.array_split(leave_out(t, x)[whole] ** 2, parts)
    kept = ((part, max(1, int(signals.KEPT_SHARE * len(part)))) for part in split)
    return np.sqrt([np.sort(part, axis=0)[:count].mean(axis=0) for part, count in kept])


def compute_medians(values: Array, length: int) -> Array:
    """Median of each column over windows of so many samples, the last one shorter, (windows, n)."""
    whole = len(values) // length * length
    windows = np.median(values[:whole].reshape(-1, length, values.shape[1]), axis=1)
    rest = values[whole:]
    return np.concatenate([windows, np.median(rest, axis=0)[None]]) if len(rest) else windows


def compute_trimmed_rms(values: Array) -> float:
    """Root mean square without the largest two per cent."""
    count = max(1, int(0.98 * len(values)))
    return float(np.sqrt(np.partition(values**2, count - 1)[:count].mean()))


def find_runs(flags: Flags) -> list[tuple[int, int]]:
    """First and one past the last index of every run of true flags."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(ends[::2].tolist(), ends[1::2].tolist()))


def find_step(column: Array) -> float:
    """``max d`` with every change a whole multiple of d, but for rounding in the log; 0 if there is none."""
    levels = np.unique(column)
    # A file holds some digits of each value: two writings of one level are one level.
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-7 * max(float(np.abs(levels).max(initial=0.0)), 1e-300)]
    if len(gaps) < 4:
        return 0.0
    # Of a channel that takes any value the smallest gaps are chance, and the others no multiples of them.
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    return step if np.mean(np.abs(gaps / step - np.round(gaps / step)) < 0.05) > 0.95 else 0.0


def estimate_angle_noise(log: Log, measured: Array) -> Array:
    """The angles' noise, rad: what was measured, or the quantisation's ``step / √12`` where that is more.

    A joint that moves slowly over coarse steps rests on each for long, and its differences do not show them.
    """
    return np.maximum(measured, np.array([find_step(column) for column in log.q.T]) / np.sqrt(12.0))
