"""Resolution of a channel: no fault of its own, but what other checks measure by."""

from __future__ import annotations

from math import log2, pi

import numpy as np

from gimbal_pin.log.log import Array, Log


def quanta(signal: Array) -> Array:
    """Return each column's step, (n,): `quantum`."""
    return np.array([quantum(column) for column in signal.T])


def quantum(column: Array) -> float:
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


def bits(step: float) -> float:
    """Resolution of an angle in bits per turn; infinite where it has no step."""
    return log2(2 * pi / step) if step > 0 else float("inf")


def angle_noise(log: Log, measured: Array) -> Array:
    """The angles' noise, rad: what was measured, or the quantisation's ``step / √12`` where that is more.

    A joint that moves slowly over coarse steps rests on each for long, and its differences do not show them.
    """
    return np.maximum(measured, quanta(log.q) / np.sqrt(12.0))
