"""Dynamics of a rig on a platform that moves, one state at a time: what the plant asks for at every stage."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from struct import Struct

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.rig import Rig

rnea = pin.rnea
aba = pin.aba
_Halves = tuple[list[float], list[float]]
NODE = 1e-6
"""Distance from a sample of the platform's motion, in intervals, within which a time is that sample's."""
HEAVY = 2.0**60
"""Inertia of a base that nothing on it moves, kg and kg m²: what the joints push it by is lost in it (1e-15). A power
of two: the force that gives it the prescribed acceleration has that acceleration's digits."""


FIXED = 7 * 8
"""Bytes of the base's place and attitude, before what changes."""


class MovingBase:
    """``C v + G`` and ``a = D⁻¹(τ - C v - G)`` with the base moving as prescribed.

    The first are the joint rows of RNEA with no joint acceleration. The second is one ABA of a base so heavy that it
    moves as it is pushed.
    """

    def __init__(self, rig: Rig, platform: Platform, armature: Array) -> None:
        """Lay the platform's samples, on a uniform grid, out as Pinocchio takes them.

        `armature`: inertia of the joints' own motors, kg m², (n,).
        """
        n = rig.n
        self.pin = rig.floating.copy()
        self.n = n
        self.pin.armature = np.concatenate([np.full(6, HEAVY), armature])
        self.data = self.pin.createData()
        self.still = [0.0] * n
        self.start = float(platform.t[0])
        self.step = float(platform.t[1] - platform.t[0])
        self.last = len(platform) - 1
        self.samples = np.hstack(
            [np.zeros_like(platform.w), platform.w, HEAVY * platform.f, HEAVY * platform.dw]
        )
        # The middle of a step is asked for twice, and its end again as the next one's start.
        self.near = -1
        self.row = _split_halves(self.samples[0])
        # One array holds configuration, rates and what drives them: packed at once, but for the base's place.
        scratch = np.zeros(7 + n + 2 * (6 + n))
        scratch[6] = 1.0
        self.q, self.v, self.drive = np.split(scratch, [7 + n, 13 + 2 * n])
        self.fill = partial(Struct(f"{12 + 3 * n}d").pack_into, scratch.data, FIXED)

    def bias(self, t: float, q: Sequence[float], v: Sequence[float]) -> list[float]:
        """Torque at time t, s, angles and rates, rad and rad/s, N m."""
        rates, pushes = self.at(t)
        self.fill(*q, *rates, *v, *[push / HEAVY for push in pushes], *self.still)
        torque: list[float] = rnea(self.pin, self.data, self.q, self.v, self.drive).tolist()[6:]
        return torque

    def accelerations(
        self, t: float, q: Sequence[float], v: Sequence[float], net: Sequence[float]
    ) -> list[float]:
        """Joint accelerations at time t, s, angles and rates, under the torques `net` on the rigid body, rad/s²."""
        rates, pushes = self.at(t)
        self.fill(*q, *rates, *v, *pushes, *net)
        found: list[float] = aba(self.pin, self.data, self.q, self.v, self.drive).tolist()[6:]
        return found

    def at(self, t: float) -> _Halves:
        """The base's rates and what pushes it at a time: a sample, or the parabola through three."""
        place = (t - self.start) / self.step
        near = round(place)
        if near == self.near and -NODE < place - near < NODE:
            return self.row
        if -NODE < place - near < NODE and 0 <= near <= self.last:
            self.near = near
            self.row = _split_halves(self.samples[near])
            return self.row
        middle = min(max(near, 1), self.last - 1)
        s = place - middle
        (before, here, after) = self.samples[middle - 1 : middle + 2]
        return _split_halves(
            here + s * ((after - before) / 2 + s * (before - 2 * here + after) / 2)
        )


def _split_halves(row: Array) -> _Halves:
    """Return rates and pushes, six each, of a base at one time, (12,)."""
    return row[:6].tolist(), row[6:].tolist()
