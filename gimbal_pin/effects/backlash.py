"""Backlash: between rotor and link there is a gap, which the rotor crosses whenever the torque changes its sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, nan
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.seen import Seen
from gimbal_pin.effects.signal import Memory, Signal
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class Backlash(Signal):
    """``y = x - J dw/dt``: a rotor at rate w in a gap passes nothing on, and its momentum when it lands.

    Two inertias, the encoder on the link. The link is taken to stand still while the rotor, much lighter, crosses the
    gap, and the landing not to bounce.

    Attributes:
        joint: The joint that has the gap.
        gap: Width of the gap, rad.
        inertia: J, the rotor's inertia at the joint, kg m².
    """

    gap: float
    inertia: float = 1e-3

    name: ClassVar[str] = "backlash"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gap", nan, "rad", 0.0, 0.5),
        Parameter("inertia", 1e-3, "kg m^2", 1e-7, 10.0),
    )
    experiment: ClassVar[str] = "reversals under low load, slow and fast"
    lookalikes: ClassVar[tuple[str, ...]] = ("presliding", "dead-zone", "joint-flexibility")
    compensation: ClassVar[str] = "references that reverse rarely; lower gains, as the joint is loose within the gap"

    def start(self, level: float = 0.0) -> Memory:
        """Return the rotor's place in the gap, rad, and its rate, rad/s: at rest on the side it pushes."""
        return copysign(self.gap / 2, level), 0.0

    def step(self, memory: Memory, x: float, dt: float) -> tuple[Memory, float]:
        """Fly or push; what does not speed the rotor up is passed on."""
        place, rate = memory
        push = x / self.inertia * dt
        after, end = rate + push, place + (rate + push / 2) * dt
        if abs(end) >= self.gap / 2:
            after, end = 0.0, copysign(self.gap / 2, end)
        return (end, after), x - self.inertia * (after - rate) / dt

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Gaps from a milliradian, light and heavy rotors."""
        return tuple(cls(joint, gap, inertia) for gap in (1e-3, 4e-3, 1.6e-2) for inertia in (1e-4, 1e-3, 1e-2))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the gap."""
        return f"the joint is loose by {self.gap:.3g} rad: at every reversal of the torque it is free, then knocks"
