"""Random numbers that are drawn in many places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator


def log_uniform(rng: Generator, low: float, high: float, size: Any = None) -> Any:
    """Draw numbers whose logarithms are uniform: a float, or an array of a size."""
    drawn = np.exp(rng.uniform(np.log(low), np.log(high), size))
    return float(drawn) if size is None else drawn


def draw_sign(rng: Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))
