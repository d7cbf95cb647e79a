"""Friction: at low speed, by direction, load, place, time and speed, and with a stroke before it slides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, exp, hypot, sqrt

import numpy as np

from ..draws import draw_sign
from .base import Effect, oppose, rub


@dataclass(frozen=True)
class Stribeck(Effect):
    """extra · g(|v| / speed) on top of Coulomb, g falling from 1 to 0; breakaway at Coulomb + extra."""

    extra: float
    speed: float

    cause = "stribeck"
    known = ("gaussian",)
    foreign = ("exponential", "lorentzian")
    told = ("extra", "speed")

    @classmethod
    def draw(cls, rng, context, form):
        speed = context.speed * rng.uniform(0.08, 0.35)
        return cls(context.joint, form, 1.5 * context.target, speed)

    def grip(self, world):
        dof = world.dof[self.own]
        shape = {
            "gaussian": lambda x: exp(-x * x),
            "exponential": lambda x: exp(-x),
            "lorentzian": lambda x: 1.0 / (1.0 + x * x),
        }[self.form]
        return rub(self.own, lambda state: self.extra * shape(abs(state.v[dof]) / self.speed))


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """Coulomb ± difference/2, or viscous ± difference/2, by direction of motion."""

    difference: float

    cause = "asymmetric-friction"
    known = ("coulomb", "viscous")
    foreign = ("saturating",)

    @classmethod
    def draw(cls, rng, context, form):
        size = 2.0 * context.target * draw_sign(rng)
        return cls(context.joint, form, size / context.speed if form == "viscous" else size)

    def parameters(self):
        return {f"{self.form}_difference": self.difference}

    def plant(self, rig):
        kind = "viscous" if self.form == "viscous" else "coulomb"
        return rig.with_friction(self.own, **{kind: 0.6 * abs(self.difference)})

    frozen = plant

    def force(self, world):
        dof = world.dof[self.own]
        half = 0.5 * self.difference
        viscous = self.form == "viscous"
        return oppose(dof, lambda state: half * abs(state.v[dof])) if viscous else None

    def grip(self, world):
        joint = self.own
        dof = world.dof[self.own]
        half = 0.5 * self.difference

        def law(state):
            v = abs(state.v[dof])
            more = half if self.form == "coulomb" else half * v / (0.5 + v)
            state.plus[joint] = max(state.plus[joint] + more, 0.0)
            state.minus[joint] = max(state.minus[joint] - more, 0.0)

        return None if self.form == "viscous" else law


@dataclass(frozen=True)
class LoadFriction(Effect):
    """μ · load on top of Coulomb; the load is the motor's torque, gravity's alone, or √(offset² + gravity²)."""

    ratio: float
    offset: float

    cause = "load-dependent-friction"
    known = ("total",)
    foreign = ("gravity", "bearing")

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, context.share, 0.7 * context.torque)

    def prepare(self, world):
        world.needs_gravity = world.needs_gravity or self.form != "total"

    def grip(self, world):
        joint = self.own
        dof = world.link_dof[self.own]
        offset = self.offset
        load = {
            "total": lambda state: abs(state.u[joint]),
            "gravity": lambda state: abs(state.gravity[dof]),
            "bearing": lambda state: (
                hypot(offset, state.gravity[dof] + 0.5 * state.u[joint]) - offset
            ),
        }[self.form]
        return rub(joint, lambda state: self.ratio * load(state))


@dataclass(frozen=True)
class PlaceFriction(Effect):
    """Coulomb · (1 + s(q)): harmonics of the angle, or one wide stiff place per turn (von Mises)."""

    amplitude: float
    harmonic: int
    phase: float

    cause = "position-dependent-friction"
    known = ("harmonic", "two-harmonics")
    foreign = ("von-mises",)
    told = ("amplitude", "harmonic")

    @classmethod
    def draw(cls, rng, context, form):
        lowest = max(1, round(1.5 / context.width))
        harmonic = int(rng.integers(lowest, lowest + 4))
        return cls(context.joint, form, 1.5 * context.target, harmonic, rng.uniform(-np.pi, np.pi))

    def plant(self, rig):
        return rig.with_friction(self.own, coulomb=1.4 * self.amplitude)

    frozen = plant

    def grip(self, world):
        dof = world.dof[self.own]
        k = self.harmonic
        phase = self.phase
        shape = {
            "harmonic": lambda q: cos(k * q + phase),
            "two-harmonics": lambda q: 0.8 * cos(k * q + phase) + 0.4 * cos(2 * k * q - phase),
            "von-mises": lambda q: 2.0 * exp(2.0 * (cos(k * q + phase) - 1.0)) - 0.6,
        }[self.form]
        return rub(self.own, lambda state: self.amplitude * shape(state.q[dof]))


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """Coulomb friction that changes over the run: with time, as a warm-up, or with the motor's own heat."""

    change: float
    time_constant: float
    reference_power: float

    cause = "friction-drift"
    known = ("linear",)
    foreign = ("warm-up", "thermal")
    told = ("change", "time_constant")

    @classmethod
    def draw(cls, rng, context, form):
        warm_up = context.rig.motors[context.joint].warm_up
        time_constant = context.seconds if form == "linear" else warm_up
        change = 1.7 * float(rng.choice([-1.0, -1.0, 1.0])) * context.target
        return cls(context.joint, form, change, time_constant, context.torque**2)

    def plant(self, rig):
        return rig.with_friction(self.own, coulomb=1.3 * max(-self.change, 0.0))

    frozen = plant

    def grip(self, world):
        joint = self.own
        change = self.change
        tau = self.time_constant
        heat = 0.0

        def warmth(state):
            nonlocal heat
            heat += state.dt / tau * (state.u[joint] ** 2 / self.reference_power - heat)
            return change * min(heat, 1.5)

        if self.form == "linear":
            return rub(joint, lambda state: change * state.t / tau)
        if self.form == "warm-up":
            return rub(joint, lambda state: change * (1.0 - exp(-state.t / tau)))
        return rub(joint, warmth)


@dataclass(frozen=True)
class Drag(Effect):
    """-c |v|ᵖ sign v, p = 2 or another power above one."""

    coefficient: float
    power: float

    cause = "quadratic-drag"
    known = ("quadratic",)
    foreign = ("power",)
    told = ("coefficient", "power")

    @classmethod
    def draw(cls, rng, context, form):
        power = 2.0 if form == "quadratic" else float(rng.choice([1.7, 2.4, 2.8]))
        return cls(context.joint, form, 0.6 * context.target / context.speed**power, power)

    def force(self, world):
        dof = world.dof[self.own]
        power = self.power - 1.0
        return oppose(
            dof, lambda state: self.coefficient * state.v[dof] * abs(state.v[dof]) ** power
        )


def lugre(limit, stroke, damping, stribeck):
    """Return (speed, dt) → friction torque, advancing the bristles:

    ż = v - |v| z / z_s(v); f = (limit/stroke) z + damping ż; z_s falls from 1 + stribeck to 1 strokes with |v|.

    z is advanced exactly for a constant v, and f is its mean over the step: no stiffness is too high."""
    stiffness = limit / stroke
    z = 0.0

    def advance(v, dt):
        nonlocal z
        goal = stroke * (1.0 + stribeck * exp(-((v / 0.02) ** 2))) * (1.0 if v > 0.0 else -1.0)
        x = abs(v) * dt / abs(goal)
        shrink = (1.0 - exp(-x)) / x if x > 1e-9 else 1.0
        before = z
        z = goal + (z - goal) * (1.0 - x * shrink)
        mean = goal + (before - goal) * shrink if x > 1e-9 else z
        return stiffness * mean + damping * (z - before) / dt

    return advance


def maxwell_slip(limit, stroke, damping):
    """Six damped springs in parallel that slip one after the other, between 0.2 and 1.8 strokes."""
    reach = [stroke * (0.2 + 1.6 * i / 5) for i in range(6)]
    stiffness = [limit / 6 / r for r in reach]
    z = [0.0] * 6
    lag = damping / sum(stiffness)

    def advance(v, dt):
        pull = 0.0
        for i, r in enumerate(reach):
            before = z[i]
            z[i] = min(max(before + v * dt, -r), r)
            pull += stiffness[i] * (0.5 * (z[i] + before) + lag * (z[i] - before) / dt)
        return pull

    return advance


@dataclass(frozen=True)
class Presliding(Effect):
    """Dry friction that needs a stroke (rad) to build up (Dahl, LuGre, Maxwell-slip), in the place of true stick."""

    limit: float
    stroke: float
    inertia: float

    cause = "presliding"
    known = ("dahl",)
    foreign = ("lugre", "maxwell-slip")
    stage = 9
    stiff = True
    widest = 300.0
    told = ("limit", "stroke")

    @classmethod
    def draw(cls, rng, context, form):
        limit = max(context.rig.motors[context.joint].coulomb, 2.5 * context.target)
        stroke = 0.005 * min(context.share * context.torque / limit, 1.0) + 2e-4
        return cls(context.joint, form, limit, stroke, context.inertia)

    def scaled(self, k):
        return replace(self, stroke=max(k * self.stroke, 5e-6))

    def plant(self, rig):
        return rig.with_friction(self.own, coulomb=self.limit)

    frozen = plant

    def grip(self, world):
        """Whatever limit other causes have set is handed to the bristles, as a share of their own."""
        joint = self.own
        dof = world.dof[self.own]
        damping = 0.6 * sqrt(self.limit / self.stroke * self.inertia)
        advance = {
            "dahl": lambda: lugre(self.limit, self.stroke, 0.0, 0.0),
            "lugre": lambda: lugre(self.limit, self.stroke, damping, 0.2),
            "maxwell-slip": lambda: maxwell_slip(self.limit, self.stroke, damping),
        }[self.form]()

        def law(state):
            pull = advance(state.v[dof], state.dt)
            side = state.plus if pull > 0.0 else state.minus
            strength = side[joint] / self.limit
            state.force[dof] -= strength * pull
            state.bristle[joint] = strength * pull
            state.plus[joint] = state.minus[joint] = 0.0

        return law
