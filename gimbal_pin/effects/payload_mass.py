"""A payload heavier or lighter than its URDF says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

import numpy as np
import pinocchio as pin

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.rig_effect import (
    RigEffect,
    build_place_parameters,
    compute_gyration_radius,
    get_payload,
    replace_payload,
)
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.rig.rig import Rig

TETRAHEDRON = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
"""Of a tetrahedron about the payload: from one of them a fit gets to a weight anywhere."""
WEIGHTLESS_RADII = 0.3
"""Radii of gyration within which a weight is none: there its inertia about the payload's centre is under a tenth of
what the same mass has that is spread over the payload, so that it is a heavier payload that was moved."""


@dataclass(frozen=True)
class PayloadMass(RigEffect):
    """The payload's mass, first moments and inertia times ``1 + extra/mass``: another density, the same shape.

    With a place it is a weight, small beside the payload, that is bolted on there.

    Attributes:
        extra: Mass on top of the stated one, kg.
        x: Place of the weight from the payload's centre of mass, along the axes of its frame, m.
        y: See above.
        z: See above; all zero: the extra mass is spread like the payload's own.
    """

    extra: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name: ClassVar[str] = "payload-mass"
    of_joint: ClassVar[bool] = False
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("extra", nan, "kg", -100.0, 100.0, meaning="mass on top of the stated one"),
        *build_place_parameters(
            "place of the weight from the payload's centre of mass; all zero: spread like the payload's own"
        ),
    )
    experiment: ClassVar[str] = "fast motion of all axes at once"
    compensation: ClassVar[str] = (
        "state the payload as weighed, or let the controller use the identified model"
    )

    def apply(self, rig: Rig) -> Rig:
        """Scale the payload's part of its body, or add the weight to it."""
        _, inertia, frame = get_payload(rig)
        place = np.array([self.x, self.y, self.z])
        added = inertia.toDynamicParameters() / inertia.mass
        if place.any():
            added = pin.Inertia(
                1.0, inertia.lever + frame.rotation @ place, np.zeros((3, 3))
            ).toDynamicParameters()
        total = inertia.toDynamicParameters() + self.extra * added
        return replace_payload(rig, pin.Inertia.FromDynamicParameters(total), self.name)

    @classmethod
    def forms(cls, rig: Rig) -> tuple[Mapping[str, float], ...]:
        """Spread over the payload, or bolted on, wherever that may be, or gone from there."""
        try:
            corners = (
                compute_gyration_radius(get_payload(rig)[1]) / np.sqrt(3.0) * np.array(TETRAHEDRON)
            )
        except UsageError:
            return ()
        return (
            {"extra": 0.0},
            *({"extra": 0.0, **dict(zip("xyz", corner))} for corner in corners.tolist()),
        )

    def plausible(self, rig: Rig) -> bool:
        """Whether a weight is bolted on, and not inside the payload."""
        place = float(np.linalg.norm([self.x, self.y, self.z]))
        return place == 0 or place > WEIGHTLESS_RADII * compute_gyration_radius(get_payload(rig)[1])

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the difference in grams."""
        weight = f"{digits(abs(1e3 * self.extra), 4)} g"
        place = float(np.linalg.norm([self.x, self.y, self.z]))
        if place:
            return f"a weight of some {weight} sits on the payload, {digits(1e3 * place, 2)} mm from its centre of mass"
        return f"the payload is {weight} {'heavier' if self.extra >= 0 else 'lighter'} than stated"
