"""Outside the published causes: a base that gives, and something that spins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from operator import mul
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from ..mjcf import Base
from .base import Context, Effect, Law
from .hanging import Vector, direction, edge_of

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class SoftBase(Effect):
    """The head stands on damper springs: three ways to shift and three to turn (or only to turn)."""

    compliance: float
    hertz: float
    damping_ratio: float

    cause = "soft-base"
    foreign = ("six-ways", "turning")
    kin = ("joint-flexibility", "base-tilt")
    stiff = True
    in_band = True
    base = Base.SPRUNG
    widest = 200.0

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> SoftBase:
        return cls(None, form, 1.0, rng.uniform(6.0, 14.0), rng.uniform(0.05, 0.3))

    def scaled(self, k: float) -> SoftBase:
        return replace(self, compliance=float(np.clip(k, 0.02, 8.0)))

    def parameters(self) -> dict[str, float]:
        return {"hertz": self.hertz / self.compliance**0.5, "damping_ratio": self.damping_ratio}

    def force(self, world: World) -> Law:
        mass = 2.0 * sum(body.mass for body in world.rig.bodies)
        inertia = mass * (2.0 * edge_of(world.rig)) ** 2 / 3.0
        omega = 2.0 * pi * self.hertz / self.compliance**0.5
        stiff = 1.0 if self.form == "six-ways" else 40.0
        springs = [stiff * mass * omega**2] * 3 + [inertia * omega**2] * 3
        dampers = [
            2.0 * self.damping_ratio * omega * (mass if i < 3 else inertia) for i in range(6)
        ]
        table = list(zip(world.base_dofs, springs, dampers, strict=True))
        sag = 9.81 * mass

        def law(state: State) -> None:
            for dof, spring, damper in table:
                state.force[dof] -= spring * state.q[dof] + damper * state.v[dof]
            state.force[table[2][0]] += sag

        return law


@dataclass(frozen=True)
class Flywheel(Effect):
    """Something spins in the payload: torque -ω × h on the last link, h fixed in it."""

    momentum: float
    direction: Vector

    cause = "flywheel"
    foreign = ("steady", "spinning-up")
    needs_axes = 2

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Flywheel:
        return cls(None, form, context.target / context.speed, direction(rng))

    def force(self, world: World) -> Law:
        """Q_j = axis_j · (-ω × h), ω = Σ axis_j v_j, all in the world's frame."""
        data = world.data
        h = self.direction
        seconds = world.seconds
        steady = self.form == "steady"
        body = world.model.body(world.rig.links[-1].name).id
        dofs = world.link_dof
        momentum = self.momentum

        def law(state: State) -> None:
            axes = data.xaxis[dofs].tolist()
            spin = [sum(map(mul, data.xmat[body][row : row + 3].tolist(), h)) for row in (0, 3, 6)]
            rate = [sum(axis[i] * state.v[dof] for axis, dof in zip(axes, dofs)) for i in range(3)]
            pull = _cross(spin, rate)
            size = momentum if steady else momentum * 2.0 * state.t / seconds
            for axis, dof in zip(axes, dofs):
                state.force[dof] += size * sum(map(mul, axis, pull))

        return law


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
