"""Outside the published causes: wind, hands, frayed cables, spots and stops that rub."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, cos, exp, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

GUST_RATE = 200.0


@dataclass(frozen=True)
class Wind(Effect):
    """Gusts: a coloured torque with a corner at `hertz`; steady in strength, or in squalls."""

    strength: float
    hertz: float
    seed: int

    cause = "wind"
    foreign = ("steady", "squalls")
    told = ("strength", "hertz")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Wind:
        return cls(
            context.joint,
            form,
            context.target,
            rng.uniform(0.3, 4.0),
            int(rng.integers(2**31)),
        )

    def _gusts(self, seconds: float) -> list[float]:
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
        return list(self.strength * path / np.sqrt(np.mean(path**2)))

    def force(self, world: World) -> Law:
        dof = world.link_dof[self.own]
        gusts = self._gusts(world.seconds)

        def law(state: State) -> None:
            x = state.t * GUST_RATE
            i = int(x)
            state.force[dof] += gusts[i] + (x - i) * (gusts[i + 1] - gusts[i])

        return law


@dataclass(frozen=True)
class Touch(Effect):
    """A hand that now and then pushes for a moment: raised cosines at random times."""

    push: float
    seed: int

    cause = "human-touch"
    foreign = ("pushes",)
    kin = ("outliers",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Touch:
        return cls(context.joint, form, 5.0 * context.target, int(rng.integers(2**31)))

    def force(self, world: World) -> Law:
        rng = np.random.default_rng(self.seed)
        count = max(2, int(world.seconds / 6.0))
        starts = np.sort(rng.uniform(0.03, 0.95, count) * world.seconds).tolist()
        lengths = rng.uniform(0.15, 0.9, count).tolist()
        sizes = (self.push * rng.normal(size=count)).tolist()
        dof = world.link_dof[self.own]
        pushes = list(zip(starts, lengths, sizes, strict=True))

        def law(state: State) -> None:
            for start, length, size in pushes:
                if start <= state.t < start + length:
                    state.force[dof] -= (
                        0.5 * size * (1.0 - cos(2.0 * pi * (state.t - start) / length))
                    )

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
    told = ("size", "stroke")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> BoucWen:
        return cls(
            context.joint,
            form,
            1.5 * context.target,
            rng.uniform(0.1, 0.5) * context.width,
            0.6,
        )

    def force(self, world: World) -> Law:
        dof = world.link_dof[self.own]
        size = self.size
        stroke = self.stroke
        beta = self.beta
        z = 0.0
        pinched = self.form == "pinched"

        def law(state: State) -> None:
            nonlocal z
            v = state.v[dof]
            move = v * state.dt / stroke
            z += move * (1.0 - z * z * (beta * copysign(1.0, v * z) + 1.0 - beta))
            state.force[dof] -= size * (z * abs(z) ** 0.7 if pinched else z)

        return law


@dataclass(frozen=True)
class FrictionSpots(Effect):
    """Dirt in the bearing: narrow places, strewn at random, where dry friction is much higher."""

    height: float
    spots: tuple[tuple[float, float, float], ...]

    cause = "friction-spots"
    foreign = ("bumps",)
    kin = ("position-dependent-friction",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> FrictionSpots:
        low, high = context.span
        places = rng.uniform(low, high, 5)
        widths = rng.uniform(0.01, 0.05, 5) * (high - low)
        heights = rng.uniform(0.3, 1.0, 5)
        spots = tuple(
            (float(p), float(w), float(h)) for p, w, h in zip(places, widths, heights, strict=True)
        )
        return cls(context.joint, form, 4.0 * context.target, spots)

    def grip(self, world: World) -> Law:
        joint = self.own
        dof = world.dof[self.own]
        height = self.height
        spots = self.spots

        def law(state: State) -> None:
            q = state.q[dof]
            more = height * sum(
                [h * exp(-(((q - place) / width) ** 2)) for place, width, h in spots]
            )
            state.plus[joint] += more
            state.minus[joint] += more

        return law


@dataclass(frozen=True)
class RubbingStop(Effect):
    """Near one end of travel something rubs and pushes back: a one-sided soft stop with friction of its own."""

    push: float
    edge: float
    width: float

    cause = "rubbing-stop"
    foreign = ("soft", "hard")
    kin = ("cable-spring", "position-dependent-friction")
    told = ("push", "edge")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> RubbingStop:
        low, high = context.span
        return cls(
            context.joint,
            form,
            3.0 * context.target,
            high - 0.25 * (high - low),
            0.25 * (high - low),
        )

    def _depth(self) -> Callable[[float], float]:
        edge = self.edge
        width = self.width
        power = 2.0 if self.form == "soft" else 1.0
        return lambda q: (max(q - edge, 0.0) / width) ** power

    def force(self, world: World) -> Law:
        dof = world.link_dof[self.own]
        push = self.push
        depth = self._depth()

        def law(state: State) -> None:
            state.force[dof] -= push * depth(state.q[dof])

        return law

    def grip(self, world: World) -> Law:
        joint = self.own
        dof = world.dof[self.own]
        push = 0.5 * self.push
        depth = self._depth()

        def law(state: State) -> None:
            more = push * depth(state.q[dof])
            state.plus[joint] += more
            state.minus[joint] += more

        return law


@dataclass(frozen=True)
class StickyBrake(Effect):
    """A brake that drags for a while and lets go again: dry friction that comes and goes with time."""

    drag: float
    period: float

    cause = "dragging-brake"
    foreign = ("on-off", "swelling")
    kin = ("friction-drift",)
    told = ("drag", "period")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> StickyBrake:
        return cls(context.joint, form, 1.5 * context.target, rng.uniform(2.0, 7.0))

    def grip(self, world: World) -> Law:
        joint = self.own
        drag = self.drag
        period = self.period
        sharp = self.form == "on-off"

        def law(state: State) -> None:
            wave = cos(2.0 * pi * state.t / period)
            more = drag * (float(wave > 0.3) if sharp else 0.5 * (1.0 + wave))
            state.plus[joint] += more
            state.minus[joint] += more

        return law
