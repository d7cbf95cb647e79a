"""A drive that ignores small commands."""

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

RAMP = 0.05
"""Share of the width over which a compensating command crosses it."""


@dataclass(frozen=True)
class DeadZone(Static):
    """``y = x - clip(x, -width, width)``: the first `width` of every command is lost.

    Attributes:
        joint: The joint whose drive it is.
        width: Largest command that gives no torque, N m.
    """

    width: float

    name: ClassVar[str] = "dead-zone"
    shapes: ClassVar[tuple[Parameter, ...]] = (Parameter("width", nan, "N m", 0.0, 1e6),)
    experiment: ClassVar[str] = "a balanced rig moved slowly to and fro: torques that cross zero often"
    lookalikes: ClassVar[tuple[str, ...]] = ("backlash", "stribeck", "load-dependent-friction")
    compensation: ClassVar[str] = "the width is added to the command, in its direction"

    def command(self, torque: float) -> float:
        """Add the width in the torque's direction, within `RAMP` of it in proportion: noise shall not chatter."""
        if self.width <= 0:
            return torque
        return torque + self.width * min(1.0, max(-1.0, torque / (RAMP * self.width)))

    def passed(self, x: Value) -> Value:
        """Take the lost part off."""
        return x - cut(x, -self.width, self.width)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Widths from a hundredth of the torque to most of it."""
        return tuple(cls(joint, width) for width in ladder(0.01 * seen.torque, 0.5 * seen.torque, 5, cls.shapes[0]))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the width."""
        return f"the drive gives nothing for the first {self.width:.3g} N m of every command"
