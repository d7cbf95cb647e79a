"""A link that a spring holds to its motor: what a fit needs to know of one to work out where the link swings."""

from __future__ import annotations

from dataclasses import dataclass

from gimbal_pin.effects.signal import Signal

SHARE = 0.25
"""The rotor's share of a joint's inertia that is usual."""


@dataclass(frozen=True)
class Sprung(Signal):
    """``k = r (1 - r) M ω²``, ``d = 2 ζ r (1 - r) M ω`` for a joint's inertia M: a spring and its damping.

    Attributes:
        joint: The joint that gives.
        frequency: Resonance ω/2π, Hz.
        damping: ζ.
        rotor_share: r, the rotor's share of M; 0 for an encoder on the link.
    """

    frequency: float
    damping: float = 0.05
    rotor_share: float = 0.0

    @property
    def geared(self) -> bool:
        """With the encoder on the rotor, whose friction the spring is behind."""
        return self.rotor_share > 0

    @property
    def springy(self) -> bool:
        """With the encoder on the rotor it is the link that no encoder sees."""
        return self.geared

    @property
    def unseen(self) -> float:
        """The link's share, with the encoder on the rotor."""
        return 1 - self.rotor_share if self.geared else 0.0
