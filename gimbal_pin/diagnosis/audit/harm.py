"""What a fault costs: the torque error that it makes in a fit at the default cutoff."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.audit.base import MATERIAL
from gimbal_pin.diagnosis.audit.probe import probe, rms, rows_at
from gimbal_pin.estimators.base import residuals
from gimbal_pin.estimators.weighted import weighted
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Block, Filtering


class Harm(NamedTuple):
    """What a fault costs each joint, N m rms after the default filter, (n,).

    Attributes:
        error: Difference that the fault makes to the residual of one and the same model.
        floor: What that model leaves of the mended log anyway: the sensors' noise, and what else it does not know.
        torque: The torque itself.
    """

    error: Array
    floor: Array
    torque: Array

    @property
    def excess(self) -> Array:
        """Error over what is admissible: the floor, or `MATERIAL` of the torque where that is more, (n,)."""
        return np.asarray(self.error / np.maximum(np.maximum(self.floor, MATERIAL * self.torque), 1e-300))

    @property
    def serious(self) -> bool:
        """Whether the fault stands out in any joint."""
        return bool(np.any(self.excess > 1.0))

    @property
    def worst(self) -> int:
        """The joint with the largest excess."""
        return int(np.argmax(self.excess))

    @property
    def severity(self) -> tuple[Parameter, ...]:
        """The worst joint's error and floor."""
        return (
            Parameter("torque_error", float(self.error[self.worst]), "N m"),
            Parameter("torque_floor", float(self.floor[self.worst]), "N m"),
        )


def harm(rig: Rig, log: Log, mended: Log) -> Harm:
    """Compare the residuals of a log and of its mended version under the model that the mended one gives.

    A part of the log that only one of the two has makes no error. Where the mended log is too short to be fitted, any
    error is too much: `error` is infinite.
    """
    good, bad = (rows_at(probe(rig, one), Filtering().cutoff) for one in (mended, log))
    if not good or sum(block.b.size for block in good) < 3 * good[0].A.shape[2]:
        return Harm(np.full(rig.n, np.inf), np.zeros(rig.n), np.zeros(rig.n))
    theta = weighted(good).theta
    left = [residuals(block, theta) for block in good]
    apart = difference(good, left, bad, [residuals(block, theta) for block in bad])
    error = rms([apart]) if len(apart) else np.zeros(rig.n)
    return Harm(error, rms(left), rms([block.b for block in good]))


def difference(good: Sequence[Block], left: Sequence[Array], bad: Sequence[Block], other: Sequence[Array]) -> Array:
    """Return ``other - left`` at those times of the good rows near which there are bad ones, (m, n)."""
    if not bad:
        return np.zeros((0, left[0].shape[1]))
    at, t = (np.concatenate([block.t for block in blocks]) for blocks in (good, bad))
    here, there = np.concatenate(left), np.concatenate(other)
    distance = np.abs(at[:, None] - t[np.clip(np.searchsorted(t, at)[:, None] - [0, 1], 0, len(t) - 1)]).min(axis=1)
    near = distance < 0.5 / Filtering().cutoff
    interpolated = np.stack([np.interp(at, t, column) for column in there.T], axis=1)
    return np.asarray((interpolated - here)[near])
