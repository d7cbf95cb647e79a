"""Backlash: between rotor and link there is a gap, which the rotor crosses whenever the torque changes its sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, nan
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.geared import ROTOR_SHARE, Geared
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.effects.signal import SignalMemory
from gimbal_pin.log.log import Array

FINER = 16
"""Widths within a factor of two that are tried where the search has found a gap: a twentieth apart."""


@dataclass(frozen=True)
class Backlash(Geared):
    """``y = x - (1 - 1/r) J dw/dt``: a rotor at rate w in a gap passes nothing on, and its momentum when it lands.

    Two masses J (rotor) and I (link): the rigid joint feels y. With the encoder on the rotor r = J/(I + J), the rotor's
    share: it is the link then whose motion the encoder does not see; with the encoder on the link y = x - J dw/dt.
    With the encoder on the rotor x is what pushes on the gap: the command less the motor's friction, and ``r/(1 - r)``
    of what the link bears, as the link goes its own way while the rotor crosses. The landing is taken not to bounce.

    Attributes:
        joint: The joint that has the gap.
        gap: Width of the gap, rad.
        inertia: J, the rotor's inertia at the joint, kg m².
        rotor_share: r, the rotor's share of the joint's inertia; 0 for an encoder on the link.
    """

    gap: float
    inertia: float = 1e-3
    rotor_share: float = 0.0

    name: ClassVar[str] = "backlash"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "gap",
            nan,
            "rad",
            0.0,
            0.5,
            meaning="how far the joint turns from one flank to the other",
        ),
        Parameter(
            "inertia",
            1e-3,
            "kg m^2",
            1e-7,
            10.0,
            meaning="rotor's inertia that crosses the gap, at the joint",
        ),
        ROTOR_SHARE,
    )
    experiment: ClassVar[str] = "reversals under low load, slow and fast"
    compensation: ClassVar[str] = (
        "references that reverse rarely; lower gains, as the joint is loose within the gap"
    )

    @property
    def geared(self) -> bool:
        """The gap is behind the motor's bearing."""
        return True

    @property
    def abrupt(self) -> bool:
        """With the encoder on the link it is the command alone that drives the rotor."""
        return not self.rotor_share

    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the rotor's place in the gap, rad, and its rate, rad/s: at rest on the side it pushes."""
        positive_zero = 0.0  # added to a level of -0.0, whose sign means nothing
        return copysign(self.gap / 2, level + positive_zero), 0.0

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Fly or push; what does not speed the rotor up is passed on."""
        place, rate = memory
        push = x / self.inertia * dt
        after = rate + push
        end = place + (rate + push / 2) * dt
        if abs(end) >= self.gap / 2:
            after = 0.0
            end = copysign(self.gap / 2, end)
        kept = 1 - 1 / self.rotor_share if self.rotor_share else 1.0
        return (end, after), x - kept * self.inertia * (after - rate) / dt

    def acting(self, command: Array, dt: float) -> Array:
        """Step through the flights alone: from a landing to the torque's next change of sign all of it passes."""
        out = command.astype(float)
        values = command.tolist()
        k = 0
        for turn in (1 + np.flatnonzero(np.diff(np.sign(command)))).tolist():
            k = max(k, turn)
            memory = self.start(values[turn - 1])
            flying = k == turn
            while flying and k < len(values):
                memory, out[k] = self.step(memory, values[k], dt)
                flying = memory[1] != 0.0 or memory[0] * values[k] <= 0.0
                k += 1
        return out

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Gaps from a fraction of a milliradian, light and heavy rotors, the encoder on either side."""
        return tuple(
            cls.inside(joint, gap, inertia, share)
            for gap in (2.5e-4, 1e-3, 4e-3, 1.6e-2)
            for inertia in (1e-4, 1e-3, 1e-2)
            for share in (0.0, 0.25)
        )

    def akin(self, seen: OperatingRange) -> tuple[Cause, ...]:
        """Gaps up to twice and half as wide, with the encoder on the link.

        Where the loop chatters in the gap, one a twentieth wider is open for other samples and gains no more than any.
        """
        if self.rotor_share:
            return ()
        widths = self.gap * 2.0 ** (np.arange(-FINER, FINER + 1) / FINER)
        return tuple(
            self.altered(gap=gap) for gap in widths.tolist() if 0 < gap <= self.shapes[0].upper
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the gap times the rotor's inertia: no torque shows one without the other.

        A rotor at p gap within it goes by ``p'' = x/(J gap)``, and lands with the momentum ``J gap p'``.
        """
        product = f"gap times rotor's inertia being {self.gap * self.inertia:.3g} rad kg m^2"
        return f"the joint is loose: at every reversal of the torque it is free, then knocks, {product}"
