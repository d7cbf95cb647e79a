"""A rotor and a link with something between them: what a gap and a spring have in common."""

from __future__ import annotations

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.signal import Signal

ROTOR_SHARE = Parameter(
    "rotor_share",
    0.0,
    "1",
    0.0,
    0.95,
    meaning="share of the joint's inertia that is the rotor's, where the encoder sits on the motor; 0: "
    "it sits on the link",
)


class Geared(Signal):
    """Rotor and link of one joint, r and 1 - r of its inertia.

    Attributes:
        rotor_share: r; 0 for an encoder on the link.
    """

    rotor_share: float

    @property
    def unseen(self) -> float:
        """The link's share, with the encoder on the rotor."""
        return 1 - self.rotor_share if self.rotor_share > 0 else 0.0
