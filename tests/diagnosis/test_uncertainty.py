"""Laws of what a fit's coefficients may be off by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.diagnosis.score import BlockFit, fit_blocks
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.log import Array

ROWS = 24
"""Rows of a fold: 1 s at twice a band of 12 Hz."""


def fit_linear_model(
    rng: np.random.Generator, folds: int, coefficients: int, correlation: float, precision: float
) -> tuple[BlockFit, Array]:
    """Return a fit of two joints with columns and noise of one correlation, and what its coefficients are off by."""
    count = folds * ROWS

    def draw(*shape: int) -> Array:
        white = rng.standard_normal((count + 200, *shape))
        size = np.sqrt(1 - correlation**2)
        return np.asarray(lfilter([size], [1, -correlation], white, axis=0)[200:])

    columns = [draw(coefficients) for _ in range(2)]
    size = 1.0 if precision == 0 else precision**-0.5
    theta = size * rng.standard_normal(coefficients)
    target = np.stack([B @ theta for B in columns], axis=1) + 0.5 * draw(2)
    slices = tuple(slice(ROWS * k, ROWS * (k + 1)) for k in range(folds))
    effective = np.full((folds, 2), float(ROWS))
    fit = fit_blocks(columns, target, slices, effective, np.full(coefficients, precision))
    return fit, fit.theta - theta


@pytest.mark.parametrize(
    ("folds", "coefficients", "correlation", "precision"),
    [(20, 8, 0.9, 0.0), (20, 20, 0.9, 0.0), (8, 8, 0.9, 0.0), (20, 8, 0.0, 0.0), (8, 8, 0.9, 1e4)],
)
def test_95_percent_intervals_hold_the_truth(
    folds: int, coefficients: int, correlation: float, precision: float
) -> None:
    """Of noise of any colour, and of coefficients that the prior alone knows."""
    rng = np.random.default_rng(0)
    hits = list[list[bool]]()
    for _ in range(200):
        fit, off = fit_linear_model(rng, folds, coefficients, correlation, precision)
        std = np.sqrt(np.diag(fit.covariance))
        hits.append((np.abs(off) < NORMAL_95 * std).tolist())
    assert 0.88 < np.mean(hits) < 0.98
