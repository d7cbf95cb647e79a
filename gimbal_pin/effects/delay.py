"""A drive that acts late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.effects.signal import Signal, SignalMemory

LONGEST_DRIVE_DELAY = 0.05
"""Longest delay of a drive that is looked for, s: a loop around it has a bandwidth of 3 Hz at most."""


@dataclass(frozen=True)
class Delay(Signal):
    """``y(t) = x(t - time)``.

    Attributes:
        joint: The joint whose motor is late.
        time: Delay, s; it need not be whole samples.
    """

    time: float

    name: ClassVar[str] = "delay"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "time", nan, "s", 0.0, 0.2, meaning="how much later than commanded the torque acts"
        ),
    )
    linear: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "a chirp to 20 Hz and above: a delay's phase keeps growing with frequency"
    )
    compensation: ClassVar[str] = (
        "tune with this delay added to the loop's: lower gains, feed-forward taken from ahead"
    )

    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the commands so far, newest first; the last one held before them."""
        return (level,)

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Within an interval the older command acts for a part of it, the newer for the rest."""
        whole = int(self.time / dt + 1e-9)
        part = max(self.time / dt - whole, 0.0)
        past = (x, *memory)[: whole + 2]
        newer = past[min(whole, len(past) - 1)]
        older = past[-1]
        return past, newer + part * (older - newer)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """From a tenth of a sample of the channels to a twentieth of a second."""
        return tuple(
            cls.inside(joint, time)
            for time in build_geometric_grid(seen.dt / 10, LONGEST_DRIVE_DELAY, 9, cls.shapes[0])
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return it in milliseconds."""
        return f"the motor's torque comes {1e3 * self.time:.3g} ms after the command"
