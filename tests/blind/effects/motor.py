"""What the motor adds or gets wrong: cogging, ripple, gain, bias."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, lcm, pi, sin
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

Waves = tuple[tuple[float, int, float], ...]
"""(relative amplitude, harmonic of the mechanical angle, phase)."""


@dataclass(frozen=True)
class Cogging(Effect):
    """amplitude · Σ w cos(kq + φ): one harmonic, several, a steep-flanked one, or one whose height changes with q."""

    amplitude: float
    waves: Waves

    cause: ClassVar[str] = "cogging"
    known: ClassVar[tuple[str, ...]] = ("single", "several")
    foreign: ClassVar[tuple[str, ...]] = ("steep", "modulated")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Cogging:
        motor = context.rig.motors[context.joint]
        whole = lcm(motor.slots, motor.poles)
        main = int(rng.choice([whole, motor.slots, motor.poles, whole // 2]))
        others = [motor.slots, motor.poles, 2 * motor.slots, whole]
        harmonics = (
            [main]
            if form != "several"
            else [main, *(int(k) for k in rng.choice(others, 2, replace=False))]
        )
        weights = [1.0, *rng.uniform(0.2, 0.6, len(harmonics) - 1)]
        waves = tuple(
            (float(w), k, float(rng.uniform(-pi, pi)))
            for w, k in zip(weights, harmonics, strict=True)
        )
        return cls(context.joint, form, 1.4 * context.target, waves)

    def parameters(self) -> dict[str, float]:
        return {"amplitude": self.amplitude, "harmonic": float(self.waves[0][1])}

    def force(self, world: World) -> Law:
        dof = world.dof[self.own]
        a = self.amplitude
        waves = self.waves
        (_, k, phase) = waves[0]
        form = self.form

        def law(state: State) -> None:
            q = state.q[dof]
            if form == "steep":
                x = k * q + phase
                state.force[dof] -= a * cos(x + 0.45 * sin(x))
            elif form == "modulated":
                state.force[dof] -= a * (1.0 + 0.5 * sin(1.37 * q + phase)) * cos(k * q + phase)
            else:
                state.force[dof] -= a * sum([w * cos(n * q + p) for w, n, p in waves])

        return law


@dataclass(frozen=True)
class TorqueRipple(Effect):
    """u · (1 + depth · s(pq)): a harmonic of the electrical angle, two of them, or the trapezoid of six-step drive."""

    depth: float
    harmonic: int
    phase: float

    cause: ClassVar[str] = "torque-ripple"
    known: ClassVar[tuple[str, ...]] = ("single", "two")
    foreign: ClassVar[tuple[str, ...]] = ("six-step",)
    stage: ClassVar[int] = 6
    told: ClassVar[tuple[str, ...]] = ("depth", "harmonic")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> TorqueRipple:
        pairs = context.rig.motors[context.joint].poles // 2
        order = 6 if form == "six-step" else int(rng.choice([1, 2, 6]))
        return cls(
            context.joint, form, 1.4 * context.share, pairs * order, float(rng.uniform(-pi, pi))
        )

    def drive(self, world: World) -> Law:
        joint = self.own
        dof = world.dof[self.own]
        depth = self.depth
        k = self.harmonic
        phase = self.phase
        form = self.form

        def law(state: State) -> None:
            x = k * state.q[dof] + phase
            if form == "six-step":
                wave = 4.0 * abs((x / (2.0 * pi)) % 1.0 - 0.5) - 1.0
            else:
                wave = cos(x) if form == "single" else 0.8 * cos(x) + 0.5 * cos(2.0 * x - phase)
            state.u[joint] *= 1.0 + depth * wave

        return law


@dataclass(frozen=True)
class TorqueGain(Effect):
    """u · (1 + g): the same both ways, or only in one direction of torque."""

    gain: float
    side: float

    cause: ClassVar[str] = "torque-gain"
    known: ClassVar[tuple[str, ...]] = ("constant",)
    foreign: ClassVar[tuple[str, ...]] = ("by-sign",)
    stage: ClassVar[int] = 5
    within: ClassVar[tuple[float, float]] = (-0.6, inf)

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> TorqueGain:
        return cls(
            context.joint, form, float(rng.choice([-1.0, 1.0])) * context.share, context.lean
        )

    def drive(self, world: World) -> Law:
        joint = self.own
        gain = 1.0 + self.gain
        side = self.side
        both = self.form == "constant"

        def law(state: State) -> None:
            if both or side * state.u[joint] > 0.0:
                state.u[joint] *= gain

        return law


@dataclass(frozen=True)
class TorqueBias(Effect):
    """u + bias."""

    bias: float

    cause: ClassVar[str] = "torque-bias"
    known: ClassVar[tuple[str, ...]] = ("constant",)
    stage: ClassVar[int] = 7

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> TorqueBias:
        return cls(context.joint, form, float(rng.choice([-1.0, 1.0])) * context.target)

    def drive(self, world: World) -> Law:
        joint = self.own
        bias = self.bias

        def law(state: State) -> None:
            state.u[joint] += bias

        return law
