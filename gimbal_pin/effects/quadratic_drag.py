"""Drag that grows faster than the rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.functions import size
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """``tau = drag v |v|``: air, fans, grease at speed."""

    name: ClassVar[str] = "quadratic-drag"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("drag", nan, "N m s^2/rad^2", 0.0, inf),)
    experiment: ClassVar[str] = "the highest speeds that the rig allows, next to slow ones"
    lookalikes: ClassVar[tuple[str, ...]] = ("friction-drift", "asymmetric-friction")
    compensation: ClassVar[str] = "drag feed-forward at the reference's rate"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The rate's square with the rate's sign."""
        return (at.v * size(at.v),)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"friction grows faster than speed, by {values[0]:.3g} N m at 1 rad/s and four times that at 2 rad/s"
