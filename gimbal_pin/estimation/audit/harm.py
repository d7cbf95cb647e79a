"""What a fault costs: the torque error that it makes in a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.estimation.audit.probe import MATERIAL, probe, rows_at
from gimbal_pin.estimation.estimators.base import residuals
from gimbal_pin.estimation.estimators.weighted import weighted
from gimbal_pin.estimation.rows import Block, Filtering
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig


class Harm(NamedTuple):
    """What a fault costs each joint, N m rms of the filtered torque, (n,).

    Attributes:
        error: Difference that the fault makes to the residual of one and the same model.
        admissible: What that model leaves of the mended log anyway, or `MATERIAL` of the torque where that is more.
    """

    error: Array
    admissible: Array

    @property
    def excess(self) -> Array:
        """Error over what is admissible, (n,); infinite where nothing is."""
        with np.errstate(over="ignore"):
            return self.error / np.maximum(self.admissible, 1e-300)

    @property
    def serious(self) -> bool:
        """Whether the fault stands out in any joint."""
        return bool(np.any(self.excess > 1.0))


def harm(rig: Rig, log: Log, mended: Log, filtering: Filtering) -> Harm:
    """Compare the residuals of a log and of its mended version under the model that the mended one gives.

    A part of the log that only one of the two has makes no error. Where the mended log is too short to be fitted, or
    where only one of the two says that the base moves, any error is too much: `error` is infinite.
    """
    good, bad = (rows_at(probe(rig, one, filtering), filtering.cutoff) for one in (mended, log))
    if not good or sum(block.b.size for block in good) < 3 * good[0].A.shape[2]:
        return Harm(np.full(rig.n, np.inf), np.zeros(rig.n))
    if bad and bad[0].A.shape[2] != good[0].A.shape[2]:
        return Harm(np.full(rig.n, np.inf), np.zeros(rig.n))
    theta = weighted(good).theta
    left = np.concatenate([residuals(block, theta) for block in good])
    torque = np.concatenate([block.b for block in good])
    floor, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (left, torque))
    apart = difference(good, left, bad, theta, filtering.cutoff)
    return Harm(np.sqrt(np.mean(apart**2, axis=0)), np.maximum(floor, MATERIAL * size))


def difference(good: Sequence[Block], left: Array, bad: Sequence[Block], theta: Array, cutoff: float) -> Array:
    """Return the bad rows' residual less the good ones', at those times of the good rows near which there are both."""
    if not bad:
        return np.zeros((1, left.shape[1]))
    at, t = (np.concatenate([block.t for block in blocks]) for blocks in (good, bad))
    other = np.concatenate([residuals(block, theta) for block in bad])
    after = np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1)) if len(t) > 1 else np.zeros(len(at), int)
    near = np.minimum(np.abs(at - t[after]), np.abs(at - t[after - 1])) < 0.5 / cutoff
    interpolated = np.stack([np.interp(at, t, column) for column in other.T], axis=1)
    return np.asarray((interpolated - left)[near]) if near.any() else np.zeros((1, left.shape[1]))
