"""The noise floor from the sensors: what their noise alone leaves in the torque balance, per joint and frequency."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig

MASS_POSES = 64
"""Poses over which the mass matrix is averaged."""


def average_mass_matrix(rig: Rig, q: Array) -> Array:
    """Root mean square of each entry of M(q) over some of the angles q, (N, n), in kg m², (n, n)."""
    data = rig.model.createData()
    total = np.zeros((rig.n, rig.n))
    some = q[:: max(1, len(q) // MASS_POSES)]
    for angles in some:
        upper = np.triu(pin.crba(rig.model, data, angles))
        total += (upper + np.triu(upper, 1).T) ** 2
    return np.sqrt(total / len(some))


def compute_noise_floor(rig: Rig, log: Log, frequency: Array) -> tuple[Array, Array]:
    """``P_j(f) = σ_τj² + Σ_k M_jk² min(σ_qk² ω⁴, σ_vk² ω²)``: what the sensors' noise leaves in the torque balance.

    The angle's and the rate's noise come in through the acceleration, by whichever of the two is better at that
    frequency; noise of standard deviation σ that is white at the log's rate has the power σ². The torque's term and
    the motion's are returned apart, (N m)², (n, f) each.

    Args:
        rig: The rig, for its mass matrix.
        log: The log, with its sensors' noise in its third differences.
        frequency: Hz, (f,).
    """
    w2 = (2 * np.pi * frequency) ** 2
    tau = np.zeros((1, rig.n)) if log.tau is None else log.tau
    acceleration = signals.noise_std(log.q)[:, None] ** 2 * w2**2
    if log.v is not None:
        acceleration = np.minimum(acceleration, signals.noise_std(log.v)[:, None] ** 2 * w2)
    torque = signals.jumping_noise_std(tau)
    # A log without any noise still has rounding: a ten-thousandth of the torque's own size.
    least = 1e-4 * np.maximum(np.std(tau, axis=0), 1e-9)
    power = np.maximum(torque, least)[:, None] ** 2 * np.ones_like(frequency)
    return power, average_mass_matrix(rig, log.q) ** 2 @ acceleration
