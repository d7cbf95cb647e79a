"""Whether a rig can hold its camera on a platform at all."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.rig.rig import Rig

REACHED = 1e-6
"""Error up to which an attitude is reached, rad."""


def unable(rig: Rig, wanted: Array) -> str | None:
    """Return why a rig cannot keep its camera's attitude on a platform that moves, or None if it can.

    Args:
        rig: The rig.
        wanted: R_d, the attitude in the world; of two axes the line of sight alone is asked for, (3, 3).
    """
    if not np.isfinite(rig.tau_max).all():
        return "its torque limits are not stated"
    sight = Sight(rig)
    q = sight.reached(np.eye(3), wanted, sight.home)
    view = sight.view(q)
    if np.abs(sight.error(view.R, wanted)).max() > REACHED:
        return f"its joints cannot turn {rig.camera_frame} to where it should look"
    if view.steep:
        return "it is near a singular pose where the camera looks as wanted"
    for joint, limit, angle in zip(rig.joints, rig.limits, q.tolist()):
        if not limit.lower <= angle <= limit.upper:
            return f"{joint} reaches its limit before the camera looks as wanted"
    return None
