"""Friction that changes the dry limits: Stribeck, by direction, by load, by place, by time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, exp, hypot
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..rigs import Rig
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

Shape = Callable[[float], float]


def _grip(joint: int, extra: Callable[[State], float]) -> Law:
    """The same change of the limit in both directions, never below zero."""

    def law(state: State) -> None:
        more = extra(state)
        state.plus[joint] = max(state.plus[joint] + more, 0.0)
        state.minus[joint] = max(state.minus[joint] + more, 0.0)

    return law


@dataclass(frozen=True)
class Stribeck(Effect):
    """extra · g(|v| / speed) on top of Coulomb, g falling from 1 to 0; breakaway at Coulomb + extra."""

    extra: float
    speed: float

    cause: ClassVar[str] = "stribeck"
    forms = {"gaussian": False, "exponential": True, "lorentzian": True}
    shapes: ClassVar[dict[str, Shape]] = {
        "gaussian": lambda x: exp(-x * x),
        "exponential": lambda x: exp(-x),
        "lorentzian": lambda x: 1.0 / (1.0 + x * x),
    }

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Stribeck:
        return cls(context.joint, form, 1.5 * context.target, context.speed * float(rng.uniform(0.08, 0.35)))

    def scaled(self, k: float) -> Stribeck:
        return replace(self, extra=k * self.extra)

    def parameters(self) -> dict[str, float]:
        return {"extra": self.extra, "speed": self.speed}

    def grip(self, world: World) -> Law:
        dof, shape, extra, speed = world.dof[self.own], self.shapes[self.form], self.extra, self.speed
        return _grip(self.own, lambda state: extra * shape(abs(state.v[dof]) / speed))


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """Coulomb ± difference/2, or viscous ± difference/2, by direction of motion."""

    difference: float

    cause: ClassVar[str] = "asymmetric-friction"
    forms = {"coulomb": False, "viscous": False, "saturating": True}

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> AsymmetricFriction:
        size = 2.0 * context.target * float(rng.choice([-1.0, 1.0]))
        return cls(context.joint, form, size / context.speed if form == "viscous" else size)

    def scaled(self, k: float) -> AsymmetricFriction:
        return replace(self, difference=k * self.difference)

    def parameters(self) -> dict[str, float]:
        return {f"{self.form}_difference": self.difference}

    def plant(self, rig: Rig) -> Rig:
        if self.form == "viscous":
            return rig.with_viscous(self.own, 0.6 * abs(self.difference))
        return rig.with_coulomb(self.own, 0.6 * abs(self.difference))

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def force(self, world: World) -> Law | None:
        if self.form != "viscous":
            return None
        dof, half = world.dof[self.own], 0.5 * self.difference

        def law(state: State) -> None:
            state.force[dof] -= half * abs(state.v[dof])

        return law

    def grip(self, world: World) -> Law | None:
        if self.form == "viscous":
            return None
        joint, dof, half, knee = self.own, world.dof[self.own], 0.5 * self.difference, 0.5
        steady = self.form == "coulomb"

        def law(state: State) -> None:
            v = abs(state.v[dof])
            more = half if steady else half * v / (knee + v)
            state.plus[joint] = max(state.plus[joint] + more, 0.0)
            state.minus[joint] = max(state.minus[joint] - more, 0.0)

        return law


@dataclass(frozen=True)
class LoadFriction(Effect):
    """μ · load on top of Coulomb; the load is the motor's torque, gravity's alone, or √(offset² + gravity²)."""

    ratio: float
    offset: float

    cause: ClassVar[str] = "load-dependent-friction"
    forms = {"total": False, "gravity": True, "bearing": True}

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> LoadFriction:
        return cls(context.joint, form, context.share, 0.7 * context.torque)

    def scaled(self, k: float) -> LoadFriction:
        return replace(self, ratio=k * self.ratio)

    def parameters(self) -> dict[str, float]:
        return {"ratio": self.ratio}

    def prepare(self, world: World) -> None:
        world.needs_gravity = world.needs_gravity or self.form != "total"

    def grip(self, world: World) -> Law:
        joint, dof, ratio, offset = self.own, world.link_dof[self.own], self.ratio, self.offset
        loads: dict[str, Callable[[State], float]] = {
            "total": lambda state: abs(state.u[joint]),
            "gravity": lambda state: abs(state.gravity[dof]),
            "bearing": lambda state: hypot(offset, state.gravity[dof] + 0.5 * state.u[joint]) - offset,
        }
        load = loads[self.form]
        return _grip(joint, lambda state: ratio * load(state))


@dataclass(frozen=True)
class PlaceFriction(Effect):
    """Coulomb · (1 + s(q)): harmonics of the angle, or one wide stiff place per turn (von Mises)."""

    amplitude: float
    harmonic: int
    phase: float

    cause: ClassVar[str] = "position-dependent-friction"
    forms = {"harmonic": False, "two-harmonics": False, "von-mises": True}

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> PlaceFriction:
        lowest = max(1, round(1.5 / context.width))
        harmonic = int(rng.integers(lowest, lowest + 4))
        return cls(context.joint, form, 1.5 * context.target, harmonic, float(rng.uniform(-np.pi, np.pi)))

    def scaled(self, k: float) -> PlaceFriction:
        return replace(self, amplitude=k * self.amplitude)

    def parameters(self) -> dict[str, float]:
        return {"amplitude": self.amplitude, "harmonic": float(self.harmonic)}

    def plant(self, rig: Rig) -> Rig:
        return rig.with_coulomb(self.own, 1.4 * self.amplitude)

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def _shape(self) -> Shape:
        k, phase = self.harmonic, self.phase
        shapes: dict[str, Shape] = {
            "harmonic": lambda q: cos(k * q + phase),
            "two-harmonics": lambda q: 0.8 * cos(k * q + phase) + 0.4 * cos(2 * k * q - phase),
            "von-mises": lambda q: 2.0 * exp(2.0 * (cos(k * q + phase) - 1.0)) - 0.6,
        }
        return shapes[self.form]

    def grip(self, world: World) -> Law:
        dof, shape, amplitude = world.dof[self.own], self._shape(), self.amplitude
        return _grip(self.own, lambda state: amplitude * shape(state.q[dof]))


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """Coulomb friction that changes over the run: with time, as a warm-up, or with the motor's own heat."""

    change: float
    time_constant: float
    reference_power: float

    cause: ClassVar[str] = "friction-drift"
    forms = {"linear": False, "warm-up": True, "thermal": True}
    can_start_late = False

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> FrictionDrift:
        time_constant = context.seconds if form == "linear" else context.rig.motors[context.joint].warm_up
        sign = float(rng.choice([-1.0, -1.0, 1.0]))
        return cls(context.joint, form, 1.7 * sign * context.target, time_constant, context.torque**2)

    def scaled(self, k: float) -> FrictionDrift:
        return replace(self, change=k * self.change)

    def parameters(self) -> dict[str, float]:
        return {"change": self.change, "time_constant": self.time_constant}

    def plant(self, rig: Rig) -> Rig:
        return rig.with_coulomb(self.own, 1.3 * max(-self.change, 0.0))

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def grip(self, world: World) -> Law:
        joint, change, tau = self.own, self.change, self.time_constant
        if self.form == "linear":
            return _grip(joint, lambda state: change * state.t / tau)
        if self.form == "warm-up":
            return _grip(joint, lambda state: change * (1.0 - exp(-state.t / tau)))
        heat, power = 0.0, self.reference_power

        def warmth(state: State) -> float:
            nonlocal heat
            heat += state.dt / tau * (state.u[joint] ** 2 / power - heat)
            return change * min(heat, 1.5)

        return _grip(joint, warmth)


@dataclass(frozen=True)
class Drag(Effect):
    """-c |v|ᵖ sign v, p = 2 or another power above one."""

    coefficient: float
    power: float

    cause: ClassVar[str] = "quadratic-drag"
    forms = {"quadratic": False, "power": True}

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Drag:
        power = 2.0 if form == "quadratic" else float(rng.choice([1.7, 2.4, 2.8]))
        return cls(context.joint, form, 0.6 * context.target / context.speed**power, power)

    def scaled(self, k: float) -> Drag:
        return replace(self, coefficient=k * self.coefficient)

    def parameters(self) -> dict[str, float]:
        return {"coefficient": self.coefficient, "power": self.power}

    def force(self, world: World) -> Law:
        dof, coefficient, power = world.dof[self.own], self.coefficient, self.power - 1.0

        def law(state: State) -> None:
            v = state.v[dof]
            state.force[dof] -= coefficient * v * abs(v) ** power

        return law
