"""Friction that differs by direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.functions import size
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """``tau = coulomb |slide| + viscous |v|``: half of what the positive direction takes more than the negative one."""

    name: ClassVar[str] = "asymmetric-friction"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "coulomb",
            0.0,
            "N m",
            -inf,
            inf,
            meaning="half of what dry friction differs by between the directions, positive where the positive "
            "one brakes more",
        ),
        Parameter("viscous", 0.0, "N m s/rad", -inf, inf, meaning="the same of the friction that grows with the rate"),
    )
    dry: ClassVar[bool] = True
    experiment: ClassVar[str] = "the same constant speeds both ways, and holds at rest in between"
    compensation: ClassVar[str] = "friction feed-forward with its own figures for each direction"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Sliding and rate without their signs."""
        return size(at.slide), size(at.v)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the difference between the directions."""
        dry, viscous = 2 * values[0], 2 * values[1]
        way = "positive" if dry >= 0 else "negative"
        return f"friction is {abs(dry):.3g} N m ({viscous:+.3g} N m per rad/s) higher turning in the {way} direction"
