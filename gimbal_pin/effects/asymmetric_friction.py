"""Friction that differs by direction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.functions import size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array

SPEEDS = 8
"""Speeds that are tried over two decades: each is less than twice the last, and a search refines them."""


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """``tau = coulomb |slide| + viscous |v|``: half of what the positive direction takes more than the negative one.

    A film of lubricant takes up no torque at rest and a limited one at speed, as it thins with shear: with a speed it
    is ``coulomb |v|/(speed + |v|)``, dry for a speed of zero, and viscous with ``coulomb/speed`` for one far beyond all
    rates. A ``viscous |v|`` beside it is the film's once it is thin (Cross, J. Colloid Sci. 20, 1965).

    Attributes:
        joint: The joint it acts on.
        speed: Rate at which half of what is limited is there, rad/s; 0 where it is there from the slowest rate on.
        thin: True for a viscous part beside what is limited.
    """

    speed: float = 0.0
    thin: bool = False

    name: ClassVar[str] = "asymmetric-friction"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "speed",
            0.0,
            "rad/s",
            0.0,
            10.0,
            meaning="rate at which half of what dry friction differs by is there; 0: all of it from rest on",
        ),
    )
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "coulomb",
            0.0,
            "N m",
            -inf,
            inf,
            meaning="half of what dry friction differs by between the directions, positive where the positive "
            "one brakes more",
        ),
        Parameter(
            "viscous",
            0.0,
            "N m s/rad",
            -inf,
            inf,
            meaning="the same of the friction that grows with the rate",
        ),
    )
    dry: ClassVar[bool] = True
    experiment: ClassVar[str] = "the same constant speeds both ways, and holds at rest in between"
    compensation: ClassVar[str] = "friction feed-forward with its own figures for each direction"

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """Both, or only what is limited."""
        return self.linear if self.thin or not self.speed else self.linear[:1]

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Sliding, or the share that has set in at this rate, and rate, without their signs."""
        rate = size(at.v)
        if not self.speed:
            return size(at.slide), rate
        share = rate / (self.speed + rate)
        return (share, rate) if self.thin else (share,)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with these parameters."""
        effect = cls(str(joint), given["speed"], given["speed"] * given["viscous"] != 0)
        return Term(effect, tuple(given[coefficient.name] for coefficient in effect.coefficients))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return what either direction has more, or less, than the mean of both: the figures themselves."""
        dry, *viscous = values
        more = (1.0 if dry >= 0 else -1.0, "positive" if dry >= 0 else "negative")
        rest = "".join(f" ({more[0] * value:+.3g} N m per rad/s)" for value in viscous)
        upto, half = (
            ("up to ", f"; half of that is there at {self.speed:.3g} rad/s")
            if self.speed
            else ("", "")
        )
        return (
            f"turning in the {more[1]} direction friction is {upto}{abs(dry):.3g} N m{rest} above the mean of both "
            f"directions, in the other as much below it{half}"
        )
