"""A cable or a spring that pulls the joint back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf, log, nan, pi, sqrt
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import clip_value, exp, larger, propagate_deviation
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.log.log import Array

STATED = (
    Parameter("stiffness", nan, "N m/rad", 0.0, inf, meaning="torque per angle where it rests"),
    Parameter("rest", 0.0, "rad", -4 * pi, 4 * pi, meaning="angle at which it pulls neither way"),
    Parameter(
        "cubic", 0.0, "N m/rad^3", 0.0, inf, meaning="torque per cube of the angle, beside that"
    ),
)
GROWTH = Parameter("growth", 0.0, "rad", 0.0, 10.0)
SPRING_KNOTS: tuple[Parameter, ...] = (
    Parameter("upper", 0.0, "rad", -4 * pi, 4 * pi),
    Parameter("lower", 0.0, "rad", -4 * pi, 4 * pi),
)
SIDES: tuple[Parameter, ...] = (
    Parameter("above", 0.0, "N m/rad", 0.0, inf),
    Parameter("below", 0.0, "N m/rad", 0.0, inf),
)
ENDS = (
    Parameter("up", 0.0, "N m", 0.0, inf),
    Parameter("down", 0.0, "N m", 0.0, inf),
)
LEAST_PULL, LARGEST_EXPONENT = 1e-9, 50.0
"""An end that pulls by less, N m, pulls by none; an exponent beyond is no cable's."""
STEEPEST, MILDEST = 20.0, 2.0
"""Shares of the travel over which a pull that is looked for grows e-fold: one over them."""
PLACES = (-0.3, -0.1, 0.1, 0.3)
"""Shares of the travel, from its middle, where a cable that is looked for comes taut."""


@dataclass(frozen=True)
class CableSpring(Effect):
    """``tau = stiffness (q - rest) + cubic (q - rest)³``, expanded in powers of q, in which it is linear.

    The cubic part needs its q² as well: without it a false fourth harmonic of the angle appears.

    Rubber, and a cable that is slack until it is taut, pull e-fold with every `growth` of angle (Fung 1967):
    ``tau = up exp(q/growth) - down exp(-q/growth)``, which is ``stiffness growth sinh((q - rest)/growth)``.

    A cable with slack in it pulls once it is taut: ``tau = above max(q - upper, 0) - below max(lower - q, 0)``, or but
    one of the two.

    Attributes:
        joint: The joint it acts on.
        stiffening: True adds the cubic part.
        growth: Angle over which the pull grows e-fold, rad; 0 for one in powers of the angle.
        taut: 2 for one that is slack between `lower` and `upper`; 1 or -1 if it pulls above `upper` or below `lower`
            only; 0 for one that is never slack.
        upper: Angle above which it is taut, rad; 0 where it is not slack below any.
        lower: The same on the other side.
    """

    stiffening: bool = False
    growth: float = 0.0
    taut: int = 0
    upper: float = 0.0
    lower: float = 0.0

    name: ClassVar[str] = "cable-spring"
    shapes: ClassVar[tuple[Parameter, ...]] = (GROWTH, *SPRING_KNOTS)
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("offset", 0.0, "N m", -inf, inf),
        Parameter("stiffness", 0.0, "N m/rad", 0.0, inf),
        Parameter("quadratic", 0.0, "N m/rad^2", -inf, inf),
        Parameter("cubic", 0.0, "N m/rad^3", 0.0, inf),
    )
    experiment: ClassVar[str] = (
        "slow sweeps over the whole range, repeated with the other axes elsewhere"
    )
    compensation: ClassVar[str] = (
        "spring feed-forward by angle; or dress the cable so that it does not pull"
    )

    @property
    def sides(self) -> slice:
        """On which sides a slack one comes taut, of those above and below."""
        return slice(int(self.taut < 0), 2 - int(self.taut == 1))

    def moved(self, name: str, value: float) -> Cause:
        """One end of the slack goes no further than the other."""
        if self.taut == 2 and name in ("upper", "lower"):
            value = max(value, self.lower) if name == "upper" else min(value, self.upper)
        return super().moved(name, value)

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """Powers 0 and 1 of q, and 2 and 3 with a stiffening spring; or how either end pulls, if both do."""
        if self.growth:
            return ENDS
        if self.taut:
            return SIDES[self.sides]
        return self.linear if self.stiffening else self.linear[:2]

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Powers of the angle, or how either end pulls."""
        if self.growth:
            steep = clip_value(at.q / self.growth, -LARGEST_EXPONENT, LARGEST_EXPONENT)
            return exp(steep), -exp(-steep)
        if self.taut:
            pulls: tuple[float | Array, ...] = (
                larger(at.q - self.upper, 0.0),
                -larger(self.lower - at.q, 0.0),
            )
            return pulls[self.sides]
        one = 1.0 + 0.0 * at.q
        # A power of a float that runs away is an error, a product is infinite.
        return (one, at.q, at.q * at.q, at.q * at.q * at.q) if self.stiffening else (one, at.q)

    def list_ends(self) -> tuple[str, ...]:
        """Return the names of the angles at which a slack one comes taut."""
        ends: tuple[str, ...] = ("upper", "lower")
        return ends[self.sides] if self.taut else ()

    def spring(self, values: Sequence[float]) -> tuple[float, float, float]:
        """Stiffness, rest and cubic stiffness from the coefficients; of one that grows, where it is softest.

        Of one that hangs slack: the mean of its sides, once it is taut, and the middle of the slack.
        """
        if self.taut:
            return sum(values) / len(values), (self.upper + self.lower) / 2, 0.0
        if self.growth:
            up, down = (max(x, LEAST_PULL) for x in values)
            rest = float(
                clip_value(self.growth / 2 * log(down / up), STATED[1].lower, STATED[1].upper)
            )
            return 2 * sqrt(up * down) / self.growth, rest, 0.0
        offset, stiffness = values[:2]
        if not self.stiffening or values[3] == 0:
            return stiffness, -offset / stiffness if stiffness else 0.0, 0.0
        rest = -values[2] / (3 * values[3])
        return stiffness - 3 * values[3] * rest**2, rest, values[3]

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """Stiffness, rest and, with a stiffening spring, cubic stiffness, or the angle over which the pull grows.

        Of a slack one stiffness, and where it comes taut.
        """
        std = (
            [nan] * 3
            if covariance is None
            else propagate_deviation(self.spring, values, covariance)
        )
        rows = list(zip(STATED, self.spring(values), std))
        found = tuple(
            replace(p, value=float(x), std=float(s))
            for p, x, s in (rows if self.stiffening else rows[:2])
        )
        if self.taut:
            return (
                found[0],
                *(replace(p, value=getattr(self, p.name)) for p in SPRING_KNOTS[self.sides]),
            )
        return (*found, replace(GROWTH, value=self.growth)) if self.growth else found

    def holds(self, values: Sequence[float] = ()) -> str:
        """``k (q - rest) + c = k (q - (rest - c/k))``: a constant torque beside a spring is in where it rests."""
        k = 0.0 if self.growth or self.taut else self.spring(values)[0]
        return (
            "a torque-bias or asymmetric-friction beside it would show as another rest angle, by "
            f"{1 / k:.2g} rad per N m"
            if k > 0
            else ""
        )

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """Stiffness, rest, cubic stiffness."""
        return STATED

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term of this spring."""
        k, rest, k3 = (given[parameter.name] for parameter in STATED)
        values = (-k * rest - k3 * rest**3, k + 3 * k3 * rest**2, -3 * k3 * rest, k3)
        effect = cls(str(joint), stiffening=k3 != 0)
        return Term(effect, values[: len(effect.coefficients)])

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """With and without the cubic part, growing over a twentieth of the travel to half of it, and slack."""
        growing = build_geometric_grid(seen.travel / STEEPEST, seen.travel / MILDEST, 5, GROWTH)
        found = [
            cls.inside(joint),
            cls.inside(joint, stiffening=True),
            *(cls.inside(joint, growth=growth) for growth in growing),
        ]
        knots = [seen.middle + place * seen.travel for place in PLACES]
        found += [
            cls.inside(joint, taut=2, upper=upper, lower=lower)
            for lower, upper in combinations(knots, 2)
        ]
        above = [cls.inside(joint, taut=1, upper=knot) for knot in knots]
        below = [cls.inside(joint, taut=-1, lower=knot) for knot in knots]
        return (*found, *above, *below)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return stiffness and rest."""
        k, rest, k3 = self.spring(values)
        if self.taut:
            ends = [f"above {self.upper:.3g} rad", f"below {self.lower:.3g} rad"][self.sides]
            pulls = " and ".join(f"{end} with {x:.3g} N m/rad" for end, x in zip(ends, values))
            return f"a cable pulls the joint back once it is taut: {pulls}"
        more = f", and {k3:.3g} N m/rad^3 beyond" if k3 else ""
        more = f" there, e-fold with every {self.growth:.3g} rad" if self.growth else more
        return f"something pulls the joint towards {rest:.3g} rad with {k:.3g} N m/rad{more}"
