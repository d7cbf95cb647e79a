"""Friction with a stroke before it slides: Dahl, LuGre, Maxwell-slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, sqrt
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..rigs import Rig
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

Bristle = Callable[[float, float], float]
"""(speed, dt) → friction torque, advancing the bristles."""


def lugre(limit: float, stroke: float, damping: float, stribeck: float, speed: float) -> Bristle:
    """ż = v - |v| z / z_s(v); f = (limit/stroke) z + damping ż; z_s falls from 1 + stribeck to 1 strokes with |v|.

    z is advanced exactly for a constant v, and f is its mean over the step: no stiffness is too high."""
    stiffness = limit / stroke
    z = 0.0

    def advance(v: float, dt: float) -> float:
        nonlocal z
        goal = stroke * (1.0 + stribeck * exp(-((v / speed) ** 2))) * (1.0 if v > 0.0 else -1.0)
        x = abs(v) * dt / abs(goal)
        shrink = (1.0 - exp(-x)) / x if x > 1e-9 else 1.0
        before = z
        z = goal + (z - goal) * (1.0 - x * shrink)
        return (
            stiffness * (goal + (before - goal) * shrink if x > 1e-9 else z)
            + damping * (z - before) / dt
        )

    return advance


def maxwell_slip(limit: float, stroke: float, damping: float, elements: int) -> Bristle:
    """Damped springs in parallel that slip one after the other, between 0.2 and 1.8 strokes; their limits add up to
    `limit`."""
    reach = [stroke * (0.2 + 1.6 * i / max(elements - 1, 1)) for i in range(elements)]
    stiffness = [limit / elements / r for r in reach]
    z = [0.0] * elements
    lag = damping / sum(stiffness)

    def advance(v: float, dt: float) -> float:
        pull = 0.0
        move = v * dt
        for i, r in enumerate(reach):
            before = z[i]
            moved = before + move
            z[i] = r if moved > r else (-r if moved < -r else moved)
            pull += stiffness[i] * (0.5 * (z[i] + before) + lag * (z[i] - before) / dt)
        return pull

    return advance


@dataclass(frozen=True)
class Presliding(Effect):
    """Dry friction that needs a stroke (rad) to build up; it takes the place of true stick."""

    limit: float
    stroke: float
    inertia: float

    cause: ClassVar[str] = "presliding"
    known: ClassVar[tuple[str, ...]] = ("dahl",)
    foreign: ClassVar[tuple[str, ...]] = ("lugre", "maxwell-slip")
    stage: ClassVar[int] = 9
    stiff: ClassVar[bool] = True
    widest: ClassVar[float] = 300.0
    told: ClassVar[tuple[str, ...]] = ("limit", "stroke")

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> Presliding:
        limit = max(context.rig.motors[context.joint].coulomb, 2.5 * context.target)
        return cls(
            context.joint,
            form,
            limit,
            0.005 * min(context.share * context.torque / limit, 1.0) + 2e-4,
            context.inertia,
        )

    def scaled(self, k: float) -> Presliding:
        return replace(self, stroke=max(k * self.stroke, 5e-6))

    def plant(self, rig: Rig) -> Rig:
        return rig.with_coulomb(self.own, self.limit)

    def frozen(self, rig: Rig) -> Rig:
        return self.plant(rig)

    def _bristle(self, limit: float) -> Bristle:
        damping = 0.0 if self.form == "dahl" else 0.6 * sqrt(limit / self.stroke * self.inertia)
        if self.form == "maxwell-slip":
            return maxwell_slip(limit, self.stroke, damping, 6)
        return lugre(limit, self.stroke, damping, 0.2 if self.form == "lugre" else 0.0, 0.02)

    def grip(self, world: World) -> Law:
        """Whatever limit other causes have set is handed to the bristles, as a share of their own."""
        joint = self.own
        dof = world.dof[self.own]
        limit = self.limit
        advance = self._bristle(limit)

        def law(state: State) -> None:
            pull = advance(state.v[dof], state.dt)
            strength = (state.plus[joint] if pull > 0.0 else state.minus[joint]) / limit
            state.force[dof] -= strength * pull
            state.bristle[joint] = strength * pull
            state.plus[joint] = state.minus[joint] = 0.0

        return law
