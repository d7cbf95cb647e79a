"""What a log shows of one joint: the range in which a cause's shape parameters are looked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.rig.brief import brief


class OperatingRange(NamedTuple):
    """Ranges of one joint's channels.

    Attributes:
        seconds: Length of the log, s.
        dt: Sampling interval, s.
        band: Highest frequency that is looked at, Hz.
        travel: Largest less smallest angle, rad.
        rate: What 98 % of the rates stay under, rad/s.
        rate_std: Standard deviation of the rate's noise, rad/s.
        torque: What 98 % of the torques stay under, N m.
        peak: The largest torque, N m.
        warm: Whether the motor's temperature was logged.
        upright: Whether the joint's axis is vertical throughout: gravity is then no torque there.
        middle: Half way between the largest and the smallest angle, rad.
        rms: Root mean square of the torques, N m; 0: not told.
    """

    seconds: float
    dt: float
    band: float
    travel: float
    rate: float
    rate_std: float
    torque: float
    peak: float
    warm: bool = False
    upright: bool = False
    middle: float = 0.0
    rms: float = 0.0

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)


def build_geometric_grid(
    low: float, high: float, count: int, shape: Parameter
) -> tuple[float, ...]:
    """Return `count` values from low to high, or what the shape parameter's bounds leave of that; none where nothing.

    Each is the same multiple of the last.
    """
    low = max(low, shape.lower)
    high = min(high, shape.upper)
    return tuple(np.geomspace(low, high, count).tolist()) if 0 < low < high else ()
