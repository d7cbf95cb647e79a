"""Causes between the logged command and the torque that acts: what a drive does to a signal."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.log import Array

Memory = tuple[float, ...]


@dataclass(frozen=True)
class Signal(Cause):
    """``acting = step(command)``, sample by sample: command and acting torque are each constant over an interval.

    The acting torque is the mean over its interval, so that a delay by a part of it, or a lag shorter than it, gives
    the plant the right impulse. Identification applies it to the torque, never its inverse to the columns.

    Attributes:
        joint: The joint whose motor it belongs to.
    """

    joint: str

    clips: ClassVar[bool] = False
    """True if it cuts the command: what it cut cannot be told from the torque that was left."""
    experiment: ClassVar[str] = "a chirp up to the highest frequency that the drive follows"

    @abstractmethod
    def start(self, level: float = 0.0) -> Memory:
        """Return the memory of a drive that has been given `level` N m for ever."""

    @abstractmethod
    def step(self, memory: Memory, x: float, dt: float) -> tuple[Memory, float]:
        """Return the memory and the mean acting torque, N m, after `dt` s of the command `x`, N m."""

    def acting(self, command: Array, dt: float) -> Array:
        """Torque that acts, N m, (N,), for a command, N m, (N,), held `dt` s each; settled on the first before it."""
        values = command.tolist()
        memory, out = self.start(values[0] if values else 0.0), []
        for x in values:
            memory, y = self.step(memory, x, dt)
            out.append(y)
        return np.array(out)
