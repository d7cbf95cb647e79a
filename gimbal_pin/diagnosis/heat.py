"""How much of each joint's torque a model leaves unexplained from moment to moment, for a scene to show as colour."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from gimbal_pin.diagnosis.band import BAND
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.diagnosis.heldout import filtered, torque_error
from gimbal_pin.dynamics.model import Model
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.log import Array, Log

FULL = 0.1
"""Residual, as a share of the joint's torque rms, at which a joint is all red."""
WINDOW = 0.3
"""Time over which the residual's size is taken, s."""

LEAST = 0.1
"""Share of the window in which the joint has to move for its residual to count whole."""


def heat(model: Model, log: Log, filtering: Filtering = BAND) -> Array:
    """``min(1, rms(tau - model) / (FULL rms(tau)))``, one value per sample and joint of the log, (N, n).

    The residual is low-passed at the filtering's cutoff; its size is that over `WINDOW` around each sample, where the
    joint moves: as it stands, dry friction bears any torque. Samples in gaps count as the nearest.

    Args:
        model: The model, with drives and terms, of a rig with the log's joints.
        log: The log, with torques.
        filtering: As for `diagnose`.

    Raises:
        DataError: The log is too short to be judged.
        UsageError: It holds no torque.
    """
    evidence = gather(model.rig, [log], filtering, {log.name: float(log.t[0])})
    torque = np.sqrt(np.mean(np.concatenate(evidence.torque) ** 2, axis=0))
    times, sizes = [], []
    for part in evidence.parts:
        error = filtered(part, torque_error(part, Extended(model)), evidence.band)
        window = max(1, round(WINDOW / part.dt))
        power, moving = (uniform_filter1d(x**2, window, axis=0, mode="constant") for x in (error, part.gate))
        power /= np.maximum(moving, LEAST)
        times.append(part.channels.t)
        sizes.append(np.sqrt(np.maximum(power, 0.0)) / np.maximum(FULL * torque, 1e-300))
    t, size = np.concatenate(times), np.concatenate(sizes)
    return np.clip(np.stack([np.interp(log.t, t, column) for column in size.T], axis=1), 0.0, 1.0)
