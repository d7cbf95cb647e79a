"""What the drive does between command and current: lag, delay, saturation, dead zone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import copysign, exp, inf, sqrt, tanh
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class ActuatorLag(Effect):
    """The torque follows its command as a first- or a second-order lag; each step applies the mean over the step."""

    time_constant: float
    damping: float

    cause: ClassVar[str] = "actuator-lag"
    known: ClassVar[tuple[str, ...]] = ("first-order",)
    foreign: ClassVar[tuple[str, ...]] = ("second-order",)
    stage: ClassVar[int] = 4
    widest: ClassVar[float] = 60.0
    within: ClassVar[tuple[float, float]] = (-inf, 0.025)

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> ActuatorLag:
        return cls(context.joint, form, 0.05 * context.share + 1e-4, float(rng.uniform(0.7, 1.1)))

    def drive(self, world: World) -> Law:
        return self._first(world.dt) if self.form == "first-order" else self._second(world.dt)

    def _first(self, dt: float) -> Law:
        joint = self.own
        x = dt / self.time_constant
        keep = exp(-x)
        y = 0.0
        mean = (1.0 - keep) / x

        def law(state: State) -> None:
            nonlocal y
            u = state.u[joint]
            before = y
            y = u + (before - u) * keep
            state.u[joint] = u + (before - u) * mean

        return law

    def _second(self, dt: float) -> Law:
        """ÿ = ω²(u - y) - 2 ζ ω ẏ, ω = 2 / time constant; substeps keep the implicit rule accurate."""
        joint = self.own
        omega = 2.0 / self.time_constant
        zeta = self.damping
        pieces = max(1, int(4.0 * omega * dt) + 1)
        h = dt / pieces
        scale = 1.0 + zeta * omega * h + 0.25 * (omega * h) ** 2
        y = rate = 0.0

        def law(state: State) -> None:
            nonlocal y, rate
            u = state.u[joint]
            total = 0.0
            for _ in range(pieces):
                push = omega * omega * (u - y) - 2.0 * zeta * omega * rate
                step = h * (push - 0.5 * h * omega * omega * rate) / scale
                middle = y + 0.5 * h * (rate + 0.5 * step)
                y = y + h * (rate + 0.5 * step)
                rate = rate + step
                total += middle
            state.u[joint] = total / pieces

        return law


@dataclass(frozen=True)
class Delay(Effect):
    """u(t - d), exact for fractions of a step; or with a d that wanders slowly about its mean."""

    delay: float
    wander: float

    cause: ClassVar[str] = "delay"
    known: ClassVar[tuple[str, ...]] = ("fixed",)
    foreign: ClassVar[tuple[str, ...]] = ("wandering",)
    stage: ClassVar[int] = 3
    widest: ClassVar[float] = 60.0
    within: ClassVar[tuple[float, float]] = (-inf, 0.025)

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Delay:
        return cls(
            context.joint, form, 0.05 * context.share + 1e-4, 0.35 if form == "wandering" else 0.0
        )

    def drive(self, world: World) -> Law:
        joint = self.own
        delay = self.delay
        wander = self.wander
        dt = world.dt
        past: deque[float] = deque(
            [0.0] * (int(delay * (1.0 + wander) / dt) + 3),
            maxlen=int(delay * (1 + wander) / dt) + 3,
        )

        def law(state: State) -> None:
            past.appendleft(state.u[joint])
            slow = (state.t * 0.37) % 2.0 - 1.0
            steps = delay * (1.0 + wander * (2.0 * abs(slow) - 1.0)) / dt
            whole = int(steps)
            state.u[joint] = past[whole] + (steps - whole) * (past[whole + 1] - past[whole])

        return law


@dataclass(frozen=True)
class Saturation(Effect):
    """|u| ≤ limit: a hard clip, a smooth one (limit · tanh), or one that is lower in one direction."""

    limit: float

    cause: ClassVar[str] = "saturation"
    known: ClassVar[tuple[str, ...]] = ("hard",)
    foreign: ClassVar[tuple[str, ...]] = ("smooth", "one-sided")
    stage: ClassVar[int] = 2

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Saturation:
        return cls(context.joint, form, context.torque * (2.2 - 1.5 * sqrt(context.share)))

    def scaled(self, k: float) -> Saturation:
        return replace(self, limit=self.limit / k**0.3)

    def drive(self, world: World) -> Law:
        joint = self.own
        limit = self.limit
        shapes: dict[str, Callable[[float], float]] = {
            "hard": lambda u: min(max(u, -limit), limit),
            "smooth": lambda u: limit * tanh(u / limit),
            "one-sided": lambda u: min(max(u, -2.0 * limit), limit),
        }
        shape = shapes[self.form]

        def law(state: State) -> None:
            state.u[joint] = shape(state.u[joint])

        return law


@dataclass(frozen=True)
class DeadZone(Effect):
    """Small torques are lost: u less the width, nothing below the width, or a soft loss around zero."""

    width: float

    cause: ClassVar[str] = "dead-zone"
    known: ClassVar[tuple[str, ...]] = ("gap",)
    foreign: ClassVar[tuple[str, ...]] = ("threshold", "soft")
    stage: ClassVar[int] = 1

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> DeadZone:
        return cls(
            context.joint,
            form,
            1.2 * context.target if form == "gap" else context.torque * sqrt(context.share),
        )

    def scaled(self, k: float) -> DeadZone:
        return replace(self, width=k * self.width if self.form == "gap" else k**0.6 * self.width)

    def drive(self, world: World) -> Law:
        joint = self.own
        width = self.width
        shapes: dict[str, Callable[[float], float]] = {
            "gap": lambda u: copysign(max(abs(u) - width, 0.0), u),
            "threshold": lambda u: u if abs(u) > width else 0.0,
            "soft": lambda u: u * (1.0 - exp(-((u / width) ** 2))),
        }
        shape = shapes[self.form]

        def law(state: State) -> None:
            state.u[joint] = shape(state.u[joint])

        return law
