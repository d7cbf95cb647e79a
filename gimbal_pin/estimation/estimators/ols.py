"""Ordinary least squares (THESIS 4.16)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.estimation.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve
from gimbal_pin.estimation.rows import Block


def ols(blocks: Sequence[Block]) -> Estimate:
    """``theta = argmin Σ ‖b - A theta‖²`` over all joints alike, by triangular factors."""
    factors = factor(blocks)
    equal = np.ones(len(factors))
    theta, information, condition = solve(factors, equal)
    rows = sum(len(block.t) for block in blocks)
    power = residual_power(factors, theta, effective_rows(blocks))
    return Estimate(theta, covariance(blocks, theta, information, equal), np.sqrt(power), condition, rows, "ols")
