"""Motors that drive two joints, as in a wrist: rotor and friction at the motor, which turns with both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class Coupled(Effect):
    """``tau = gᵀ f(g q, g v, g a)``: a torque f at a motor whose angle is ``g q = q_joint + sum ratio q_other``.

    Its `basis` is evaluated at the motor's own angle, rate, acceleration and direction.

    Attributes:
        others: Joints that turn the motor beside its own.
        ratios: Turns of the motor per turn of each of these, where one turn of its own joint is one.
    """

    others: tuple[str, ...]
    ratios: tuple[float, ...]

    experiment: ClassVar[str] = "fast motion of the coupled joints, with and against each other"

    @property
    def coupling(self) -> Mapping[str, float]:
        """Joint → turns of the motor per turn of it; the entries of g."""
        return {self.joint: 1.0, **dict(zip(self.others, self.ratios))}


@dataclass(frozen=True)
class CoupledRotor(Coupled):
    """``tau = gᵀ Ia g a``: the inertia of a rotor that turns with several joints, kg m²."""

    name: ClassVar[str] = "coupled-rotor"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("Ia", nan, "kg m^2", 0.0, inf, meaning="the rotor's inertia at its joint"),
    )
    like_inertia: ClassVar[bool] = True

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The motor's acceleration."""
        return (at.a,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"the rotor that turns with {', '.join(self.coupling)} has {values[0]:.3g} kg m^2"


@dataclass(frozen=True)
class CoupledFriction(Coupled):
    """``tau = gᵀ (Fsm sign(g v) + Fvm g v)``: friction of a motor that turns with several joints, N m, N m s/rad."""

    name: ClassVar[str] = "coupled-friction"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("Fsm", nan, "N m", 0.0, inf, meaning="dry friction of the motor"),
        Parameter("Fvm", nan, "N m s/rad", 0.0, inf, meaning="viscous friction of the motor"),
    )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The motor's direction and rate."""
        return (at.slide, at.v)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        turns = ", ".join(self.coupling)
        return f"the motor that turns with {turns} has {values[0]:.3g} N m of dry friction"
