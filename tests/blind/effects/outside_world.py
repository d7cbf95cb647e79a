"""Outside the published causes: wind, hands, frayed cables, spots and stops that rub, soft bases, spinning masses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import copysign, cos, exp, pi
from operator import mul

import numpy as np

from ..mjcf import Base
from .base import Effect, oppose, rub
from .hanging import Vector, direction, edge_of

GUST_RATE = 200.0


@dataclass(frozen=True)
class Wind(Effect):
    """Gusts: a coloured torque with a corner at `hertz`; steady in strength, or in squalls."""

    strength: float
    hertz: float
    seed: int

    cause = "wind"
    foreign = ("steady", "squalls")

    @classmethod
    def draw(cls, rng, context, form):
        hertz = rng.uniform(0.3, 4.0)
        return cls(context.joint, form, context.target, hertz, int(rng.integers(2**31)))

    def _gusts(self, seconds):
        """Two first-order filters in a row over white noise, unit rms, GUST_RATE a second."""
        rng = np.random.default_rng(self.seed)
        count = int(seconds * GUST_RATE) + 3
        keep = exp(-2.0 * pi * self.hertz / GUST_RATE)
        first = second = 0.0
        path = np.empty(count)
        for i, kick in enumerate(rng.normal(size=count)):
            first = keep * first + (1.0 - keep) * kick
            second = keep * second + (1.0 - keep) * first
            path[i] = second
        if self.form == "squalls":
            path *= np.maximum(np.sin(2.0 * pi * np.arange(count) / GUST_RATE / 7.0), 0.0)
        return (self.strength * path / np.sqrt(np.mean(path**2))).tolist()

    def force(self, world):
        gusts = self._gusts(world.seconds)

        def blow(state):
            x = state.t * GUST_RATE
            i = int(x)
            return -(gusts[i] + (x - i) * (gusts[i + 1] - gusts[i]))

        return oppose(world.link_dof[self.own], blow)


@dataclass(frozen=True)
class Touch(Effect):
    """A hand that now and then pushes for a moment: raised cosines at random times."""

    push: float
    seed: int

    cause = "human-touch"
    foreign = ("pushes",)
    kin = ("outliers",)

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, 5.0 * context.target, int(rng.integers(2**31)))

    def force(self, world):
        rng = np.random.default_rng(self.seed)
        count = max(2, int(world.seconds / 6.0))
        starts = np.sort(rng.uniform(0.03, 0.95, count) * world.seconds)
        lengths = rng.uniform(0.15, 0.9, count)
        sizes = self.push * rng.normal(size=count)
        dof = world.link_dof[self.own]
        pushes = np.stack([starts, lengths, sizes], axis=1).tolist()

        def law(state):
            for start, length, size in pushes:
                if start <= state.t < start + length:
                    wave = cos(2.0 * pi * (state.t - start) / length)
                    state.force[dof] -= 0.5 * size * (1.0 - wave)

        return law


@dataclass(frozen=True)
class BoucWen(Effect):
    """A cable with hysteresis: ż = v (1 - |z|ⁿ (β sign(v z) + 1 - β)) / stroke, torque -size · z."""

    size: float
    stroke: float
    beta: float

    cause = "hysteretic-cable"
    foreign = ("round", "pinched")
    kin = ("presliding", "cable-spring")

    @classmethod
    def draw(cls, rng, context, form):
        stroke = rng.uniform(0.1, 0.5) * context.width
        return cls(context.joint, form, 1.5 * context.target, stroke, 0.6)

    def force(self, world):
        dof = world.link_dof[self.own]
        beta = self.beta
        z = 0.0

        def pull(state):
            nonlocal z
            v = state.v[dof]
            move = v * state.dt / self.stroke
            z += move * (1.0 - z * z * (beta * copysign(1.0, v * z) + 1.0 - beta))
            return self.size * (z * abs(z) ** 0.7 if self.form == "pinched" else z)

        return oppose(dof, pull)


@dataclass(frozen=True)
class FrictionSpots(Effect):
    """Dirt in the bearing: narrow places, strewn at random, where dry friction is much higher."""

    height: float
    spots: tuple[tuple[float, float, float], ...]

    cause = "friction-spots"
    foreign = ("bumps",)
    kin = ("position-dependent-friction",)

    @classmethod
    def draw(cls, rng, context, form):
        low, high = context.span
        places = rng.uniform(low, high, 5)
        widths = rng.uniform(0.01, 0.05, 5) * (high - low)
        heights = rng.uniform(0.3, 1.0, 5)
        spots = np.stack([places, widths, heights], axis=1).tolist()
        return cls(context.joint, form, 4.0 * context.target, tuple(map(tuple, spots)))

    def grip(self, world):
        dof = world.dof[self.own]

        def bump(state):
            q = state.q[dof]
            bumps = [h * exp(-(((q - place) / width) ** 2)) for place, width, h in self.spots]
            return self.height * sum(bumps)

        return rub(self.own, bump)


@dataclass(frozen=True)
class RubbingStop(Effect):
    """Near one end of travel something rubs and pushes back: a one-sided soft stop with friction of its own."""

    push: float
    edge: float
    width: float

    cause = "rubbing-stop"
    foreign = ("soft", "hard")
    kin = ("cable-spring", "position-dependent-friction")

    @classmethod
    def draw(cls, rng, context, form):
        low, high = context.span
        width = 0.25 * (high - low)
        return cls(context.joint, form, 3.0 * context.target, high - width, width)

    def _depth(self, q):
        return (max(q - self.edge, 0.0) / self.width) ** (2.0 if self.form == "soft" else 1.0)

    def force(self, world):
        dof = world.link_dof[self.own]
        return oppose(dof, lambda state: self.push * self._depth(state.q[dof]))

    def grip(self, world):
        dof = world.dof[self.own]
        return rub(self.own, lambda state: 0.5 * self.push * self._depth(state.q[dof]))


@dataclass(frozen=True)
class StickyBrake(Effect):
    """A brake that drags for a while and lets go again: dry friction that comes and goes with time."""

    drag: float
    period: float

    cause = "dragging-brake"
    foreign = ("on-off", "swelling")
    kin = ("friction-drift",)

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, 1.5 * context.target, rng.uniform(2.0, 7.0))

    def grip(self, world):
        sharp = self.form == "on-off"

        def seize(state):
            wave = cos(2.0 * pi * state.t / self.period)
            return self.drag * (float(wave > 0.3) if sharp else 0.5 * (1.0 + wave))

        return rub(self.own, seize)


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
    def draw(cls, rng, context, form):
        return cls(None, form, 1.0, rng.uniform(6.0, 14.0), rng.uniform(0.05, 0.3))

    def scaled(self, k):
        return replace(self, compliance=float(np.clip(k, 0.02, 8.0)))

    def force(self, world):
        mass = 2.0 * sum(body.mass for body in world.rig.bodies)
        inertia = mass * (2.0 * edge_of(world.rig)) ** 2 / 3.0
        omega = 2.0 * pi * self.hertz / self.compliance**0.5
        stiff = 1.0 if self.form == "six-ways" else 40.0
        springs = [stiff * mass * omega**2] * 3 + [inertia * omega**2] * 3
        damping = 2.0 * self.damping_ratio * omega
        dampers = [damping * mass] * 3 + [damping * inertia] * 3
        table = list(zip(world.base_dofs, springs, dampers, strict=True))
        sag = 9.81 * mass

        def law(state):
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
    def draw(cls, rng, context, form):
        return cls(None, form, context.target / context.speed, direction(rng))

    def force(self, world):
        """Q_j = axis_j · (-ω × h), ω = Σ axis_j v_j, all in the world's frame."""
        data = world.data
        body = world.model.body(world.rig.links[-1].name).id
        dofs = world.link_dof

        def law(state):
            axes = data.xaxis[dofs].tolist()
            turn = data.xmat[body].tolist()
            spin = [sum(map(mul, turn[row : row + 3], self.direction)) for row in (0, 3, 6)]
            rate = [sum(axis[i] * state.v[dof] for axis, dof in zip(axes, dofs)) for i in range(3)]
            pull = [spin[i - 2] * rate[i - 1] - spin[i - 1] * rate[i - 2] for i in range(3)]
            size = self.momentum
            if self.form == "spinning-up":
                size = self.momentum * 2.0 * state.t / world.seconds
            for axis, dof in zip(axes, dofs):
                state.force[dof] += size * sum(map(mul, axis, pull))

        return law
