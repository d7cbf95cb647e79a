"""Causes: one small class in one file each, exported here."""

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.coulomb import Coulomb
from gimbal_pin.effects.viscous import Viscous

__all__ = ["Coulomb", "Effect", "Sample", "Term", "Viscous"]
