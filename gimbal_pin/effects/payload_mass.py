"""A payload heavier or lighter than its URDF says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

from gimbal_pin.effects.rig_effect import RigEffect, payload, with_added
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig


@dataclass(frozen=True)
class PayloadMass(RigEffect):
    """The payload's mass, first moments and inertia times ``1 + extra/mass``: another density, the same shape.

    Attributes:
        extra: Mass on top of the stated one, kg.
    """

    extra: float

    name: ClassVar[str] = "payload-mass"
    of_joint: ClassVar[bool] = False
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("extra", nan, "kg", -100.0, 100.0),)
    experiment: ClassVar[str] = "fast motion of all axes at once"
    lookalikes: ClassVar[tuple[str, ...]] = ("torque-gain", "payload-shift", "armature")
    compensation: ClassVar[str] = "state the payload as weighed, or let the controller use the identified model"

    def apply(self, rig: Rig) -> Rig:
        """Scale the payload's part of its body."""
        body, inertia, _ = payload(rig)
        return with_added(rig, body, inertia.toDynamicParameters() * (self.extra / inertia.mass), self.name)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the difference in grams."""
        return f"the payload is {abs(1e3 * self.extra):.4g} g {'heavier' if self.extra >= 0 else 'lighter'} than stated"
