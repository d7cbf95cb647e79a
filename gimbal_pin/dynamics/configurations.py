"""States that fill what a rig can do evenly and always alike: where its limits end, and what is taken where none is."""

from __future__ import annotations

from math import isfinite, pi

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.rig.config import Limits
from gimbal_pin.rig.rig import Rig

TURN = pi
"""Travel to either side that is used where a revolute joint states no limit, rad; one-sided limits get twice that."""

REFERENCE_STATES = 2000
"""States that `fill_limits` returns."""


def spread_reference_states(rig: Rig) -> Motion:
    """States spread evenly over the rig's own limits, (REFERENCE, n); not a motion in time."""
    ends = np.array([fill_angle_limits(rig, j, limit) for j, limit in enumerate(rig.limits)])
    velocity, acceleration = (
        np.array([getattr(x, name) for x in rig.limits]) for name in ("velocity", "acceleration")
    )
    return fill_limits(ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2, velocity, acceleration)


def fill_limits(centre: Array, half: Array, velocity: Array, acceleration: Array) -> Motion:
    """States spread evenly over limits, always the same ones, (REFERENCE, n); not a motion in time.

    Where no acceleration limit is stated: what half a hertz at full rate takes.

    Args:
        centre: Middle of the travel, rad, (n,).
        half: Half of the travel, rad, (n,).
        velocity: Rate limits, rad/s, (n,); infinite: see `fill_rate_limits`.
        acceleration: Acceleration limits, rad/s², (n,).
    """
    q, v, a = np.split(compute_roberts_sequence(3 * len(centre), REFERENCE_STATES), 3, axis=1)
    rate = fill_rate_limits(half, velocity)
    most = np.where(np.isfinite(acceleration), acceleration, pi * rate)
    return Motion(np.zeros(REFERENCE_STATES), centre + half * q, rate * v, most * a)


def fill_rate_limits(half: Array, velocity: Array) -> Array:
    """Rate limits, (n,); where none is stated: what half a hertz over the full travel takes."""
    return np.where(np.isfinite(velocity), velocity, pi * half)


def fill_angle_limits(rig: Rig, j: int, limit: Limits) -> tuple[float, float]:
    """A joint's angle limits, those that are not stated filled in; `UsageError` for a slide without limits."""
    if isfinite(limit.lower) and isfinite(limit.upper):
        return limit.lower, limit.upper
    if rig.slides[j]:
        raise UsageError(
            f"rig {rig.name}: joint '{rig.joints[j]}'",
            "slides without limits",
            "state its travel, m",
        )
    if isfinite(limit.upper):
        return limit.upper - 2 * TURN, limit.upper
    return (limit.lower, limit.lower + 2 * TURN) if isfinite(limit.lower) else (-TURN, TURN)


def compute_roberts_sequence(dimensions: int, count: int) -> Array:
    """Points that fill [-1, 1]^dimensions evenly and always alike (Roberts's R sequence), (count, dimensions)."""
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (dimensions + 1))
    return (
        2 * (np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimensions + 1)) % 1.0) - 1
    )
