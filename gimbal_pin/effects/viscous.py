"""Viscous friction (THESIS 3.61)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Viscous(Effect):
    """``tau = Fv v``: friction in proportion to the rate, N m s/rad."""

    name: ClassVar[str] = "viscous"
    coefficients: ClassVar[tuple[Parameter, ...]] = (Parameter("Fv", 0.0, "N m s/rad", lower=0.0),)

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The joint's rate."""
        return (at.v,)
