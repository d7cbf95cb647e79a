"""A drive that ignores small commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, copysign, log, log2, nan
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import FloatOrArray, clip_value, exp, size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.effects.signal import Static

RAMP = 0.05
"""Share of the width over which a compensating command crosses it."""
SHARPNESS_STARTS = (1.5, 4.0, 16.0)
"""Sharpnesses that a search starts from."""
THRESHOLD_STEP = 1.015
"""Largest step between thresholds that are tried where an edge was found: one must be met within two per cent."""
COMMAND_HALVINGS = 40
"""Of the interval in which a compensating command is looked for."""
THROUGH = 50.0
"""Halvings of what is lost after which nothing is: a part in 1e15."""


@dataclass(frozen=True)
class DeadZone(Static):
    """``y = x - clip(x, -width, width)``; with a sharpness n ``y = x (1 - 2^-|x/width|^n)``; or x beyond it.

    An amplifier with a gap loses the width of every command. A drive that ignores what is small, or whose switches
    need a shortest pulse, makes up for it beyond: it passes half of a command of the width and all of a large one. The
    thresholds are spread (Weibull, J. Appl. Mech. 18, 1951): what is lost dies away faster than any power of the
    command. A threshold, as in firmware, passes nothing up to the width, and all beyond it: it tells every
    sample by itself from the next.

    Attributes:
        joint: The joint whose drive it is.
        width: Largest command that gives no torque, N m; with a sharpness, that which gives half of itself.
        sharpness: Power of the command with which it comes through; 0 for a gap or a threshold.
        whole: True for a threshold.
    """

    width: float
    sharpness: float = 0.0
    whole: bool = False

    name: ClassVar[str] = "dead-zone"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "width",
            nan,
            "N m",
            0.0,
            1e6,
            meaning="largest command that gives no torque; with a sharpness, that which gives half of itself",
        ),
        Parameter(
            "sharpness",
            0.0,
            "1",
            0.0,
            2000.0,
            meaning="how sharply torque sets in beyond it; 0 for a gap that takes its width off every command",
        ),
    )
    experiment: ClassVar[str] = (
        "a balanced rig moved slowly to and fro: torques that cross zero often"
    )
    compensation: ClassVar[str] = "what is lost is added to the command, in its direction"

    def command(self, torque: float) -> float:
        """Add what is lost in the torque's direction, within `RAMP` of the width in proportion: noise does not chatter.

        With a sharpness by halving an interval that must hold the command: what passes grows with what is commanded.
        """
        if self.width <= 0:
            return torque
        gentle = min(1.0, abs(torque) / (RAMP * self.width))
        if not (self.sharpness or self.whole):
            return torque + copysign(self.width * gentle, torque)
        low = abs(torque)
        high = abs(torque) + 2 * self.width
        for _ in range(COMMAND_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.passed(middle) < abs(torque) else (low, middle)
        return torque + copysign((high - abs(torque)) * gentle, torque)

    def passed(self, x: FloatOrArray) -> FloatOrArray:
        """Take the lost part off."""
        if self.whole:
            return x * (size(x) > self.width)
        if not self.sharpness or self.width <= 0:
            return x - clip_value(x, -self.width, self.width)
        ratio = clip_value(size(x) / self.width, 0.0, THROUGH ** (1 / max(self.sharpness, 0.1)))
        return x * (1.0 - exp(-log(2.0) * ratio**self.sharpness))

    @property
    def abrupt(self) -> bool:
        """True for a threshold."""
        return self.whole

    def akin(self, seen: OperatingRange) -> tuple[Cause, ...]:
        """Thresholds where an edge has been found: from where it loses a fifth of them to where it loses four.

        On the grid one would have to be met within a few per cent.
        """
        if not self.sharpness:
            return ()
        low, high = (self.width * log2(1.0 / x) ** (1.0 / self.sharpness) for x in (0.8, 0.2))
        widths = build_geometric_grid(
            low, high, ceil(log(high / low) / log(THRESHOLD_STEP)) + 1, self.shapes[0]
        )
        return tuple(self.altered(width=width, sharpness=0.0, whole=True) for width in widths)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Widths from a hundredth of the torque to most of it, gaps and others."""
        gaps = build_geometric_grid(0.01 * seen.torque, 0.7 * seen.torque, 7, cls.shapes[0])
        others = build_geometric_grid(0.02 * seen.torque, 0.8 * seen.torque, 16, cls.shapes[0])
        return (
            *(cls.inside(joint, width) for width in gaps),
            *(
                cls.inside(joint, width, sharpness)
                for width in others
                for sharpness in SHARPNESS_STARTS
            ),
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the width."""
        if self.whole:
            return f"the drive gives nothing for commands up to {self.width:.3g} N m, and all of larger ones"
        if self.sharpness:
            return f"the drive gives next to nothing for commands under {self.width:.3g} N m"
        return f"the drive gives nothing for the first {self.width:.3g} N m of every command"
