"""Two masses at one joint, rotor and link: the rotor's share of the inertia, which springs and gaps read."""

from __future__ import annotations

from gimbal_pin.effects.functions import FloatOrArray
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.signal import JointLoad, Signal

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

    def beside(self, borne: JointLoad) -> FloatOrArray:
        """``r/(1 - r) load - brake``: with it in x, ``x/J`` is the rotor's acceleration less the link's.

        Nothing with the encoder on the link: the friction that a log shows by its rate's sign is then the link's.
        """
        return (
            self.rotor_share / (1 - self.rotor_share) * borne.load - borne.brake
            if self.rotor_share
            else 0.0
        )
