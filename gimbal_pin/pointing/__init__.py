"""Holding the camera still while the platform moves (CONTROL): ``verify(rig, Asked())`` runs all of it."""

from gimbal_pin.pointing.contest import Contest, Course, Row, compete
from gimbal_pin.pointing.faults import ClockStep, Dropped, Frozen, Missing, parse_fault
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.roster import Roster
from gimbal_pin.pointing.run import point
from gimbal_pin.pointing.seen import Seen, Station
from gimbal_pin.pointing.verify import Asked, Verified, verify

__all__ = [
    "Asked",
    "ClockStep",
    "Contest",
    "Course",
    "Dropped",
    "Frozen",
    "Missing",
    "Pointer",
    "Pointing",
    "Roster",
    "Row",
    "Seen",
    "Station",
    "Verified",
    "compete",
    "parse_fault",
    "point",
    "verify",
]
