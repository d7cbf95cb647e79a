"""Elementary functions of a float (simulation) or an array (identification), and propagation of uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from gimbal_pin.log.log import Array

Value = float | Array


def cos(x: Value) -> Value:
    """Cosine of an angle, rad."""
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def sin(x: Value) -> Value:
    """Sine of an angle, rad."""
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def exp(x: Value) -> Value:
    """Exponential."""
    return math.exp(x) if isinstance(x, float) else np.exp(x)


def size(x: Value) -> Value:
    """Absolute value."""
    return abs(x) if isinstance(x, float) else np.abs(x)


def hypot(x: Value, y: Value) -> Value:
    """``sqrt(x² + y²)``."""
    return math.hypot(x, y) if isinstance(x, float) and isinstance(y, float) else np.hypot(x, y)


def sign(x: Value) -> Value:
    """``±1``, of zero too."""
    return math.copysign(1.0, x) if isinstance(x, float) else np.copysign(1.0, x)


def clip_value(x: Value, low: float, high: float) -> Value:
    """Return x within [low, high]."""
    return min(high, max(low, x)) if isinstance(x, float) else np.clip(x, low, high)


def larger(x: Value, least: float) -> Value:
    """Return x, or `least` where that is more."""
    return max(x, least) if isinstance(x, float) else np.maximum(x, least)


def propagate_deviation(
    function: Callable[[Sequence[float]], Sequence[float]], values: Sequence[float], covariance: Array
) -> Array:
    """Standard deviations of `function(values)`, (m,), to first order, from the covariance of the values, (k, k)."""
    at, spread = np.array(values), np.sqrt(np.diag(covariance))
    steps = np.diag(1e-3 * np.where(spread > 0, spread, 1e-9))
    rows = [
        np.subtract(function((at + step).tolist()), function((at - step).tolist())) / (2 * step.sum()) for step in steps
    ]
    slope = np.array(rows)
    return np.sqrt(np.einsum("ki,kl,li->i", slope, covariance, slope))
