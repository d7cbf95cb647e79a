"""Share of the time that motors are at their torque limits: there the loop is open, whatever the controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gimbal_pin.log import Array

SPOKEN = 0.05
"""Share of the time from which on it is spoken of."""
PUSHED = "there a joint goes where it is pushed: jitter, ratios and targets say little of the controllers"
"""What follows for who holds a camera."""


def at_limit(joints: Sequence[str], tau: Array, tau_max: Array) -> dict[str, float]:
    """Return joint → share of the samples at the limit.

    Args:
        joints: Joint names.
        tau: Commanded torque, clipped, N m, (N, n).
        tau_max: Its limit, N m, (n,).
    """
    share = np.mean(np.abs(tau) >= tau_max * (1 - 1e-9), axis=0)
    return dict(zip(joints, share.tolist()))


def limited(shares: Mapping[str, float]) -> str:
    """Return ``yaw 45 %, roll 12 %``, the longest first; nothing where no share is worth a word."""
    weak = sorted((pair for pair in shares.items() if pair[1] >= SPOKEN), key=lambda pair: -pair[1])
    return ", ".join(f"{joint} {100 * share:.0f} %" for joint, share in weak)
