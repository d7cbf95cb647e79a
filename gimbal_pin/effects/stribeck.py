"""Stribeck friction: a dry joint holds more than it drags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import exp, size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.log.log import Array

STROKE = 1e-4
"""Shortest stroke of bristles that is looked for as presliding, rad."""


@dataclass(frozen=True)
class Stribeck(Effect):
    """``tau = extra exp(-|v/speed|^exponent) slide``: dry friction on top of Coulomb's, lost as the joint gets moving.

    Bo and Pavelescu 1982. An exponent of 1 (Tustin 1947) falls at once and has a long tail, one of 2 keeps its top.

    Attributes:
        joint: The joint it acts on.
        speed: Rate at which it has fallen to 1/e, rad/s.
        exponent: 1 or 2.
    """

    speed: float
    exponent: int = 2

    name: ClassVar[str] = "stribeck"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "speed",
            nan,
            "rad/s",
            0.001,
            10.0,
            meaning="rate at which the extra friction has fallen to 37 %",
        ),
    )
    chosen: ClassVar[tuple[str, ...]] = ("exponent",)
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "extra",
            nan,
            "N m",
            0.0,
            inf,
            meaning="friction at standstill beyond that while sliding",
        ),
    )
    dry: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "a staircase of slow constant speeds, both ways, down to a tenth of the Stribeck speed"
    )
    compensation: ClassVar[str] = (
        "friction feed-forward at the reference's rate, with the extra hold near standstill"
    )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """What is left of it at this rate."""
        w = size(at.v / self.speed)
        return (exp(-(w**self.exponent)) * at.slide,)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Speeds from what the rate's noise hides to half of the fastest."""
        slowest = max(3 * seen.rate_std, 0.01 * seen.rate)
        speeds = build_geometric_grid(slowest, seen.rate / 2, 6, cls.shapes[0])
        return tuple(cls.inside(joint, speed, exponent) for speed in speeds for exponent in (2, 1))

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """A joint that swings by ``travel/2`` passes such speeds within ``speed²/(2a)``, ``a = 2 rate²/travel``.

        Where that is less than any bristle's stroke, the log shows friction at reversals, and not what it depends on.
        """
        path = seen.travel * (self.speed / max(seen.rate, 1e-300)) ** 2 / 4
        return ("presliding",) if path < STROKE else ()

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size and speed."""
        return f"it takes {values[0]:.3g} N m more to break away than to keep moving, gone above {self.speed:.3g} rad/s"
