"""Two masses at one joint, rotor and link: what a spring and a gap between them share, and the gap's flanks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import NamedTuple

import numpy as np

from gimbal_pin.effects.functions import FloatOrArray
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.signal import JointLoad, Signal

ROTOR_SHARE = Parameter(
    "rotor_share",
    0.0,
    "1",
    0.0,
    0.95,
    meaning="share of the joint's inertia that is the rotor's, where the encoder sits on the motor; 0: "
    "it sits on the link",
)


class Geared(Signal):
    """Rotor and link of one joint, r and 1 - r of its inertia.

    Attributes:
        rotor_share: r; 0 for an encoder on the link.
    """

    rotor_share: float

    @property
    def unseen(self) -> float:
        """The link's share, with the encoder on the rotor."""
        return 1 - self.rotor_share if self.rotor_share > 0 else 0.0

    def beside(self, borne: JointLoad) -> FloatOrArray:
        """``r/(1 - r) load - brake``: with it in x, ``x/J`` is the rotor's acceleration less the link's.

        Nothing with the encoder on the link: the friction that a log shows by its rate's sign is then the link's.
        """
        return (
            self.rotor_share / (1 - self.rotor_share) * borne.load - borne.brake
            if self.rotor_share
            else 0.0
        )


class Flanks(NamedTuple):
    """``x'' = push - k p - d x'`` on a flank, p deep; ``x'' = push`` between them.

    Attributes:
        half: Half of the gap, rad.
        k: 1/s².
        d: 1/s.
        dt: Step, s.
        exact: What a step makes of (p, x', push) on a flank, ((3), (3)).
    """

    half: float
    k: float
    d: float
    dt: float
    exact: tuple[tuple[float, ...], ...]

    def moved(self, x: float, v: float, push: float) -> tuple[float, float]:
        """Place and rate a step later; where it meets a flank or leaves one in it, to second order from then on."""
        half = self.half
        k = self.k
        d = self.d
        dt = self.dt
        side = half if x > half else -half if x < -half else 0.0
        if side:
            (xx, xv, xu), (vx, vv, vu) = self.exact
            p = x - side
            p, v = xx * p + xv * v + xu * push, vx * p + vv * v + vu * push
            if p * side >= 0.0 or v * side >= 0.0:
                return side + p, v
            since = p / v
            v += (k * since / 2 + d) * p
            x = side + p + (k * since / 6 + d / 2) * since * p
        else:
            x = x + (v + push * dt / 2) * dt
            v = v + push * dt
        over = x - half if x > half else x + half if x < -half else 0.0
        if over * v > 0.0:
            since = over / v
            v = v - (k * since / 2 + d) * over
            x = x - (k * since / 6 + d / 2) * since * over
        return x, v


@lru_cache
def _discretise(k: float, d: float, dt: float) -> tuple[tuple[float, ...], ...]:
    """What a step of `dt` s makes of (p, p', push) by ``p'' = push - k p - d p'``, the push held."""
    from scipy.linalg import expm

    step = expm(np.array([[0.0, 1.0, 0.0], [-k, -d, 1.0], [0.0, 0.0, 0.0]]) * dt)
    return tuple(tuple(row) for row in step[:2].tolist())


@dataclass(frozen=True)
class Loose(Geared):
    """``I x'' = -S - f(x, x')``: a link, loose by x from its rotor, flies as S asks it to; f is what a flank pushes.

    Attributes:
        joint: The joint that has the gap.
        gap: Width of the gap, rad.
        inertia: J, the rotor's inertia at the joint, kg m².
        rotor_share: r, the rotor's share of the joint's inertia; 0 for an encoder on the link.
        flank: Frequency at which the link rings on a flank, its motor held, Hz; 0: it lands and does not bounce.
        damping: ζ of that.
    """

    gap: float
    inertia: float = 1e-3
    rotor_share: float = 0.0
    flank: float = 0.0
    damping: float = 0.0

    @property
    def springy(self) -> bool:
        """With flanks that give and the encoder on the rotor, a link flies as it is asked to."""
        return self.flank > 0 and self.rotor_share > 0

    def flanks(self, dt: float, share: float = 1.0) -> Flanks:
        """The flanks as steps of `dt` s meet them: what the link does with `share` of both inertias its own."""
        w = 2 * pi * self.flank
        k = w * w / share
        d = 2 * self.damping * w / share
        return Flanks(self.gap / 2, k, d, dt, _discretise(k, d, dt))
