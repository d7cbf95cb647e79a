"""Near a singular pose: which turn of the camera its joints can hardly make, and what it would take."""

from __future__ import annotations

import numpy as np

from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.sight import Sight

AXES = ("x, its line of sight", "y", "z")
"""Of the camera's frame."""
TAKES_PART = 0.3
"""Share of the joints' motion from which on a joint is named."""


def lost_turn(sight: Sight, q: Array) -> str:
    """Say what ``σ u = J v``, σ the least singular value of the Jacobian, means: 1/σ of motion along v to turn about u.

    A motor that cannot accelerate its joint 1/σ times as fast as the platform turns the camera does not hold it,
    whoever controls it.

    Args:
        sight: The camera's kinematics.
        q: Angles, rad, (n,).
    """
    left, values, right = np.linalg.svd(sight.view(q).J, full_matrices=False)
    named = AXES if len(left) == 3 else AXES[1:]
    axis = named[int(np.argmax(np.abs(left[:, -1])))]
    joints = [joint for joint, part in zip(sight.rig.joints, np.abs(right[-1])) if part > TAKES_PART]
    times = f"{digits(1 / values[-1], 2)} times as fast" if values[-1] > 1e-3 else "without end"
    who = " and ".join(joints)
    return f"to turn the camera about {axis}, {who} would have to turn {times}, so nobody holds it there"
