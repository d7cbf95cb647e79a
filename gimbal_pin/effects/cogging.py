"""Cogging: the magnets of a motor pull towards its teeth, current or not."""

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
class Cogging(Harmonic):
    """``tau = sum_k (a_k cos kq + b_k sin kq)``, k multiples of poles and slots per turn of the joint."""

    name: ClassVar[str] = "cogging"
    amplitude: ClassVar[Parameter] = Parameter(
        "amplitude", nan, "N m", 0.0, inf, meaning="largest torque of the teeth"
    )
    bends: ClassVar[tuple[str, ...]] = ("cable-spring",)
    leans: ClassVar[tuple[str, ...]] = ("base-tilt",)
    """An unbalance about a vertical axis is no part of the rigid model: of a base that leans it pulls once per turn."""
    highest: ClassVar[int] = 400
    experiment: ClassVar[str] = "slow sweeps both ways over as much of a turn as there is"
    compensation: ClassVar[str] = "cogging feed-forward by angle"

    def carrier(self, at: Sample) -> float | Array:
        """One: neither current nor direction matter."""
        return 1.0

    def says(self, values: Sequence[float] = ()) -> str:
        """Return amplitudes and harmonics."""
        return self.listed(values)
