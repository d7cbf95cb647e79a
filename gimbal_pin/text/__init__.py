"""Results as a person reads them in a terminal: tables with units, angles in degrees where that is said."""

from gimbal_pin.text.camera import verified
from gimbal_pin.text.everything import auto
from gimbal_pin.text.loops import tracking, tuning
from gimbal_pin.text.motion import excitation
from gimbal_pin.text.online import following
from gimbal_pin.text.parameters import identified, several
from gimbal_pin.text.rig import base, check, rigs
from gimbal_pin.text.wrong import diagnosis

__all__ = [
    "auto",
    "base",
    "check",
    "diagnosis",
    "excitation",
    "following",
    "identified",
    "rigs",
    "several",
    "tracking",
    "tuning",
    "verified",
]
