"""Presliding: dry friction that builds up like a spring before it slides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, nan
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, EffectMemory, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import FloatOrArray, exp, sign, size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid


@dataclass(frozen=True)
class Presliding(Effect):
    """``tau = level z`` with ``dz/dq = (1 - z sign(dq))/stroke``: bristles that bend, then slide (Dahl 1968).

    The memory z in [-1, 1] depends on the way, not on the time; it does not stick, as a spring does not. Bristles that
    are damped add ``damping (v - z |v|)`` while they bend (Canudas de Wit et al., IEEE TAC 40, 1995, eq. 3).

    Attributes:
        joint: The joint it acts on.
        stroke: Angle over which the friction builds up to 1 - 1/e, rad.
        damped: True adds the damping.
    """

    stroke: float
    damped: bool = False

    name: ClassVar[str] = "presliding"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "stroke",
            nan,
            "rad",
            1e-4,
            0.5,
            meaning="angle over which friction builds up after the direction turned, to 63 %",
        ),
    )
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("level", nan, "N m", 0.0, inf, meaning="friction once it slides"),
        Parameter(
            "damping", 0.0, "N m s/rad", 0.0, inf, meaning="torque per rate while it builds up"
        ),
    )
    bristly: ClassVar[bool] = True
    experiment: ClassVar[str] = "small reversals, from a tenth of the stroke to ten strokes"
    compensation: ClassVar[str] = (
        "friction feed-forward after full sliding; small reversals are left to the feedback"
    )

    @property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The level, and the damping of bristles that have any."""
        return self.linear if self.damped else self.linear[:1]

    def basis(self, at: Sample) -> tuple[FloatOrArray, ...]:
        """Return the bristles' bend, and a stroke times its rate."""
        bend = self.remembered(at)
        return (bend, at.v - bend * size(at.v)) if self.damped else (bend,)

    def start(self) -> EffectMemory | None:
        """Return bristles that are not bent."""
        return 0.0

    def evolve(self, memory: EffectMemory, moved: FloatOrArray) -> EffectMemory:
        """``s + (z - s) exp(-|dq|/stroke)``, the exact solution for a way in one direction s."""
        way = sign(moved)
        return way + (memory - way) * exp(-size(moved) / self.stroke)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Return strokes up to a third of the way, without damping and with it."""
        strokes = build_geometric_grid(4e-4, min(seen.travel / 3, 0.5), 6, cls.shapes[0])
        return tuple(
            cls.inside(joint, stroke, damped) for damped, stroke in product((False, True), strokes)
        )

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with these parameters."""
        effect = cls(str(joint), given["stroke"], given["damping"] != 0)
        return Term(effect, tuple(given[coefficient.name] for coefficient in effect.coefficients))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return size and stroke."""
        return f"after each reversal {values[0]:.3g} N m of friction build up like a spring over {self.stroke:.3g} rad"
