"""Instrumental variables whose instruments are simulated with the model that they estimate (IDIM-IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gimbal_pin.estimation.estimators.base import Estimate
from gimbal_pin.estimation.estimators.instrumental import instrumental
from gimbal_pin.estimation.estimators.physical import physical
from gimbal_pin.estimation.replay import bodies, simulated
from gimbal_pin.estimation.rows import Block, kept, standing_for
from gimbal_pin.log.log import Array

PASSES = 2
"""Estimates in turn, each with the instruments that the one before simulates; a third would hardly move."""


def idim(blocks: Sequence[Block]) -> Estimate:
    """``theta = (Σ ZᵀWA)⁻¹ Σ ZᵀWb`` with Z the regressor along the motion that the current model makes in closed loop.

    That motion follows the true one and knows next to nothing of the sensors' noise (Janot, Vandanjon and Gautier
    2014): where the regressor is noisy, and least squares shrinks what multiplies the acceleration, this does not.
    """
    found = physical(blocks)
    for _ in range(PASSES):
        found = instrumental(blocks, instruments(blocks, found))
    return found


def instruments(blocks: Sequence[Block], found: Estimate) -> list[Array]:
    """Return per block Z, (m, n, k), along the motion of the bodies nearest to an estimate."""
    rows = standing_for(blocks)
    model = bodies(rows, found.theta, found.covariance)
    return [block.A for block in kept(replace(rows, logs=simulated(rows, model)))]
