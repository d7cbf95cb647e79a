"""Viscous friction (thesis 3.61)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class Viscous(Effect):
    """``tau = Fv v``: friction in proportion to the rate, N m s/rad."""

    name: ClassVar[str] = "viscous"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("Fv", 0.0, "N m s/rad", 0.0, inf),)
    affine: ClassVar[bool] = True
    experiment: ClassVar[str] = "constant speeds, slow and fast"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The joint's rate."""
        return (at.v,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"{values[0]:.3g} N m of friction per rad/s"
