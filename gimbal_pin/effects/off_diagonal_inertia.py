"""Products of inertia that the model leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.effects.rig_effect import RigEffect, with_added
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import PHI, Rig

PRINCIPAL = Parameter(
    "principal", 0.0, "1", 0.0, 1.0, meaning="1: along the link's principal axes as its URDF has them; 0: the joint's"
)


@dataclass(frozen=True)
class OffDiagonalInertia(RigEffect):
    """``I + R [[0, Ixy, Ixz], [Ixy, 0, Iyz], [Ixz, Iyz, 0]] Rᵀ``: products of inertia beside those of a link, kg m².

    The thesis assumes diagonal inertias; a camera with a matte box on one side has none. R is one, or turns to the
    axes about which the link as it is has no products: to first order only these turn then, and no moment changes
    about any of them. In another frame the same products are moments, too.

    Attributes:
        joint: The joint that moves the link.
        Ixy: In the joint's frame, or along the principal axes that are nearest to its own; like the other two.
        Ixz: See above.
        Iyz: See above.
        principal: True for the principal axes.
    """

    joint: str
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0
    principal: bool = False

    name: ClassVar[str] = "off-diagonal-inertia"
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(symbol, 0.0, "kg m^2", -10.0, 10.0, meaning="product of inertia beside the URDF's")
        for symbol in ("Ixy", "Ixz", "Iyz")
    )
    experiment: ClassVar[str] = "fast motion of all axes at once: products of inertia couple them"
    compensation: ClassVar[str] = "the controller uses the identified model with full inertias"

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """With the axes, which are chosen and not measured."""
        return (*cls.shapes, PRINCIPAL)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Along the one axes or the other."""
        return replace(super().planted(joint, given), principal=bool(given["principal"]))

    @classmethod
    def forms(cls, rig: Rig) -> tuple[Mapping[str, float], ...]:
        """Along the joint's axes, and along the principal ones."""
        return {"principal": False}, {"principal": True}

    def apply(self, rig: Rig) -> Rig:
        """Add them to the link's parameters."""
        body = rig.joint_index(self.joint)
        added = np.array([[0.0, self.Ixy, self.Ixz], [self.Ixy, 0.0, self.Iyz], [self.Ixz, self.Iyz, 0.0]])
        if self.principal:
            axes = principal_axes(rig.model.inertias[body + 1].inertia)
            added = axes @ added @ axes.T
        phi = np.zeros(10)
        for row, first in enumerate("xyz"):
            for column, second in enumerate("xyz"[row:], row):
                phi[PHI.index(f"I{first}{second}")] = added[row, column]
        return with_added(rig, body, phi, self.name)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the products."""
        held = {shape.name: getattr(self, shape.name) for shape in self.shapes}
        parts = ", ".join(f"{name} {value:+.3g}" for name, value in held.items() if value)
        axes = " along its principal axes" if self.principal else ""
        return f"its link has products of inertia that the model leaves out{axes} ({parts or 'none'} kg m^2)"


def principal_axes(inertia: Array) -> Array:
    """Principal axes of a moment of inertia, columns of (3, 3), each in the place of the frame's axis nearest to it."""
    axes = np.linalg.eigh(inertia).eigenvectors
    nearest = axes[:, max(permutations(range(3)), key=lambda order: float(np.abs(axes[range(3), order]).sum()))]
    return np.asarray(nearest * np.where(np.diag(nearest) < 0, -1.0, 1.0))
