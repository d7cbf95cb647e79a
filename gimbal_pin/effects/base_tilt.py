"""A base that does not stand upright."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import ClassVar

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.rig_effect import RigEffect, copy_model
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.rig import Rig

TILT_STEP = 1e-3
"""Angle by which a search turns it to see what torque it costs, rad, or rate, rad/s."""
LASTS = 60.0
"""Time over which a base that sinks is taken to have turned, s, where nobody knows how long a log is."""


@dataclass(frozen=True)
class BaseTilt(RigEffect):
    """``g_base = Rᵀ g`` with ``R = Ry(pitch) Rx(roll)``: gravity as the tilted base feels it.

    A base that sinks turns on: what it stands on has ``R = Ry(pitch_rate t) Rx(roll_rate t)``.

    Attributes:
        roll: About the base's x, rad.
        pitch: About the base's y, rad.
        roll_rate: How fast it sinks about x, rad/s.
        pitch_rate: How fast it sinks about y, rad/s.
    """

    roll: float = 0.0
    pitch: float = 0.0
    roll_rate: float = 0.0
    pitch_rate: float = 0.0

    name: ClassVar[str] = "base-tilt"
    of_joint: ClassVar[bool] = False
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("roll", 0.0, "rad", -3.2, 3.2, meaning="how far the base leans about its x"),
        Parameter("pitch", 0.0, "rad", -3.2, 3.2, meaning="how far it leans about its y"),
        Parameter("roll_rate", 0.0, "rad/s", -0.1, 0.1, meaning="how fast it sinks about its x"),
        Parameter("pitch_rate", 0.0, "rad/s", -0.1, 0.1, meaning="how fast it sinks about its y"),
    )
    experiment: ClassVar[str] = (
        "slow motion of all axes with the base turned by a quarter in between"
    )
    compensation: ClassVar[str] = (
        "level the base, or let the controller use gravity in the base's frame"
    )

    def apply(self, rig: Rig) -> Rig:
        """Turn gravity."""
        turned = pin.rpy.rpyToMatrix(self.roll, self.pitch, 0.0).T @ rig.model.gravity.linear
        changed = copy_model(rig)
        changed.model.gravity.linear = turned
        return changed

    def carried(self, t: Array, platform: Platform | None) -> Platform | None:
        """Turn what the base stands on, evenly."""
        if not (self.roll_rate or self.pitch_rate):
            return platform
        rates = np.tile([self.roll_rate, self.pitch_rate, 0.0], (len(t), 1))
        return (Platform.still(t) if platform is None else platform).turned(
            rates * t[:, None], rates
        )

    @property
    def angle(self) -> float:
        """The largest angle, after `LASTS` of sinking."""
        return max(
            abs(x) for x in (self.roll, self.pitch, LASTS * self.roll_rate, LASTS * self.pitch_rate)
        )

    @classmethod
    def forms(cls, rig: Rig) -> tuple[Mapping[str, float], ...]:
        """In the bodies a base leans and does not sink: they are told by a fit over all of the time."""
        return ({"roll": 0.0, "pitch": 0.0},)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """A lean about each of the base's axes, and a base that sinks about them."""
        return (
            cls(roll=TILT_STEP),
            cls(pitch=TILT_STEP),
            cls(roll_rate=TILT_STEP),
            cls(pitch_rate=TILT_STEP),
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return roll and pitch in degrees, and how they grow."""
        leans = f"the base leans by {degrees(self.roll):.3g}° about x and {degrees(self.pitch):.3g}° about y"
        if not (self.roll_rate or self.pitch_rate):
            return leans
        x = degrees(60 * self.roll_rate)
        y = degrees(60 * self.pitch_rate)
        sinks = f"by {x:.3g}° about x and {y:.3g}° about y a minute"
        return (
            f"{leans}, and sinks {sinks}" if self.roll or self.pitch else f"the base sinks {sinks}"
        )
