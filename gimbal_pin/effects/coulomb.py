"""Coulomb friction (thesis 3.61)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class Coulomb(Effect):
    """``tau = Fs slide``: dry friction of constant size, N m, against the direction of sliding."""

    name: ClassVar[str] = "coulomb"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("Fs", 0.0, "N m", 0.0, inf),)
    dry: ClassVar[bool] = True
    affine: ClassVar[bool] = True
    experiment: ClassVar[str] = "reversals at moderate speed"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The direction of sliding."""
        return (at.slide,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"{values[0]:.3g} N m of dry friction"
