"""Torque ripple: the torque per current varies with the angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, pi
from typing import ClassVar

from gimbal_pin.effects.base import Sample
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class TorqueRipple(Harmonic):
    """``tau = tau_model sum_k (a_k cos kq + b_k sin kq)``: the share of the torque that the motor fails to give."""

    name: ClassVar[str] = "torque-ripple"
    amplitude: ClassVar[Parameter] = Parameter(
        "amplitude",
        nan,
        "1",
        0.0,
        2 / 3,
        meaning="share of the torque that comes and goes with the angle, either way",
    )
    loaded: ClassVar[bool] = True
    highest: ClassVar[int] = 300
    dense: ClassVar[int] = 100
    every: ClassVar[int] = 6
    """Six-step commutation of many poles: six times per electrical turn."""
    experiment: ClassVar[str] = "slow sweeps over the same angles under two different loads"
    compensation: ClassVar[str] = "the command is divided by the torque constant at the angle"

    def carrier(self, at: Sample) -> float | Array:
        """The model's total torque."""
        return at.tau

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """What has gone round less than once by none of its harmonics is a bend of the torque, and no ripple yet.

        So bends what an encoder that is off, or sits off its joint's centre, takes for the weight of its link, and so
        does a cable beside that weight; most of it is the torque times one number.
        """
        seen_round = max(self.harmonic) * seen.travel >= 2 * pi
        return () if seen_round else ("torque-gain", "encoder-offset", "cable-spring")

    def says(self, values: Sequence[float] = ()) -> str:
        """Return amplitudes as shares of the torque."""
        return f"the motor's torque per current varies with the angle, as a share {self.listed(values)}"
