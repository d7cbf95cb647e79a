"""Reference motions between two poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gimbal_pin.control.laws.uncertainty import home
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Motion

PEAK_RATE = 15 / 8
"""Largest rate of a minimum-jerk move, in distance per duration."""
PEAK_ACCELERATION = 10 / 3**0.5
"""Largest acceleration of a minimum-jerk move, in distance per duration squared."""
ROOM = 0.9
"""Share of a torque limit that a step's own torque may take: the rest is the feedback's."""


def minimum_jerk(
    start: Array, goal: Array, *, dt: float, move: float = 0.5, before: float = 0.1, after: float = 0.6
) -> Motion:
    """Rest, move, rest: ``q = start + (goal - start)(10 s³ - 15 s⁴ + 6 s⁵)``, s from 0 to 1 (Flash and Hogan 1985).

    Args:
        start: Angles at first, rad, (n,).
        goal: Angles at last, rad, (n,).
        dt: Sampling interval, s.
        move: Duration of the move, s.
        before: Rest before it, s.
        after: Rest after it, s.

    Raises:
        UsageError: The interval or the move is not positive, or a rest is negative.
    """
    if not (dt > 0 and move > 0 and before >= 0 and after >= 0):
        what = f"has dt {dt:g} s, move {move:g} s, rests {before:g} and {after:g} s"
        raise UsageError("minimum-jerk step", what, "give a positive interval and move, and rests of at least zero")
    t = dt * np.arange(round((before + move + after) / dt) + 1, dtype=np.float64)
    s = np.clip((t - before) / move, 0.0, 1.0)[:, None]
    distance: Array = np.asarray(goal, np.float64) - np.asarray(start, np.float64)
    q = start + distance * s**3 * (10 - 15 * s + 6 * s**2)
    v: Array = distance / move * 30 * (s * (1 - s)) ** 2
    a = distance / move**2 * 60 * s * (1 - s) * (1 - 2 * s)
    return Motion(t, q, v, a)


def within(plant: Model, steps: Sequence[float], move: float) -> Array:
    """Return steps from home, rad, (n,), made smaller where limits (angle, rate, acceleration, torque) ask for it."""
    start, limits = home(plant.rig), plant.rig.limits
    goal: Array = np.clip(start + np.array(steps), [x.lower for x in limits], [x.upper for x in limits]) - start
    largest = [min(x.velocity * move / PEAK_RATE, x.acceleration * move**2 / PEAK_ACCELERATION) for x in limits]
    goal = np.clip(goal, -np.array(largest), largest)
    for _ in range(40):
        reference = minimum_jerk(start, start + goal, dt=move / 50, move=move)
        share = np.abs(plant.inverse(reference.q, reference.v, reference.a)).max(axis=0) / plant.rig.tau_max
        if (share <= ROOM).all():
            break
        goal = np.where(share > ROOM, 0.9 * goal, goal)
    return goal


def tour(plant: Model, dt: float, size: float = 0.5, move: float = 1.2) -> Motion:
    """From home to one side of every axis, to the other, and back, by minimum jerk, within all limits.

    Args:
        plant: Model whose torque limits hold.
        dt: Sampling interval, s.
        size: Angle to each side, rad; smaller where a limit asks for it.
        move: Duration of each move, s.
    """
    start = home(plant.rig)
    signs = (-1.0) ** np.arange(plant.rig.n)
    # The middle leg goes from side to side: what fits it twice over fits the others.
    sides = [within(plant, list(2 * side * size * signs), move) / 2 for side in (1, -1)]
    goals = [start, *(start + side for side in sides), start]
    legs = [minimum_jerk(a, b, dt=dt, move=move, before=0.2, after=0.2) for a, b in pairwise(goals)]
    parts = [
        np.concatenate([getattr(leg, name)[: -1 if k < len(legs) - 1 else None] for k, leg in enumerate(legs)])
        for name in "qva"
    ]
    return Motion(dt * np.arange(len(parts[0])), *parts)
