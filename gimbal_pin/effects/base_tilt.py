"""A base that does not stand upright."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import ClassVar

import pinocchio as pin

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.rig_effect import RigEffect, with_model
from gimbal_pin.effects.seen import Seen
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig

STEP = 1e-3
"""Angle by which a search turns it to see what torque it costs, rad."""


@dataclass(frozen=True)
class BaseTilt(RigEffect):
    """``g_base = Rᵀ g`` with ``R = Ry(pitch) Rx(roll)``: gravity as the tilted base feels it.

    Attributes:
        roll: About the base's x, rad.
        pitch: About the base's y, rad.
    """

    roll: float = 0.0
    pitch: float = 0.0

    name: ClassVar[str] = "base-tilt"
    of_joint: ClassVar[bool] = False
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("roll", 0.0, "rad", -3.2, 3.2),
        Parameter("pitch", 0.0, "rad", -3.2, 3.2),
    )
    experiment: ClassVar[str] = "slow motion of all axes with the base turned by a quarter in between"
    compensation: ClassVar[str] = "level the base, or let the controller use gravity in the base's frame"

    def apply(self, rig: Rig) -> Rig:
        """Turn gravity."""
        turned = pin.rpy.rpyToMatrix(self.roll, self.pitch, 0.0).T @ rig.model.gravity.linear
        changed = with_model(rig)
        changed.model.gravity.linear = turned
        return changed

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """A lean about each of the base's axes."""
        return (cls(roll=STEP), cls(pitch=STEP))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return roll and pitch in degrees."""
        return f"the base leans by {degrees(self.roll):.3g}° about x and {degrees(self.pitch):.3g}° about y"
