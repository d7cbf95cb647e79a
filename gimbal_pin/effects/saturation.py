"""A motor that gives no more than so much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import Value, cut
from gimbal_pin.effects.seen import Seen, ladder
from gimbal_pin.effects.signal import Static
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Saturation(Static):
    """``y = x`` within ±limit, ``±limit`` beyond: a limit under the one that the rig states.

    Attributes:
        joint: The joint whose motor it is.
        limit: Largest torque, N m.
    """

    limit: float

    name: ClassVar[str] = "saturation"
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("limit", nan, "N m", 1e-6, 1e6),)
    experiment: ClassVar[str] = "peaks of torque up to the stated limit, short, next to gentle motion"
    lookalikes: ClassVar[tuple[str, ...]] = ("torque-gain", "quadratic-drag", "actuator-lag")
    compensation: ClassVar[str] = "state this limit as the motor's: references and anti-windup then keep to it"

    @property
    def largest(self) -> float:
        """The limit."""
        return self.limit

    def passed(self, x: Value) -> Value:
        """Cut the command."""
        return cut(x, self.limit)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Limits that bite on the log's peaks."""
        return tuple(cls(joint, limit) for limit in ladder(0.5 * seen.torque, 0.95 * seen.peak, 8, cls.shapes[0]))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the limit."""
        return f"the motor gives no more than {self.limit:.3g} N m, whatever is commanded"
