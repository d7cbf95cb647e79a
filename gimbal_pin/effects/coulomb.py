"""Coulomb friction (THESIS 3.61)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Coulomb(Effect):
    """``tau = Fs slide``: dry friction of constant size, N m, against the direction of sliding."""

    name: ClassVar[str] = "coulomb"
    coefficients: ClassVar[tuple[Parameter, ...]] = (Parameter("Fs", 0.0, "N m", lower=0.0),)
    dry: ClassVar[bool] = True

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The direction of sliding."""
        return (at.slide,)
