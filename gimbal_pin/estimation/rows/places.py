"""Base parameters and where they stand in `Rig.phi`."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import columns
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig


def columns_of(rig: Rig, reduction: Reduction) -> Array:
    """Places in `Rig.phi` of the reduction's independent columns."""
    names, places = columns(rig)
    index = dict(zip(names, places))
    return np.array([index[reduction.names[j]] for j in reduction.independent])


def over_phi(rig: Rig, reduction: Reduction) -> Array:
    """Base parameters per entry of `Rig.phi`, (b, 10 n)."""
    out = np.zeros((len(reduction.independent), 10 * rig.n))
    out[:, columns(rig)[1]] = reduction.mixing
    return out


def camera_body(rig: Rig) -> int:
    """Return the body (from 0) that carries the camera."""
    link = rig.payload_link or rig.camera_frame
    return int(rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)].parentJoint or rig.n) - 1
