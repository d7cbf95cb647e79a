"""Friction that is not the same everywhere, always, or at every speed: by place, by time, by the square of speed."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..rigs import Rig
from .base import Context, Effect, Law
from .friction import Shape, both_ways

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class PlaceFriction(Effect):
    """Coulomb · (1 + s(q)): harmonics of the angle, or one wide stiff place per turn (von Mises)."""

    amplitude: float
    harmonic: int
    phase: float

    cause: ClassVar[str] = "position-dependent-friction"
    known: ClassVar[tuple[str, ...]] = ("harmonic", "two-harmonics")
    foreign: ClassVar[tuple[str, ...]] = ("von-mises",)
    told: ClassVar[tuple[str, ...]] = ("amplitude", "harmonic")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> PlaceFriction:
        lowest = max(1, round(1.5 / context.width))
        harmonic = int(rng.integers(lowest, lowest + 4))
        return cls(
            context.joint, form, 1.5 * context.target, harmonic, float(rng.uniform(-np.pi, np.pi))
        )

    def plant(self, rig: Rig) -> Rig:
        return rig.with_coulomb(self.own, 1.4 * self.amplitude)

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def _shape(self) -> Shape:
        k = self.harmonic
        phase = self.phase
        shapes: dict[str, Shape] = {
            "harmonic": lambda q: cos(k * q + phase),
            "two-harmonics": lambda q: 0.8 * cos(k * q + phase) + 0.4 * cos(2 * k * q - phase),
            "von-mises": lambda q: 2.0 * exp(2.0 * (cos(k * q + phase) - 1.0)) - 0.6,
        }
        return shapes[self.form]

    def grip(self, world: World) -> Law:
        dof = world.dof[self.own]
        shape = self._shape()
        amplitude = self.amplitude
        return both_ways(self.own, lambda state: amplitude * shape(state.q[dof]))


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """Coulomb friction that changes over the run: with time, as a warm-up, or with the motor's own heat."""

    change: float
    time_constant: float
    reference_power: float

    cause: ClassVar[str] = "friction-drift"
    known: ClassVar[tuple[str, ...]] = ("linear",)
    foreign: ClassVar[tuple[str, ...]] = ("warm-up", "thermal")
    told: ClassVar[tuple[str, ...]] = ("change", "time_constant")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> FrictionDrift:
        time_constant = (
            context.seconds if form == "linear" else context.rig.motors[context.joint].warm_up
        )
        sign = float(rng.choice([-1.0, -1.0, 1.0]))
        return cls(
            context.joint, form, 1.7 * sign * context.target, time_constant, context.torque**2
        )

    def plant(self, rig: Rig) -> Rig:
        return rig.with_coulomb(self.own, 1.3 * max(-self.change, 0.0))

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def grip(self, world: World) -> Law:
        joint = self.own
        change = self.change
        tau = self.time_constant
        if self.form == "linear":
            return both_ways(joint, lambda state: change * state.t / tau)
        if self.form == "warm-up":
            return both_ways(joint, lambda state: change * (1.0 - exp(-state.t / tau)))
        heat = 0.0
        power = self.reference_power

        def warmth(state: State) -> float:
            nonlocal heat
            heat += state.dt / tau * (state.u[joint] ** 2 / power - heat)
            return change * min(heat, 1.5)

        return both_ways(joint, warmth)


@dataclass(frozen=True)
class Drag(Effect):
    """-c |v|ᵖ sign v, p = 2 or another power above one."""

    coefficient: float
    power: float

    cause: ClassVar[str] = "quadratic-drag"
    known: ClassVar[tuple[str, ...]] = ("quadratic",)
    foreign: ClassVar[tuple[str, ...]] = ("power",)
    told: ClassVar[tuple[str, ...]] = ("coefficient", "power")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Drag:
        power = 2.0 if form == "quadratic" else float(rng.choice([1.7, 2.4, 2.8]))
        return cls(context.joint, form, 0.6 * context.target / context.speed**power, power)

    def force(self, world: World) -> Law:
        dof = world.dof[self.own]
        coefficient = self.coefficient
        power = self.power - 1.0

        def law(state: State) -> None:
            v = state.v[dof]
            state.force[dof] -= coefficient * v * abs(v) ** power

        return law
