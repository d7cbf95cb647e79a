"""Share of the time that motors are at their torque limits, where the loop is open, and that joints are past stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gimbal_pin.log.log import Array

LEAST_SHARE_TOLD = 0.05
"""Least share of the time that is reported."""
_NEARLY = 0.03
"""Relative distance within which a measured torque, with its sensor's noise, counts as at the limit."""
MOSTLY = 0.5
"""Share of the time at the limit from which a log shows little of the rig."""
PUSHED = "there a joint goes where it is pushed: jitter and ratios say little of the controllers"
"""What that means for a held camera."""
THROUGH_STOPS = (
    "past its stops, through which a simulation lets it pass: {} of the time; no rig writes such a log: the loop is "
    "lost, to a delay over its margin or to what was planted; state less of them, or lower the controller's bandwidth"
)
"""Message on joints that a simulated loop has lost, and the mend."""


def compute_share_near_limit(tau: Array, tau_max: Array) -> Array:
    """Return the share of the samples of a measured torque, N m, (N, n), at its limit, N m, (n,): (n,)."""
    return np.asarray(np.mean(np.abs(np.abs(tau) / tau_max - 1.0) < _NEARLY, axis=0))


def compute_limit_shares(joints: Sequence[str], tau: Array, tau_max: Array) -> dict[str, float]:
    """Return joint → share of the samples at the limit.

    Args:
        joints: Joint names.
        tau: Commanded torque, clipped, N m, (N, n).
        tau_max: Its limit, N m, (n,).
    """
    share = np.mean(np.abs(tau) >= tau_max * (1 - 1e-9), axis=0)
    return dict(zip(joints, share.tolist()))


def describe_limits(shares: Mapping[str, float]) -> str:
    """Return ``yaw 45 %, roll 12 %``, the longest first; empty where no share reaches `LEAST_SHARE_TOLD`."""
    weak = sorted(
        (pair for pair in shares.items() if pair[1] >= LEAST_SHARE_TOLD), key=lambda pair: -pair[1]
    )
    return ", ".join(f"{joint} {100 * share:.0f} %" for joint, share in weak)


def describe_passed_stops(joints: Sequence[str], q: Array, lower: Array, upper: Array) -> str:
    """Return ``tilt 62 %``, the share of the samples past a stop; empty where no joint went there.

    Args:
        joints: Joint names.
        q: True angles, rad, (N, n).
        lower: The lower stops, rad, (n,); infinite where there is none.
        upper: The upper stops.
    """
    shares = np.mean((q < lower) | (q > upper), axis=0).tolist()
    return ", ".join(
        f"{joint} {100 * share:.2g} %" for joint, share in zip(joints, shares) if share > 0
    )
