"""Products of inertia that the model leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.rig_effect import RigEffect, with_added
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import PHI, Rig


@dataclass(frozen=True)
class OffDiagonalInertia(RigEffect):
    """Products of inertia added to the link that a joint moves, about the joint frame's origin, kg m².

    The thesis assumes diagonal inertias; a camera with a matte box on one side has none.

    Attributes:
        joint: The joint that moves the link.
        Ixy: In the joint's frame, like the other two.
        Ixz: See above.
        Iyz: See above.
    """

    joint: str
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0

    name: ClassVar[str] = "off-diagonal-inertia"
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(
            symbol, 0.0, "kg m^2", -10.0, 10.0, meaning="product of inertia beside the URDF's, in the joint's frame"
        )
        for symbol in ("Ixy", "Ixz", "Iyz")
    )
    experiment: ClassVar[str] = "fast motion of all axes at once: products of inertia couple them"
    compensation: ClassVar[str] = "the controller uses the identified model with full inertias"

    def apply(self, rig: Rig) -> Rig:
        """Add them to the link's parameters."""
        phi = np.zeros(10)
        for shape in self.shapes:
            phi[PHI.index(shape.name)] = getattr(self, shape.name)
        return with_added(rig, rig.joint_index(self.joint), phi, self.name)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the products."""
        held = {shape.name: getattr(self, shape.name) for shape in self.shapes}
        parts = ", ".join(f"{name} {value:+.3g}" for name, value in held.items() if value)
        return f"its link has products of inertia that the model leaves out ({parts or 'none'} kg m^2)"
