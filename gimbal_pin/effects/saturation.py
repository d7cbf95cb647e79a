"""A motor that gives no more than so much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import Value, cut
from gimbal_pin.effects.seen import Seen, ladder
from gimbal_pin.effects.signal import Static
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Saturation(Static):
    """``y = x`` within ±limit, ``±limit`` beyond: a limit under the one that the rig states.

    Attributes:
        joint: The joint whose motor it is.
        limit: Largest torque, N m.
        side: 1 or -1 if only torques in that direction are limited; 0 for both.
    """

    limit: float
    side: int = 0

    name: ClassVar[str] = "saturation"
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("limit", nan, "N m", 1e-6, 1e6),)
    experiment: ClassVar[str] = "peaks of torque up to the stated limit, short, next to gentle motion"
    compensation: ClassVar[str] = "state this limit as the motor's: references and anti-windup then keep to it"

    @property
    def largest(self) -> float:
        """The limit."""
        return self.limit

    def sagging(self, command: Array, rate: Array) -> Array:
        """The rate where the limit bites: ``±limit (1 ∓ v/v₀)`` is a supply that gives out."""
        return np.where(self.passed(command) != command, rate, 0.0)

    def passed(self, x: Value) -> Value:
        """Cut the command."""
        return cut(x, -inf if self.side > 0 else -self.limit, inf if self.side < 0 else self.limit)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Limits that bite on the log's peaks, on both sides or on one."""
        limits = ladder(0.5 * seen.torque, 0.95 * seen.peak, 8, cls.shapes[0])
        return tuple(cls(joint, limit, side) for limit in limits for side in (0, 1, -1))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the limit."""
        where = {0: "", 1: " in the positive direction", -1: " in the negative direction"}[self.side]
        return f"the motor gives no more than {self.limit:.3g} N m{where}, whatever is commanded"
