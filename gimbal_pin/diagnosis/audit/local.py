"""A sample against its neighbours: what a cubic leaves of it, and whether it repeats the one before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.diagnosis.audit.quantisation import quantum
from gimbal_pin.log import Array
from gimbal_pin.rows import Flags

SAMPLES, SECONDS = 8, 0.02
"""A run of equal values is long from so many samples, and from so long, on."""
RAIL, RUN = 0.003, 3.0
"""A rail holds this share of the samples, in runs of so many on average."""


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


def constant(column: Array, dt: float) -> Flags:
    """Rows in long runs of one value, or at a rail, (N,)."""
    lengths = np.diff(run_edges(np.append(True, np.diff(column) != 0.0)))
    out = np.repeat(lengths, lengths) >= max(SAMPLES, SECONDS / dt)
    step = quantum(column)
    for end in (column.min(), column.max()):
        there = np.abs(column - end) <= 0.5 * step
        runs = np.count_nonzero(np.diff(np.append(False, there).astype(int)) > 0)
        if np.mean(there) > RAIL and there.sum() > RUN * runs:
            out |= there
    return np.asarray(out)


def run_edges(starts: Flags) -> NDArray[np.integer[Any]]:
    """Indices where runs start, and the length of all."""
    return np.concatenate([np.flatnonzero(starts), [len(starts)]])


def level(values: Array) -> float:
    """Root mean square without the largest two per cent."""
    squares = np.sort(values**2)
    return float(np.sqrt(squares[: max(1, int(0.98 * len(squares)))].mean()))
