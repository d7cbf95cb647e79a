"""Bias torque of a rig on a platform that moves, one state at a time: what the plant asks for at every stage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from gimbal_pin.platform import Platform
from gimbal_pin.rig import Rig

rnea = pin.rnea
NODE = 1e-6
"""Distance from a sample of the platform's motion, in intervals, within which a time is that sample's."""


class Carrier:
    """``C v + G`` with the base moving as prescribed: joint rows of RNEA with no joint acceleration."""

    def __init__(self, rig: Rig, platform: Platform) -> None:
        """Lay the platform's samples, on a uniform grid, out as Pinocchio takes them."""
        n = rig.n
        self.pin, self.n, self.rest = rig.floating, n, [0.0] * n
        self.data = self.pin.createData()
        self.start, self.step = float(platform.t[0]), float(platform.t[1] - platform.t[0])
        self.samples = np.hstack([platform.w, platform.f, platform.dw])
        # One array holds configuration, rates and accelerations, so that one assignment fills what changes in them.
        scratch = np.zeros(7 + n + 2 * (6 + n))
        scratch[6] = 1.0
        self.q, self.v, self.a = np.split(scratch, [7 + n, 13 + 2 * n])
        self.changing = scratch[7 : 19 + 2 * n]

    def bias(self, t: float, x: Sequence[float]) -> list[float]:
        """Torque at time t, s, angles and rates x, rad and rad/s, N m."""
        now, n = self.at(t), self.n
        self.changing[:] = [*x[:n], 0.0, 0.0, 0.0, *now[:3], *x[n:], *now[3:]]
        torque: list[float] = rnea(self.pin, self.data, self.q, self.v, self.a)[6:].tolist()
        return torque

    def at(self, t: float) -> list[float]:
        """Rate, specific force and angular acceleration at a time: a sample, or the parabola through three."""
        place = (t - self.start) / self.step
        near = round(place)
        if abs(place - near) < NODE and 0 <= near < len(self.samples):
            row: list[float] = self.samples[near].tolist()
            return row
        middle = min(max(near, 1), len(self.samples) - 2)
        s, (before, here, after) = place - middle, self.samples[middle - 1 : middle + 2]
        curved: list[float] = (here + s * ((after - before) / 2 + s * (before - 2 * here + after) / 2)).tolist()
        return curved
