"""Products of inertia that the model leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.rig_effect import RigEffect, add_to_body, get_payload
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import PHI, Rig

LINK = ("Ixy", "Ixz", "Iyz")
"""Products of the link itself."""
PAYLOAD = ("payload_Ixy", "payload_Ixz", "payload_Iyz")
"""Products of the payload that it carries."""


@dataclass(frozen=True)
class OffDiagonalInertia(RigEffect):
    """``I + P + R P' Rᵀ``, ``P = [[0, Ixy, Ixz], [Ixy, 0, Iyz], [Ixz, Iyz, 0]]``: products beside those of a link.

    The thesis assumes diagonal inertias; a camera with a matte box on one side has none. A URDF states each link's in
    its own frame: P is the moving link's, in the joint's frame, P' that of the payload it carries, in the frame R in
    which that is mounted. Seen from the joint a turned payload's products are moments, too.

    Attributes:
        joint: The joint that moves the link.
        Ixy: Of the link, kg m².
        Ixz: See above.
        Iyz: See above.
        payload_Ixy: Of the payload, kg m²; none at a joint that carries none.
        payload_Ixz: See above.
        payload_Iyz: See above.
    """

    joint: str
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0
    payload_Ixy: float = 0.0
    payload_Ixz: float = 0.0
    payload_Iyz: float = 0.0

    name: ClassVar[str] = "off-diagonal-inertia"
    of_given_model: ClassVar[bool] = True
    shapes: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(
            symbol,
            0.0,
            "kg m^2",
            -10.0,
            10.0,
            meaning=f"product of inertia beside the URDF's, of {whose}",
        )
        for symbols, whose in (
            (LINK, "the link, in the joint's frame"),
            (PAYLOAD, "the payload, in its own frame"),
        )
        for symbol in symbols
    )
    experiment: ClassVar[str] = "fast motion of all axes at once: products of inertia couple them"
    compensation: ClassVar[str] = "the controller uses the identified model with full inertias"

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """Those of the payload only where it has any: most joints carry none."""
        every = super().shown(values, covariance)
        return every if any(getattr(self, name) for name in PAYLOAD) else every[: len(LINK)]

    @classmethod
    def forms(cls, rig: Rig) -> tuple[Mapping[str, float], ...]:
        """Of the link, of its payload, or of both."""
        return (
            dict.fromkeys(LINK, 0.0),
            dict.fromkeys(PAYLOAD, 0.0),
            dict.fromkeys((*LINK, *PAYLOAD), 0.0),
        )

    def apply(self, rig: Rig) -> Rig:
        """Add them to the link's parameters.

        Raises:
            UsageError: The joint carries no payload, or no body can have such products.
        """
        body = rig.joint_index(self.joint)
        added = _build_symmetric(self.Ixy, self.Ixz, self.Iyz)
        if self.payload_Ixy or self.payload_Ixz or self.payload_Iyz:
            carrier, _, frame = get_payload(rig)
            if carrier != body:
                what = f"{self.joint} does not carry the payload, {rig.joints[carrier]} does"
                raise UsageError(self.name, what, f"give {', '.join(LINK)}")
            turned = _build_symmetric(self.payload_Ixy, self.payload_Ixz, self.payload_Iyz)
            added = added + frame.rotation @ turned @ frame.rotation.T
        phi = np.zeros(10)
        for row, first in enumerate("xyz"):
            for column, second in enumerate("xyz"[row:], row):
                phi[PHI.index(f"I{first}{second}")] = added[row, column]
        return add_to_body(rig, body, phi, self.name)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the products."""
        parts = [
            f"{name} {getattr(self, name):+.3g}"
            for name in (*LINK, *PAYLOAD)
            if getattr(self, name)
        ]
        whose = (
            "its link has"
            if any(getattr(self, name) for name in LINK) or not parts
            else "the payload has"
        )
        return f"{whose} products of inertia that the model leaves out ({', '.join(parts) or 'none'} kg m^2)"


def _build_symmetric(xy: float, xz: float, yz: float) -> Array:
    """A matrix of products of inertia, (3, 3)."""
    return np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
