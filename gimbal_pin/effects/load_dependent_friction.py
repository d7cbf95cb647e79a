"""Friction that grows with the torque the joint carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import ClassVar

from gimbal_pin.effects.base import Effect, Sample
from gimbal_pin.effects.functions import size
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """``tau = mu |tau_model| slide``: bearings and gears drag with what they carry."""

    name: ClassVar[str] = "load-dependent-friction"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("mu", nan, "1", 0.0, 0.95),)
    dry: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    experiment: ClassVar[str] = "the same motion with two payloads, or well out of balance and balanced"
    compensation: ClassVar[str] = "friction feed-forward in proportion to the model's torque"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Size of the load, in the direction of sliding."""
        return (size(at.tau) * at.slide,)

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the share of the load."""
        return f"friction grows by {100 * values[0]:.3g} % of the torque that the joint carries"
