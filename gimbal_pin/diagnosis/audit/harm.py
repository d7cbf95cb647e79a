"""What a fault costs: the torque error that it makes in a fit at the default cutoff, against the sensors' noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin import signals
from gimbal_pin.diagnosis.audit.base import MATERIAL
from gimbal_pin.diagnosis.audit.probe import probe, rms, rows_at
from gimbal_pin.estimators.base import residuals
from gimbal_pin.estimators.weighted import weighted
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering


class Harm(NamedTuple):
    """What a fault costs each joint, N m rms after the default filter, (n,).

    Attributes:
        error: Difference that the fault makes to the residual of one and the same model.
        floor: What the sensors' noise makes of it anyway.
        torque: The torque itself.
    """

    error: Array
    floor: Array
    torque: Array

    @property
    def excess(self) -> Array:
        """Error over what is admissible: the noise floor, or `MATERIAL` of the torque where that is more, (n,)."""
        return np.asarray(self.error / np.maximum(np.maximum(self.floor, MATERIAL * self.torque), 1e-300))

    @property
    def serious(self) -> bool:
        """Whether the fault shows above both in any joint."""
        return bool(np.any(self.excess > 1.0))

    @property
    def worst(self) -> int:
        """The joint with the largest excess."""
        return int(np.argmax(self.excess))

    @property
    def severity(self) -> tuple[Parameter, ...]:
        """The worst joint's error and noise floor."""
        return (
            Parameter("torque_error", float(self.error[self.worst]), "N m"),
            Parameter("noise_floor", float(self.floor[self.worst]), "N m"),
        )


def harm(rig: Rig, log: Log, mended: Log) -> Harm:
    """Compare the residuals of a log and of its mended version under the model that the mended one gives.

    A part of the log that only one of the two has makes no error. Where the mended log is too short to be fitted, any
    error is too much: `error` is infinite.
    """
    good, bad = (rows_at(probe(rig, one), Filtering().cutoff) for one in (mended, log))
    floor = noise_floor(rig, mended)
    if not good or sum(block.b.size for block in good) < 3 * good[0].A.shape[2]:
        return Harm(np.full(rig.n, np.inf), floor, np.zeros(rig.n))
    theta = weighted(good).theta
    error = np.zeros(rig.n)
    torque = rms([block.b for block in good])
    if bad:
        t, there = (np.concatenate(x) for x in zip(*((block.t, residuals(block, theta)) for block in bad)))
        at, here = (np.concatenate(x) for x in zip(*((block.t, residuals(block, theta)) for block in good)))
        near = np.abs(at - t[np.clip(np.searchsorted(t, at), 0, len(t) - 1)]) < 0.5 / Filtering().cutoff
        apart = [np.interp(at, t, there[:, j]) - here[:, j] for j in range(rig.n)]
        error = rms([np.stack(apart, axis=1)[near]]) if near.any() else error
    return Harm(error, floor, torque)


def noise_floor(rig: Rig, log: Log) -> Array:
    """Torque noise that the sensors alone leave after the default filter, N m, (n,).

    ``sqrt((g₀ σ_τ)² + M² (g₂ σ_q)²)``: white noise of torque and angle from their third differences, the angle's
    through two derivatives and the given model's mass matrix at the mean pose.
    """
    sections = signals.lowpass(Filtering().cutoff, 1.0 / log.dt)
    mass = np.abs(pin.crba(rig.model, rig.model.createData(), np.mean(log.q, axis=0)))
    mass = np.maximum(mass, mass.T)
    torque = signals.noise_std(log.tau) if log.tau is not None else np.zeros(rig.n)
    still = signals.noise_gain(sections, 1.0 / log.dt, 0) * torque
    moved = signals.noise_gain(sections, 1.0 / log.dt, 2) * signals.noise_std(log.q)
    return np.asarray(np.sqrt(still**2 + (mass**2) @ (moved**2)))
