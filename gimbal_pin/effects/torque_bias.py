"""A constant torque: a current sensor's offset, a taut cable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class TorqueBias(Effect):
    """``tau = bias``: the reported torque is off by a constant, N m."""

    name: ClassVar[str] = "torque-bias"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "bias",
            nan,
            "N m",
            -inf,
            inf,
            meaning="constant torque that is reported beside the true one",
        ),
    )
    affine: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "the same motion both ways, and holds at rest approached from both sides"
    )
    compensation: ClassVar[str] = "a constant feed-forward; calibrate the current sensor's zero"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """One at every sample."""
        return (1.0 + 0.0 * at.q,)

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """Coulomb friction that differs by direction: ``b ± c`` while it slides, and anything in between at rest.

        What the fit sees between the two is how it tells the direction at the moments of standstill.
        """
        return ("asymmetric-friction",)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return its size."""
        return f"the reported torque is off by a constant {values[0]:+.3g} N m"
