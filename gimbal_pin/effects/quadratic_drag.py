"""Drag that grows faster than the rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """``tau = drag |v|^power sign v``: air and fans (2), churned oil (less), what gives way at speed (more).

    Attributes:
        joint: The joint it acts on.
        power: Of the rate; more than one, which viscous friction has.
    """

    power: float = 2.0

    name: ClassVar[str] = "quadratic-drag"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("power", 2.0, "1", 1.2, 4.5, meaning="power of the rate with which it grows"),
    )
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("drag", nan, "N m (s/rad)^power", 0.0, inf, meaning="torque at 1 rad/s"),
    )
    rising: ClassVar[bool] = True
    experiment: ClassVar[str] = "the highest speeds that the rig allows, next to slow ones"
    compensation: ClassVar[str] = "drag feed-forward at the reference's rate"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The rate to its power with the rate's sign."""
        return (at.v * size(at.v) ** (self.power - 1.0),)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Powers that a search finds the best one from."""
        return tuple(cls.inside(joint, power) for power in (2.0, 1.5, 3.0))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        more = 2.0**self.power
        return (
            f"friction grows faster than speed, by {values[0]:.3g} N m at 1 rad/s and "
            f"{more:.3g} times that at 2 rad/s"
        )
