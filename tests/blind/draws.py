"""Random numbers that are drawn in many places."""

import numpy as np


def log_uniform(rng, low, high, size=None):
    """Draw numbers whose logarithms are uniform: a float, or an array of a size."""
    drawn = np.exp(rng.uniform(np.log(low), np.log(high), size))
    return float(drawn) if size is None else drawn


def draw_sign(rng):
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))
