"""PID per joint: what a rig does without a model; the yardstick for the laws that have one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gimbal_pin.control.laws.base import Memory, Outer, Pid
from gimbal_pin.dynamics.simulation import Reference
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class JointPid:
    """``tau_j = I_j (kp e + ki ∫e + kd ė)``: joints apart, gravity and friction not compensated.

    The derivative is the reference's rate less the measured rate: nothing is differenced.

    Attributes:
        gains: Outer loop, one per joint.
        inertia: Nominal inertia seen by each motor, kg m².
        limits: Torque limits, N m; a joint at its limit integrates no further into it.
        dt: Sampling interval, s.
        braking: Deceleration that each motor surely has, rad/s² (see `Outer`); empty: not looked at.
    """

    gains: tuple[Pid, ...]
    inertia: tuple[float, ...]
    limits: tuple[float, ...]
    dt: float
    braking: tuple[float, ...] = ()

    @cached_property
    def outer(self) -> Outer:
        """The outer loop with its limits."""
        return Outer(self.gains, self.limits, self.braking)

    def start(self) -> Memory:
        """Memory before the first sample: no integral."""
        return Memory((0.0,) * len(self.gains))

    def torque(self, t: float, q: Array, v: Array, reference: Reference, memory: Memory) -> tuple[Array, Memory]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
        error, rate = (reference.q - q).tolist(), (reference.v - v).tolist()
        integral = [s + self.dt * e for s, e in zip(memory.integral, error)]
        wanted = [inertia * y for inertia, y in zip(self.inertia, self.outer.feedback(error, integral, rate))]
        kept = self.outer.integrated(memory.integral, integral, error, wanted)
        return np.array(self.outer.clipped(wanted)), Memory(kept)
