"""Rotor: a motor's inertia at its joint, a parameter of every model whose rig states a gear or a rotor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class Rotor(Effect):
    """``tau = Ia a``: the rotor's inertia at its joint, in place of the one that the rig states, kg m²."""

    name: ClassVar[str] = "rotor"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("Ia", nan, "kg m^2", 0.0, inf, meaning="the rotor's inertia at its joint"),
    )
    like_inertia: ClassVar[bool] = True
    experiment: ClassVar[str] = "fast accelerations of all axes together, at poses that couple them"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The joint's acceleration."""
        return (at.a,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"the motor's rotor has {values[0]:.3g} kg m^2 at the joint"
