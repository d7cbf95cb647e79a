"""A joint that gives: rotor and link as two masses on a torsion spring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, exp, nan, pi, sin, sqrt
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import cut
from gimbal_pin.effects.seen import Seen, ladder
from gimbal_pin.effects.signal import Memory, Signal
from gimbal_pin.parameter import Parameter

LOW = 0.7
"""Zero over band up to which the resonance itself may show."""


@dataclass(frozen=True)
class JointFlexibility(Signal):
    """``y = F(s) x``, ``F = (s²/(r ω²) + 2 ζ s/ω + 1)/(s²/ω² + 2 ζ s/ω + 1)``: what a torsion spring passes on.

    Two masses J (rotor) and I (link) on a spring k: from the motor's torque to the encoder's angle they are exactly
    the rigid joint with inertia I + J behind F, with ω² = k (1/J + 1/I). With the encoder on the rotor
    r = J/(I + J), the rotor's share; with the encoder on the link the first term is missing. A pose that changes I
    moves ω and r, which this leaves out.

    Attributes:
        joint: The joint that gives.
        frequency: Resonance ω/2π, Hz.
        damping: ζ.
        rotor_share: r; 0 for an encoder on the link.
    """

    frequency: float
    damping: float = 0.05
    rotor_share: float = 0.0

    name: ClassVar[str] = "joint-flexibility"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency", nan, "Hz", 0.5, 500.0),
        Parameter("damping", 0.05, "1", 1e-3, 0.5),
        Parameter("rotor_share", 0.0, "1", 0.0, 0.95),
    )
    linear: ClassVar[bool] = True
    experiment: ClassVar[str] = "a chirp to 100 Hz at small amplitude"
    compensation: ClassVar[str] = "a notch at the resonance, or a bandwidth of at most a third of it"

    def blurred(self, seen: Seen) -> tuple[str, ...]:
        """Far under its resonance a spring is a little more inertia, a little later."""
        return ("armature", "actuator-lag", "delay") if self.frequency > 2 * seen.band else ()

    def moved(self, name: str, value: float) -> Cause:
        """Keep the zero of F, ``r ω²`` and ``ζ/ω``, with another frequency: it is what a log below ω shows best."""
        if name != "frequency" or not self.rotor_share:
            return super().moved(name, value)
        factor = value / self.frequency
        limits = {shape.name: (shape.lower, shape.upper) for shape in self.shapes}
        share = float(cut(self.rotor_share / factor**2, *limits["rotor_share"]))
        damping = float(cut(self.damping * factor, *limits["damping"]))
        return replace(self, frequency=value, rotor_share=share, damping=damping)

    def start(self, level: float = 0.0) -> Memory:
        """Return the spring's deflection in N m and its rate in N m/s."""
        return level, 0.0

    def step(self, memory: Memory, x: float, dt: float) -> tuple[Memory, float]:
        """Exact for a held command: ``z'' = ω² (x - z) - 2 ζ ω z'``; what speeds neither end up is passed on."""
        w = 2 * pi * self.frequency
        decay, turn = self.damping * w, w * sqrt(1 - self.damping**2)
        z, rate = memory[0] - x, memory[1]
        c, s, left = cos(turn * dt), sin(turn * dt) / turn, exp(-decay * dt)
        after = left * (z * c + (rate + decay * z) * s)
        rate_after = left * (rate * c - (w * w * z + decay * rate) * s)
        kept = 1 - 1 / self.rotor_share if self.rotor_share else 1.0
        return (x + after, rate_after), x - kept * (rate_after - rate) / (w * w * dt)

    @classmethod
    def tried(cls, joint: str, seen: Seen) -> tuple[Cause, ...]:
        """Resonances from a few hertz to several times the band; with the encoder on the rotor, zeros of F.

        Of a resonance far above the band only the zero shows.
        """
        rungs = ladder(3.0, 3 * seen.band, 9, cls.shapes[0])
        zeros = ladder(1.0, 5 * seen.band, 13, cls.shapes[0])
        shares = [(zero, share) for zero in zeros for share in (0.1, 0.3) if zero < LOW * seen.band or share == 0.3]
        behind = tuple(cls(joint, zero / sqrt(share), 0.05, share) for zero, share in shares)
        return (*(cls(joint, frequency) for frequency in rungs), *behind)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the resonance."""
        return f"the joint gives like a spring and rings at {self.frequency:.3g} Hz (damping {self.damping:.2g})"
