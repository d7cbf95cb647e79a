"""Friction that changes while the rig runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp as decay
from math import inf
from typing import ClassVar

from gimbal_pin.effects.base import AMBIENT, Effect, EffectMemory, Sample
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import exp
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array

KELVIN = 10.0
"""Warming of the motor that the coefficients speak of where the log holds its temperature, K."""


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """``tau = x (coulomb slide + viscous v)``: what warming up adds, or takes.

    ``x = 1 - exp(-t/span)`` with the time, ``x = (T - 25 °C)/(10 K)`` with the temperature. A motor warms by its own
    losses, which go with the square of its torque: ``span dx/dt = (τ/held)² - x``, from cold.

    Attributes:
        joint: The joint it acts on.
        span: Time constant of the warming up, s; one well over the log's length is a drift linear in time.
        thermal: True takes the motor's temperature in place of the time.
        held: Torque of which the coefficients tell what it changes, held for ever, N m; 0: time itself is what counts.
    """

    span: float = 300.0
    thermal: bool = False
    held: float = 0.0

    name: ClassVar[str] = "friction-drift"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "span",
            300.0,
            "s",
            1.0,
            1e5,
            meaning="time in which the friction has changed by 63 %; well over the log's length it changes in "
            "proportion to time",
        ),
        Parameter(
            "held",
            0.0,
            "N m",
            0.0,
            1e6,
            meaning="torque that warms the motor, held for ever, to the change that is stated; 0 where time "
            "alone counts",
        ),
    )
    chosen: ClassVar[tuple[str, ...]] = ("held",)
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "coulomb", 0.0, "N m", -inf, inf, meaning="what dry friction changes by in the end"
        ),
        Parameter(
            "viscous",
            0.0,
            "N m s/rad",
            -inf,
            inf,
            meaning="what the friction that grows with the rate changes by in the end",
        ),
    )
    dry: ClassVar[bool] = True
    experiment: ClassVar[str] = "a long run from cold, its first minute repeated as the last"
    compensation: ClassVar[str] = (
        "friction feed-forward by the time since the start; identify again once warm"
    )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Direction and rate, times how far the change has come."""
        x = (at.temperature - AMBIENT) / KELVIN if self.thermal else self.remembered(at)
        return x * at.slide, x * at.v

    def start(self) -> EffectMemory | None:
        """Cold."""
        return 0.0 if self.held else None

    def warmed(self, memory: EffectMemory, tau: float, dt: float) -> EffectMemory:
        """Return the memory after the motor has given `tau` N m for `dt` s, exactly."""
        return (
            memory + (1.0 - decay(-dt / self.span)) * ((tau / self.held) ** 2 - memory)
            if self.held
            else memory
        )

    def remembered(self, at: Sample) -> EffectMemory:
        """Return how far the change has come; where nobody knows the losses, the motor gave the torque `held`."""
        if at.memory is not None:
            return at.memory
        if self.held and at.losses is not None:
            return at.losses.warmth(self.span) / self.held**2
        return 1.0 - exp(-at.t / self.span)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """A drift that levels off within the log, and one that does not; by temperature, or by what makes it."""
        own = (
            [cls.inside(joint, span, held=seen.rms) for span in (seen.seconds / 6, seen.seconds)]
            if seen.rms
            else []
        )
        return (
            cls.inside(joint, seen.seconds / 3),
            cls.inside(joint, 20 * seen.seconds),
            *((cls.inside(joint, thermal=True),) if seen.warm else own),
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the whole change."""
        way = "rises" if values[0] >= 0 else "falls"
        over = (
            f"with every {KELVIN:g} K of warming"
            if self.thermal
            else f"over some {self.span:.3g} s of running"
        )
        over = f"{over} at {self.held:.3g} N m, which warms the motor" if self.held else over
        return f"dry friction {way} by {abs(values[0]):.3g} N m ({values[1]:+.3g} N m per rad/s) {over}"
