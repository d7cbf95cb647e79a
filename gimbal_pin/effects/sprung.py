"""A link that a spring holds to its motor: what a fit needs to know of one to work out where the link swings."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from gimbal_pin.effects.geared import Geared
from gimbal_pin.log.log import Array

SHARE = 0.25
"""The rotor's share of a joint's inertia that is usual."""


@dataclass(frozen=True)
class Sprung(Geared):
    """``k = r (1 - r) M ω²``, ``d = 2 ζ r (1 - r) M ω`` for a joint's inertia M: a spring and its damping.

    Bent by x it holds ``z (1 + h z²)`` with ``z = k x``: strain wave gears stiffen so, and their makers tell how by
    torques.

    Attributes:
        joint: The joint that gives.
        frequency: Resonance ω/2π, Hz.
        damping: ζ.
        rotor_share: r, the rotor's share of M; 0 for an encoder on the link.
        hardening: h, 1/(N m)²; 0 for a spring that is linear.
    """

    frequency: float
    damping: float = 0.05
    rotor_share: float = 0.0
    hardening: float = 0.0

    @property
    def geared(self) -> bool:
        """With the encoder on the rotor, whose friction the spring is behind."""
        return self.rotor_share > 0

    @property
    def springy(self) -> bool:
        """With the encoder on the rotor it is the link that no encoder sees."""
        return self.geared

    def stiffness(self, inertia: float) -> float:
        """k, N m/rad, of the soft part, at a joint's inertia M, kg m²."""
        return self.rotor_share * (1 - self.rotor_share) * inertia * (2 * np.pi * self.frequency) ** 2

    def grown(self, z: Array) -> Array:
        """``h z²``: share of its soft part z, N m, that the spring holds beyond it."""
        return self.hardening * z**2

    def slope(self, z: Array) -> Array:
        """``1 + 3 h z²``: its stiffness, in units of k."""
        return 1 + 3 * self.grown(z)

    def soft(self, torque: Array) -> Array:
        """``z: z (1 + h z²) = torque``: the soft part of what it holds, N m, by Cardano."""
        if not self.hardening:
            return torque
        size = 2 / np.sqrt(3 * self.hardening)
        return np.asarray(size * np.sinh(np.arcsinh(3 * torque / size) / 3))

    @property
    @abstractmethod
    def held(self) -> Sprung:
        """The link alone on its spring, the rotor held."""
