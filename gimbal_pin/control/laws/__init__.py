"""Control laws with explicit memory (thesis ch. 5), their sampled loop and its margins."""

from gimbal_pin.control.laws.base import JointPid, Memory, Pid
from gimbal_pin.control.laws.computed_torque import ComputedTorque, Robust
from gimbal_pin.control.laws.loop import Margins, margins, sampled_loop
from gimbal_pin.control.laws.uncertainty import Bounds, bounds

__all__ = [
    "Bounds",
    "ComputedTorque",
    "JointPid",
    "Margins",
    "Memory",
    "Pid",
    "Robust",
    "bounds",
    "margins",
    "sampled_loop",
]
