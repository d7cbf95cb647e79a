"""Control laws with explicit memory (thesis ch. 5), their sampled loop and its margins."""

from gimbal_pin.control.laws.base import JointPid, LawMemory, Pid
from gimbal_pin.control.laws.computed_torque import ComputedTorque, Robust
from gimbal_pin.control.laws.loop import Margins, compute_margins, sampled_loop
from gimbal_pin.control.laws.uncertainty import ModelErrorBounds, bounds

__all__ = [
    "ComputedTorque",
    "JointPid",
    "LawMemory",
    "Margins",
    "ModelErrorBounds",
    "Pid",
    "Robust",
    "bounds",
    "compute_margins",
    "sampled_loop",
]
