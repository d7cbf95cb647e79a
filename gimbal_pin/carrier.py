"""Bias torque of a rig on a platform that moves, one state at a time: what the plant asks for at every stage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from gimbal_pin.platform import Platform
from gimbal_pin.rig import Rig

NODE = 1e-6
"""Distance from a sample of the platform's motion, in intervals, within which a time is that sample's."""


class Carrier:
    """``C v + G`` with the base moving as prescribed: joint rows of RNEA with no joint acceleration."""

    def __init__(self, rig: Rig, platform: Platform) -> None:
        """Lay the platform's samples, on a uniform grid, out as Pinocchio takes them."""
        self.pin, self.n = rig.floating, rig.n
        self.data = self.pin.createData()
        self.start, self.step = float(platform.t[0]), float(platform.t[1] - platform.t[0])
        self.samples = np.hstack([platform.w, platform.f, platform.dw])
        self.q, self.v, self.a = pin.neutral(self.pin), np.zeros(self.pin.nv), np.zeros(self.pin.nv)

    def bias(self, t: float, x: Sequence[float]) -> list[float]:
        """Torque at time t, s, angles and rates x, rad and rad/s, N m."""
        now = self.at(t)
        self.q[7:], self.v[6:] = x[: self.n], x[self.n :]
        self.v[3:6], self.a[:6] = now[:3], now[3:]
        torque: list[float] = pin.rnea(self.pin, self.data, self.q, self.v, self.a).tolist()
        return torque[6:]

    def at(self, t: float) -> np.ndarray:
        """Rate, specific force and angular acceleration at a time: a sample, or the parabola through three."""
        place = (t - self.start) / self.step
        middle = min(max(round(place), 1), len(self.samples) - 2)
        s = place - middle
        if -NODE < s < NODE:
            row: np.ndarray = self.samples[middle]
            return row
        before, here, after = self.samples[middle - 1 : middle + 2]
        curved: np.ndarray = here + s * ((after - before) / 2 + s * (before - 2 * here + after) / 2)
        return curved
