"""Friction that changes the dry limits: Stribeck, by direction, by load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, hypot
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..rigs import Rig
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

Shape = Callable[[float], float]


def both_ways(joint: int, extra: Callable[[State], float]) -> Law:
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
    known: ClassVar[tuple[str, ...]] = ("gaussian",)
    foreign: ClassVar[tuple[str, ...]] = ("exponential", "lorentzian")
    shapes: ClassVar[dict[str, Shape]] = {
        "gaussian": lambda x: exp(-x * x),
        "exponential": lambda x: exp(-x),
        "lorentzian": lambda x: 1.0 / (1.0 + x * x),
    }
    told: ClassVar[tuple[str, ...]] = ("extra", "speed")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Stribeck:
        return cls(
            context.joint,
            form,
            1.5 * context.target,
            context.speed * float(rng.uniform(0.08, 0.35)),
        )

    def grip(self, world: World) -> Law:
        dof = world.dof[self.own]
        shape = self.shapes[self.form]
        extra = self.extra
        speed = self.speed
        return both_ways(self.own, lambda state: extra * shape(abs(state.v[dof]) / speed))


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """Coulomb ± difference/2, or viscous ± difference/2, by direction of motion."""

    difference: float

    cause: ClassVar[str] = "asymmetric-friction"
    known: ClassVar[tuple[str, ...]] = ("coulomb", "viscous")
    foreign: ClassVar[tuple[str, ...]] = ("saturating",)

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> AsymmetricFriction:
        size = 2.0 * context.target * float(rng.choice([-1.0, 1.0]))
        return cls(context.joint, form, size / context.speed if form == "viscous" else size)

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
        dof = world.dof[self.own]
        half = 0.5 * self.difference

        def law(state: State) -> None:
            state.force[dof] -= half * abs(state.v[dof])

        return law

    def grip(self, world: World) -> Law | None:
        if self.form == "viscous":
            return None
        joint = self.own
        dof = world.dof[self.own]
        half = 0.5 * self.difference
        knee = 0.5
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
    known: ClassVar[tuple[str, ...]] = ("total",)
    foreign: ClassVar[tuple[str, ...]] = ("gravity", "bearing")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> LoadFriction:
        return cls(context.joint, form, context.share, 0.7 * context.torque)

    def prepare(self, world: World) -> None:
        world.needs_gravity = world.needs_gravity or self.form != "total"

    def grip(self, world: World) -> Law:
        joint = self.own
        dof = world.link_dof[self.own]
        ratio = self.ratio
        offset = self.offset
        loads: dict[str, Callable[[State], float]] = {
            "total": lambda state: abs(state.u[joint]),
            "gravity": lambda state: abs(state.gravity[dof]),
            "bearing": lambda state: (
                hypot(offset, state.gravity[dof] + 0.5 * state.u[joint]) - offset
            ),
        }
        load = loads[self.form]
        return both_ways(joint, lambda state: ratio * load(state))
