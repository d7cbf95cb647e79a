"""A log's samples: what a cubic through its neighbours leaves of each, which repeat, and logs from some of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.estimation.rows import Flags
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Imu, Log

Indices = NDArray[np.integer[Any]]

CHANNELS = ("q", "v", "tau")
"""The measured channels of the joints, by their names in `Log`."""
WORDS = {"q": "angle", "v": "rate", "tau": "torque"}


def channels(log: Log) -> dict[str, Array]:
    """Return the measured channels that there are, each (N, n)."""
    return {name: value for name in CHANNELS if (value := getattr(log, name)) is not None}


def left_out(t: Array, x: Array) -> Array:
    """Return ``x_k - p(t_k)``, p the cubic through the samples k-2, k-1, k+1, k+2, (N - 4, n), scaled to white noise.

    White noise of deviation σ gives σ whatever the spacing; anything smooth gives nothing.

    Args:
        t: Times, (N,).
        x: Values, (N, n).
    """
    n, places = len(t) - 4, (0, 1, 3, 4)
    around = [t[i : i + n] for i in places]
    guess, size = np.zeros((n, x.shape[1])), np.ones(n)
    for i, own in enumerate(around):
        others = [other for k, other in enumerate(around) if k != i]
        weight = np.prod([(t[2 : 2 + n] - other) / (own - other) for other in others], axis=0)
        guess += weight[:, None] * x[places[i] : places[i] + n]
        size += weight**2
    return np.asarray((x[2 : 2 + n] - guess) / np.sqrt(size)[:, None])


def local_noise(t: Array, x: Array, parts: int) -> Array:
    """Standard deviation of the white noise in each of so many parts of a log, (parts, n), by `left_out`.

    Samples beside a hole are left out: a cubic across it is no measure.
    """
    whole = t[4:] - t[:-4] < 6.0 * np.median(np.diff(t))
    split = np.array_split(left_out(t, x)[whole] ** 2, parts)
    return np.sqrt([np.sort(part, axis=0)[: max(1, int(signals.KEPT * len(part)))].mean(axis=0) for part in split])


def medians(values: Array, length: int) -> Array:
    """Median of each column over windows of so many samples, the last one shorter, (windows, n)."""
    whole = len(values) // length * length
    windows = np.median(values[:whole].reshape(-1, length, values.shape[1]), axis=1)
    rest = values[whole:]
    return np.concatenate([windows, np.median(rest, axis=0)[None]]) if len(rest) else windows


def level(values: Array) -> float:
    """Root mean square without the largest two per cent."""
    squares = np.sort(values**2)
    return float(np.sqrt(squares[: max(1, int(0.98 * len(squares)))].mean()))


def edges(flags: Flags) -> list[tuple[int, int]]:
    """First and one past the last index of every run of true flags."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(ends[::2].tolist(), ends[1::2].tolist()))


def taken(log: Log, rows: Indices, t: Array | None = None) -> Log:
    """Return the samples with these indices, in this order, with other times `t` or each with its own."""
    names = (*CHANNELS, "q_ref", "temperature")
    chosen: dict[str, Any] = {name: value[rows] for name in names if (value := getattr(log, name)) is not None}
    imus = {link: picked(imu, rows) for link, imu in log.imus.items()}
    return replace(log, **chosen, t=log.t[rows] if t is None else t, imus=imus)


def picked(imu: Imu, rows: Indices) -> Imu:
    """Return an IMU's samples with these indices."""
    return Imu(**{name: value[rows] for name in ("gyro", "accel", "quat") if (value := getattr(imu, name)) is not None})


def changed(log: Log, values: Mapping[str, Any]) -> Log:
    """Return the log with other values in some channels."""
    return replace(log, **values)


def noted(log: Log, event: str) -> Log:
    """Return the log with one more event."""
    return replace(log, events=(*log.events, event))
