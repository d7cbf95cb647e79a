"""Armature: a rotor's inertia that turns with its joint alone, seen through a gear or in another link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True)
class Armature(Effect):
    """``tau = inertia a``: inertia felt by its own motor and by no other, beside the rotor that the rig states."""

    name: ClassVar[str] = "armature"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "inertia", nan, "kg m^2", 0.0, inf, meaning="rotor's inertia, felt at its joint alone"
        ),
    )
    like_inertia: ClassVar[bool] = True
    experiment: ClassVar[str] = "fast accelerations of all axes together, at poses that couple them"

    @classmethod
    def is_stated(cls, joint: str, rig: Rig) -> bool:
        """Whether the rig states a rotor with inertia at a joint."""
        return bool(rig.motors[rig.joint_index(joint)].armature)

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The joint's acceleration."""
        return (at.a,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"the motor's rotor has {values[0]:.3g} kg m^2 of its own, which the other axes do not feel"
