"""What a platform's motion asks of the motors: where no controller holds the camera, however much it knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log import Array
from gimbal_pin.model import Model
from gimbal_pin.platform import Platform
from gimbal_pin.pointing.contest import Contest
from gimbal_pin.pointing.measures import split
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.pointing.trust import holding

BEFORE, AFTER = 0.1, 0.6
"""Around a moment at which a motor is too weak, what is not counted either, s: the loop has to find back."""
RATE = 250.0
"""Samples of a motion that are looked at, Hz."""


@dataclass(frozen=True, eq=False)
class Demand:
    """Torque that holds the camera exactly along a motion, beside what the motors give.

    Attributes:
        joints: Joint names.
        t: Time, s, (N,).
        tau: Torque, N m, (N, n).
        tau_max: Largest torque of each motor, N m, (n,).
    """

    joints: tuple[str, ...]
    t: Array
    tau: Array
    tau_max: Array

    @staticmethod
    def of(plant: Model, wanted: Array, platform: Platform) -> Demand:
        """Return it for a plant whose camera looks as wanted, (3, 3): inverse dynamics of the exact motion."""
        step = max(1, round(1 / RATE / float(platform.t[1] - platform.t[0])))
        part, rig = platform.part(slice(None, None, step)), plant.rig
        held = holding(Sight(rig), wanted, part)
        return Demand(rig.joints, part.t, plant.inverse(held.q, held.v, held.a, platform=part), rig.tau_max)

    @property
    def peak(self) -> Mapping[str, float]:
        """Joint → largest torque, N m."""
        return dict(zip(self.joints, np.abs(self.tau).max(axis=0).tolist()))

    @property
    def weak(self) -> tuple[str, ...]:
        """Joints whose motors give less than that."""
        limits = zip(self.peak.items(), self.tau_max.tolist())
        return tuple(joint for (joint, peak), limit in limits if peak > limit)

    @property
    def moments(self) -> tuple[tuple[float, float], ...]:
        """First and last time of every moment at which a motor is too weak, s; those `AFTER` s apart are one."""
        times = self.t[(np.abs(self.tau) > self.tau_max).any(axis=1)]
        parts = np.split(times, np.flatnonzero(np.diff(times) > AFTER) + 1) if len(times) else []
        return tuple((float(part[0]), float(part[-1])) for part in parts)

    def within(self, t: Array) -> NDArray[np.bool_]:
        """Whether the motors are strong enough at each of the times t, s, and were so just before."""
        fine = np.ones(len(t), dtype=bool)
        for first, last in self.moments:
            fine &= (t < first - BEFORE) | (t > last + AFTER)
        return fine

    def jitter(self, run: Pointing) -> float:
        """Jitter of a run where the motors are strong enough, rad rms; nan where they never are."""
        fast, _ = split(run.sight, run.dt)
        power = np.sum(fast**2, axis=1)[self.within(run.t[run.counted])]
        return float(np.sqrt(power.mean())) if len(power) else float("nan")

    def apart(self, contest: Contest) -> Mapping[str, float]:
        """Controller → its jitter where the motors are strong enough, over all its runs, rad rms."""
        return {
            row.controller: float(np.sqrt(np.mean([self.jitter(run) ** 2 for run in row.runs]))) for row in contest.rows
        }

    def to_dict(self, contest: Contest) -> dict[str, Any]:
        """Return what JSON holds; null for the jitter of a run in which the motors never suffice."""
        still = self.apart(contest)
        return {
            "peak": dict(self.peak),
            "tau_max": dict(zip(self.joints, self.tau_max.tolist())),
            "beyond": [list(moment) for moment in self.moments],
            "jitter_rms_deg_within": {name: None if isnan(x) else degrees(x) for name, x in still.items()},
        }
