"""Stribeck friction: a dry joint holds more than it drags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import exp
from gimbal_pin.effects.seen import Seen, ladder
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Stribeck(Effect):
    """``tau = extra exp(-(v/speed)²) slide``: dry friction on top of Coulomb's, lost as the joint gets moving.

    Bo and Pavelescu 1982, with exponent 2.

    Attributes:
        joint: The joint it acts on.
        speed: Rate at which it has fallen to 1/e, rad/s.
    """

    speed: float

    name: ClassVar[str] = "stribeck"
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("speed", nan, "rad/s", 0.001, 10.0),)
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("extra", nan, "N m", 0.0, inf),)
    dry: ClassVar[bool] = True
    experiment: ClassVar[str] = "a staircase of slow constant speeds, both ways, down to a tenth of the Stribeck speed"
    lookalikes: ClassVar[tuple[str, ...]] = ("presliding", "actuator-lag", "delay")
    compensation: ClassVar[str] = "friction feed-forward at the reference's rate, with the extra hold near standstill"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """What is left of it at this rate."""
        w = at.v / self.speed
        return (exp(-w * w) * at.slide,)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Speeds from what the rate's noise hides to half of the fastest."""
        return tuple(cls(joint, speed) for speed in ladder(max(3 * seen.rate_std, 0.01 * seen.rate), seen.rate / 2, 6))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size and speed."""
        return f"it takes {values[0]:.3g} N m more to break away than to keep moving, gone above {self.speed:.3g} rad/s"
