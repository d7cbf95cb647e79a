"""Elementary functions of a float (simulation) or an array (identification), and propagation of uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from gimbal_pin.log.log import Array

FloatOrArray = float | Array


def cos(x: FloatOrArray) -> FloatOrArray:
    """Cosine of an angle, rad."""
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def sin(x: FloatOrArray) -> FloatOrArray:
    """Sine of an angle, rad."""
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def exp(x: FloatOrArray) -> FloatOrArray:
    """Exponential."""
    return math.exp(x) if isinstance(x, float) else np.exp(x)


def size(x: FloatOrArray) -> FloatOrArray:
    """Absolute value."""
    return abs(x) if isinstance(x, float) else np.abs(x)


def sign(x: FloatOrArray) -> FloatOrArray:
    """``±1``, of zero too."""
    return math.copysign(1.0, x) if isinstance(x, float) else np.copysign(1.0, x)


def clip_value(x: FloatOrArray, low: float, high: float) -> FloatOrArray:
    """Return x within [low, high]."""
    return min(high, max(low, x)) if isinstance(x, float) else np.clip(x, low, high)


def larger(x: FloatOrArray, least: float) -> FloatOrArray:
    """Return x, or `least` where that is more."""
    return max(x, least) if isinstance(x, float) else np.maximum(x, least)


def propagate_deviation(
    function: Callable[[Sequence[float]], Sequence[float]],
    values: Sequence[float],
    covariance: Array,
) -> Array:
    """Standard deviations of `function(values)`, (m,), to first order, from the covariance of the values, (k, k)."""
    at = np.array(values)
    spread = np.sqrt(np.diag(covariance))
    steps = np.diag(1e-3 * np.where(spread > 0, spread, 1e-9))
    rows = [
        np.subtract(function((at + step).tolist()), function((at - step).tolist()))
        / (2 * step.sum())
        for step in steps
    ]
    slope = np.array(rows)
    return np.sqrt(np.einsum("ki,kl,li->i", slope, covariance, slope))
