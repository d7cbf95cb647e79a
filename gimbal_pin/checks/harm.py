"""Rows for the checks of the data, and what a fault costs in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.dynamics.model import build_stated_effects
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.log.platform import BaseMotion
from gimbal_pin.regression import (
    Block,
    Design,
    Filtering,
    classify_base_motion,
    compute_residuals,
    fit_weighted,
)
from gimbal_pin.rig.rig import Rig

MATERIAL = 0.01
"""What moves the torque by less than this share of its rms does not matter."""
SIGN_BAND = 2.5
"""Low-pass on the rate whose sign dry friction takes, in multiples of the cutoff: a fault may fill the rate with what
would leave no sample."""


def build_design(
    rig: Rig, log: Log, filtering: Filtering, base: BaseMotion | None = None
) -> Design:
    """Return a log's design for base parameters and friction, the direction of friction from the slow motion.

    The compact low-pass leaves rows of logs of seconds.

    Args:
        rig: The rig.
        log: The log.
        filtering: The filter.
        base: How the base moves; None: what this log says, of which a part may say less than the whole.
    """
    reduction = reduce_parameters(rig, base=base or classify_base_motion(rig, log))
    return Design(
        rig,
        reduction,
        build_stated_effects(rig, reduction),
        (log,),
        replace(filtering, direction=SIGN_BAND, compact=True),
    )


def spoils_torque(rig: Rig, log: Log, mended: Log, filtering: Filtering) -> bool:
    """Whether a fault matters: a log's residual differs from its mended version's, under the model of the latter.

    By more than that model leaves of the mended log's torque anyway, and than `MATERIAL` of it, rms, at any joint. A
    part of the log that only one of the two has makes no difference. Where the mended log is too short to be fitted,
    or where only one of the two says that the base moves, any fault matters.
    """
    if all(getattr(log, name) is getattr(mended, name) for name in ("t", "q", "v")):
        # Torques alone differ: by no more than is immaterial, whatever the model.
        sections = signals.lowpass(filtering.cutoff, 1.0 / log.dt)
        before = log.tau
        after = mended.tau
        assert before is not None and after is not None
        moved, size = (
            np.sqrt(np.mean(signals.zero_phase(x, sections) ** 2, axis=0))
            for x in (before - after, after)
        )
        if np.all(moved <= MATERIAL * size):
            return False
    good, bad = (list(build_design(rig, one, filtering)) for one in (mended, log))
    if not good or sum(block.b.size for block in good) < 3 * good[0].A.shape[2]:
        return True
    if bad and bad[0].A.shape[2] != good[0].A.shape[2]:
        return True
    theta = fit_weighted(good).theta
    left = np.concatenate([compute_residuals(block, theta) for block in good])
    torque = np.concatenate([block.b for block in good])
    floor, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (left, torque))
    error = np.sqrt(
        np.mean(compute_difference(good, left, bad, theta, filtering.cutoff) ** 2, axis=0)
    )
    return bool(np.any(error > np.maximum(np.maximum(floor, MATERIAL * size), 1e-300)))


def compute_difference(
    good: Sequence[Block], left: Array, bad: Sequence[Block], theta: Array, cutoff: float
) -> Array:
    """Return the bad rows' residual less the good ones', at those times of the good rows near which there are both."""
    if not bad:
        return np.zeros((1, left.shape[1]))
    at, t = (np.concatenate([block.t for block in blocks]) for blocks in (good, bad))
    other = np.concatenate([compute_residuals(block, theta) for block in bad])
    after = (
        np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1))
        if len(t) > 1
        else np.zeros(len(at), int)
    )
    near = np.minimum(np.abs(at - t[after]), np.abs(at - t[after - 1])) < 0.5 / cutoff
    interpolated = np.stack([np.interp(at, t, column) for column in other.T], axis=1)
    return np.asarray((interpolated - left)[near]) if near.any() else np.zeros((1, left.shape[1]))
