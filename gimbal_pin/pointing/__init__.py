"""Holding the camera still while the platform moves.

`Controller` runs in one's own loop: ``torque = controller.step(measurement)``. ``verify(rig, Asked())`` compares all
controllers on a simulated platform.
"""

from gimbal_pin.pointing.controller import Controller
from gimbal_pin.pointing.measurement import Measurement, Station, parse_fault
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.result import Contest, Pointing, Row
from gimbal_pin.pointing.roster import Roster
from gimbal_pin.pointing.run import Course, compete, point
from gimbal_pin.pointing.verify import Asked, Verified, verify

__all__ = [
    "Asked",
    "Contest",
    "Controller",
    "Course",
    "Measurement",
    "Pointer",
    "Pointing",
    "Roster",
    "Row",
    "Station",
    "Verified",
    "compete",
    "parse_fault",
    "point",
    "verify",
]
