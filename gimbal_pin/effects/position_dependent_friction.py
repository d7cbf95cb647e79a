"""Friction that varies with the angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Sample
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class PositionDependentFriction(Harmonic):
    """``tau = slide sum_k (a_k cos kq + b_k sin kq)``: a bent shaft or a tight spot, on top of Coulomb friction."""

    name: ClassVar[str] = "position-dependent-friction"
    amplitude: ClassVar[Parameter] = Parameter(
        "amplitude",
        nan,
        "N m",
        0.0,
        inf,
        meaning="how much dry friction changes over the angle, to either side",
    )
    dry: ClassVar[bool] = True
    highest: ClassVar[int] = 12
    bends: ClassVar[tuple[str, ...]] = ("load-dependent-friction",)
    experiment: ClassVar[str] = "slow sweeps over the whole range, both ways"
    compensation: ClassVar[str] = (
        "friction feed-forward by angle, in the direction of the reference"
    )

    def carrier(self, at: Sample) -> float | Array:
        """The direction of sliding."""
        return at.slide

    def says(self, values: Sequence[float] = ()) -> str:
        """Return amplitudes and harmonics."""
        return f"friction rises and falls with the angle by {self.listed(values)}"
