"""A disturbance observer on the linearised joints, and the loop it makes, broken at the plant's input."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import exp, pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.loop import Margins, assessed, driven, frequencies, sampled_plant
from gimbal_pin.effects import Signal

if TYPE_CHECKING:
    import control


class Observed(NamedTuple):
    """What one joint's observer remembers.

    Attributes:
        rate: Estimated ė, rad/s.
        disturbance: Estimated acceleration that the model did not foresee, rad/s².
        commanded: Feedback of the last samples that has not acted yet, oldest first, rad/s².
    """

    rate: float
    disturbance: float
    commanded: tuple[float, ...]


@dataclass(frozen=True)
class Observer:
    """``ė⁺ = ė - dt (u + d)``, d constant: one joint's Luenberger observer, both poles at ``exp(-2π hz dt)``.

    What is linearised leaves ``q̈ = q̈_d + u + d``: whatever makes the camera turn against the commands is d.

    Attributes:
        hz: Its bandwidth, Hz.
        dt: Sampling interval, s.
        delay: Samples from the measurement to the torque.
    """

    hz: float
    dt: float
    delay: int = 1

    @cached_property
    def gains(self) -> tuple[float, float]:
        """Of the rate (1) and of the disturbance (1/s)."""
        away = 1 - exp(-2 * pi * self.hz * self.dt)
        return 2 * away, away**2 / self.dt

    def start(self) -> Observed:
        """Memory before the first sample."""
        return Observed(0.0, 0.0, (0.0,) * self.delay)

    def step(self, memory: Observed, rate: float, feedback: float, free: bool) -> Observed:
        """Return the memory after a sample.

        Args:
            memory: The memory before it.
            rate: Measured ė, rad/s.
            feedback: Commanded u, rad/s².
            free: Whether the torque was not cut; else the disturbance stands, as conditional integration does.
        """
        queue = (*memory.commanded, feedback)
        own, out = self.gains
        gap, d = rate - memory.rate, memory.disturbance
        return Observed(memory.rate - self.dt * (queue[0] + d) + own * gap, d - out * gap if free else d, queue[1:])


def observed_loop(
    gains: Pid, observer: Observer, delay: float, drive: tuple[Signal, ...] = (), gain: float = 1.0
) -> control.StateSpace:
    """Loop gain of an outer loop with the observer, broken at the plant's input, in discrete state space.

    Broken anywhere else, the observer would still see its own command act, and look harmless. Its queue holds what it
    commanded; the plant gets what comes in at the break.

    Args:
        gains: Outer loop.
        observer: The observer.
        delay: Time from measurement to torque, s; the hold comes on top.
        drive: What stands between the command and the torque that acts.
        gain: Nominal over true inertia.
    """
    import control

    dt, m = observer.dt, observer.delay
    plant, B = driven(sampled_plant(dt, delay), drive, dt)
    n, (own, out) = len(plant), observer.gains
    s, rate, lost, queue = n, n + 1, n + 2, n + 3
    size = n + 3 + m
    command = np.zeros(size)  # u = K ξ - d, of angle and rate of the plant, whose error they are with the sign changed
    command[:2], command[s], command[lost] = (-gains.kp - gains.ki * dt, -gains.kd), gains.ki, -1.0
    A = np.zeros((size, size))
    A[:n, :n] = plant
    A[s, 0], A[s, s] = -dt, 1.0
    A[rate, 1], A[rate, rate], A[rate, lost] = -own, 1 - own, -dt
    A[rate] -= dt * (np.eye(size)[queue] if m else command)
    A[lost, 1], A[lost, rate], A[lost, lost] = out, out, 1.0
    for k in range(m - 1):
        A[queue + k, queue + k + 1] = 1.0
    if m:
        A[size - 1] = command
    inputs = np.vstack([B, np.zeros((size - n, 1))])
    keep = np.arange(size) if gains.integrates else np.delete(np.arange(size), s)
    return control.ss(A[np.ix_(keep, keep)], inputs[keep], -gain * command[None, keep], 0.0, dt)


def observed_margins(gains: Pid, observer: Observer, delay: float, drive: tuple[Signal, ...] = ()) -> Margins:
    """Return the margins of `observed_loop`."""
    return assessed(observed_loop(gains, observer, delay, drive), frequencies(gains, observer.dt))
