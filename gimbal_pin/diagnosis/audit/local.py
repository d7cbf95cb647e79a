"""A sample against its neighbours: what is left where the cubic through two on either side is taken off."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log import Array


def left_out(t: Array, x: Array) -> Array:
    """Return ``x_k - p(t_k)``, p the cubic through the samples k-2, k-1, k+1, k+2, (N - 4, n), scaled to white noise.

    White noise of deviation σ gives σ whatever the spacing; anything smooth gives nothing.

    Args:
        t: Times, (N,).
        x: Values, (N, n).
    """
    n = len(t) - 4
    around = np.stack([t[i : i + n] for i in (0, 1, 3, 4)])
    middle = t[2 : 2 + n]
    weight = np.ones((4, n))
    for i in range(4):
        for j in range(4):
            if i != j:
                weight[i] *= (middle - around[j]) / (around[i] - around[j])
    guess = sum(w[:, None] * x[i : i + n] for w, i in zip(weight, (0, 1, 3, 4)))
    return np.asarray((x[2 : 2 + n] - guess) / np.sqrt(1.0 + np.sum(weight**2, axis=0))[:, None])
