"""A joint that gives: rotor and link as two masses on a torsion spring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, exp, nan, pi, sin, sqrt
from typing import ClassVar

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.geared import ROTOR_SHARE, Geared
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.effects.signal import JointLoad, SignalMemory
from gimbal_pin.log.log import Array

WITHIN = 1.2
"""Zero over band up to which the link is seen to swing."""
USUAL_ROTOR_SHARE = 0.25
"""The rotor's share of a joint's inertia that is usual."""
ZETA = 0.1
"""Damping of the link's swing that is tried: as wide as two of the zeros that are tried are apart."""


@dataclass(frozen=True)
class JointFlexibility(Geared):
    """``y = F(s) x``, ``F = (s²/(r ω²) + 2 ζ s/ω + 1)/(s²/ω² + 2 ζ s/ω + 1)``: what a torsion spring passes on.

    Two masses J (rotor) and I (link) on a spring k: from the motor's torque to the encoder's angle they are exactly
    the rigid joint with inertia I + J behind F, with ω² = k (1/J + 1/I). With the encoder on the rotor
    r = J/(I + J), the rotor's share; with the encoder on the link the first term is missing. A pose that changes I
    moves ω and r, and the link's own angle its weight: a diagnosis takes the link where it swings.

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
        Parameter(
            "frequency", nan, "Hz", 0.5, 500.0, meaning="resonance of the link on its spring"
        ),
        Parameter("damping", 0.05, "1", 1e-3, 0.5, meaning="damping ratio of that resonance"),
        ROTOR_SHARE,
    )
    linear: ClassVar[bool] = True
    experiment: ClassVar[str] = "a chirp to 100 Hz at small amplitude"
    compensation: ClassVar[str] = (
        "a notch at the resonance, or a bandwidth of at most a third of it"
    )

    @property
    def geared(self) -> bool:
        """With the encoder on the rotor, whose friction the spring is behind."""
        return self.rotor_share > 0

    @property
    def springy(self) -> bool:
        """With the encoder on the rotor it is the link that no encoder sees."""
        return self.geared

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """Far under its resonance a spring is a little more inertia, a little later."""
        return ("armature", "actuator-lag", "delay") if self.frequency > 2 * seen.band else ()

    def moved(self, name: str, value: float) -> Cause:
        """Keep the zero of F, ``r ω²`` and ``ζ/ω``, with another frequency: it is what a log below ω shows best."""
        if name != "frequency" or not self.rotor_share:
            return super().moved(name, value)
        factor = value / self.frequency
        return self.altered(
            frequency=value, rotor_share=self.rotor_share / factor**2, damping=self.damping * factor
        )

    def leaning(self, memory: SignalMemory) -> float | None:
        """What the spring is bent by and its damping, on a rotor."""
        bent = memory[0] + self.damping / (pi * self.frequency) * memory[1]
        return (1 - self.rotor_share) * bent if self.geared else None

    @property
    def held(self) -> JointFlexibility:
        """N: the link alone on its spring, the rotor held; it swings at F's zero, where the rotor hardly moves.

        Both are at least their own bounds: a search may come by a zero of less, which is a spring that holds nothing.
        """
        root = sqrt(self.rotor_share)
        return self.altered(
            frequency=self.frequency * root, damping=self.damping * root, rotor_share=0.0
        )

    def felt(self, load: Array, inertial: Array, dt: float) -> Array:
        """``r inertial + N (load + (1 - r) inertial)``."""
        r = self.rotor_share
        return r * inertial + self.held.passed_on(load + (1 - r) * inertial, dt)

    def swings(self, dt: float, count: int) -> Array:
        """By the spring's bend, and by its rate."""
        ringing = self.held.ringing(dt, count)[:count]
        return np.pad(ringing, ((0, count - len(ringing)), (0, 0)))

    def along(self, command: Array, dt: float, borne: JointLoad | None) -> Array:
        """``y = x + load + inertial - felt``: the same as F on what is beside the friction, but of the motion alone.

        Nobody knows the friction while the rotor sticks and the link swings on, and F would ring on with what is wrong
        of it. How the link swings when the log begins is what fits the torque best.
        """
        if borne is None or not self.springy:
            return self.acting(command, dt)
        load, inertial = (np.broadcast_to(x, command.shape) for x in (borne.load, borne.inertial))
        felt = self.felt(load[:, None], inertial[:, None], dt)[:, 0]
        swings = self.swings(dt, len(command))
        sure = ~np.broadcast_to(borne.still, command.shape) & np.any(swings != 0, axis=1)
        left = command - borne.brake - felt
        begun = np.linalg.lstsq(swings[sure], left[sure], rcond=None)[0]
        return np.asarray(command + load + inertial - felt - swings @ begun)

    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the torque in the spring, N m, and its rate, N m/s."""
        return level, 0.0

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """``z'' = ω² (x - z) - 2 ζ ω z'``, exact for a held command; what speeds neither end up is passed on."""
        w = 2 * pi * self.frequency
        decay = self.damping * w
        turn = w * sqrt(1 - self.damping**2)
        z = memory[0] - x
        rate = memory[1]
        c = cos(turn * dt)
        s = sin(turn * dt) / turn
        left = exp(-decay * dt)
        after = left * (z * c + (rate + decay * z) * s)
        rate_after = left * (rate * c - (w * w * z + decay * rate) * s)
        kept = 1 - 1 / self.rotor_share if self.rotor_share else 1.0
        return (x + after, rate_after), x - kept * (rate_after - rate) / (w * w * dt)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Resonances from a few hertz to several times the band; with the encoder on the rotor, zeros of F.

        Of a resonance far above the band only the zero shows.
        """
        rungs = [
            cls.inside(joint, frequency)
            for frequency in build_geometric_grid(3.0, 3 * seen.band, 9, cls.shapes[0])
        ]
        highest = cls.shapes[0].upper * sqrt(USUAL_ROTOR_SHARE)
        zeros = [
            *build_geometric_grid(1.0, min(WITHIN * seen.band, highest), 15, cls.shapes[0]),
            *build_geometric_grid(1.5 * seen.band, min(5 * seen.band, highest), 4, cls.shapes[0]),
        ]
        behind = [
            cls.inside(
                joint,
                zero / sqrt(USUAL_ROTOR_SHARE),
                ZETA / sqrt(USUAL_ROTOR_SHARE),
                USUAL_ROTOR_SHARE,
            )
            for zero in zeros
        ]
        return (*rungs, *behind)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the resonance and its damping."""
        return f"the joint gives like a spring and rings at {self.frequency:.3g} Hz (damping {self.damping:.2g})"
