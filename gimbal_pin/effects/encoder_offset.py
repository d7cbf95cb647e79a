"""An encoder that reads zero elsewhere than the URDF does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.rig_effect import RigEffect, copy_model
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.rig.rig import Rig

OFFSET_STEP = 1e-3
"""Angle by which a search turns it to see what torque it costs, rad."""


@dataclass(frozen=True)
class EncoderOffset(RigEffect):
    """``q_read = q_urdf + offset``: the joint's frame is turned back, so that the rig's angle is the one that is read.

    Attributes:
        joint: The joint whose encoder it is.
        offset: What it reads at the URDF's zero, rad.
    """

    joint: str
    offset: float

    name: ClassVar[str] = "encoder-offset"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "offset",
            nan,
            "rad",
            -3.2,
            3.2,
            meaning="what the encoder reads where the URDF has zero",
        ),
    )
    experiment: ClassVar[str] = "slow motion of all axes with the base held in several attitudes"
    compensation: ClassVar[str] = "correct the encoder's zero by as much"

    def apply(self, rig: Rig) -> Rig:
        """Turn the joint's placement about the joint's axis."""
        j = rig.joint_index(self.joint)
        q = np.zeros(rig.n)
        data = rig.model.createData()
        q[j] = -self.offset
        pin.forwardKinematics(rig.model, data, q)
        changed = copy_model(rig)
        changed.model.jointPlacements[j + 1] = data.liMi[j + 1]
        return changed

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """A small offset."""
        return (cls(joint, OFFSET_STEP),)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the offset."""
        return f"the encoder reads {self.offset:+.3g} rad where the joint is at zero"
