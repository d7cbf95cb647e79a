"""Outside the published causes: what else a motor and its drive can do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, inf, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class VoltageLimit(Effect):
    """At speed the supply runs out: stall (1 - v/v₀) bounds the torque along v, stall (1 + v/v₀) against it."""

    no_load_speed: float
    stall: float

    cause = "voltage-limit"
    foreign = ("hard", "sagging-supply")
    kin = ("saturation",)
    stage = 2
    told = ("no_load_speed", "stall")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> VoltageLimit:
        return cls(
            context.joint,
            form,
            4.0 * context.speed,
            context.torque * (2.5 - 2.0 * sqrt(context.share)),
        )

    def scaled(self, k: float) -> VoltageLimit:
        return replace(self, stall=self.stall / k**0.3, no_load_speed=self.no_load_speed / k**0.15)

    def drive(self, world: World) -> Law:
        joint = self.own
        dof = world.dof[self.own]
        top = self.no_load_speed
        stall = self.stall
        sagging = self.form == "sagging-supply"
        supply = 1.0

        def law(state: State) -> None:
            nonlocal supply
            u = state.u[joint]
            v = state.v[dof]
            if sagging:
                supply += state.dt / 0.5 * (1.15 - 0.3 * min(abs(u) / stall, 1.0) - supply)
            high = stall * max(supply - v / top, 0.0)
            low = -stall * max(supply + v / top, 0.0)
            state.u[joint] = min(max(u, low), high)

        return law


@dataclass(frozen=True)
class HotMotor(Effect):
    """The torque constant falls as the magnets warm: heat follows u², gain 1 - loss · heat (or loss · √heat)."""

    loss: float
    time_constant: float
    reference_power: float

    cause = "hot-motor"
    foreign = ("linear", "root")
    kin = ("torque-gain",)
    stage = 5
    within = (-inf, 0.6)
    told = ("loss", "time_constant")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> HotMotor:
        return cls(
            context.joint,
            form,
            1.5 * context.share,
            context.rig.motors[context.joint].warm_up,
            context.torque**2,
        )

    def drive(self, world: World) -> Law:
        joint = self.own
        loss = self.loss
        root = self.form == "root"
        rate = world.dt / self.time_constant
        heat = 0.0

        def law(state: State) -> None:
            nonlocal heat
            heat += rate * (state.u[joint] ** 2 / self.reference_power - heat)
            state.u[joint] *= 1.0 - loss * min(sqrt(heat) if root else heat, 1.4)

        return law


@dataclass(frozen=True)
class CrossTalk(Effect):
    """Stray field: another axis's torque leaks in as c · u_other · cos(k q), or as c · |u_other|."""

    leak: float
    other: int
    harmonic: int

    cause = "cross-axis-coupling"
    foreign = ("angle-dependent", "rectified")
    kin = ("torque-ripple",)
    stage = 8
    needs_axes = 2
    told = ("leak", "harmonic")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> CrossTalk:
        others = [i for i in range(len(context.rig.links)) if i != context.joint]
        return cls(
            context.joint,
            form,
            1.4 * context.share,
            int(rng.choice(others)),
            int(rng.integers(2, 8)),
        )

    def drive(self, world: World) -> Law:
        joint = self.own
        dof = world.dof[self.own]
        other = self.other
        leak = self.leak
        k = self.harmonic
        rectified = self.form == "rectified"

        def law(state: State) -> None:
            u = state.command[other]
            state.u[joint] += leak * (abs(u) if rectified else u * cos(k * state.q[dof]))

        return law


@dataclass(frozen=True)
class TorqueSteps(Effect):
    """The drive knows only so many torques: rounded to steps, or rounded with hysteresis."""

    step: float

    cause = "torque-steps"
    foreign = ("rounded", "hysteresis")
    kin = ("dead-zone",)
    stage = 1

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> TorqueSteps:
        return cls(context.joint, form, 3.4 * context.target)

    def drive(self, world: World) -> Law:
        joint = self.own
        step = self.step
        level = 0.0
        slack = 0.75 * step if self.form == "hysteresis" else 0.5 * step

        def law(state: State) -> None:
            nonlocal level
            u = state.u[joint]
            if abs(u - level) > slack:
                level = step * round(u / step)
            state.u[joint] = level

        return law


@dataclass(frozen=True)
class Dropouts(Effect):
    """Now and then the drive loses a part of its torque, or all, for some tens of milliseconds or just for a few."""

    loss: float
    per_second: float
    seed: int

    cause = "dropouts"
    foreign = ("dips", "stutter")
    kin = ("outliers",)
    stage = 2
    within = (-inf, 1.0)
    told = ("loss", "per_second")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Dropouts:
        per_second = (1.0 if form == "dips" else 8.0) * max(0.5, 60.0 * context.share**2)
        return cls(
            context.joint, form, min(8.0 * context.share, 1.0), per_second, int(rng.integers(2**31))
        )

    def _windows(self, seconds: float) -> list[tuple[float, float]]:
        rng = np.random.default_rng(self.seed)
        count = max(2, round(self.per_second * seconds))
        starts = np.sort(rng.uniform(0.0, seconds, count))
        lengths = rng.uniform(0.01, 0.04, count) * (1.0 if self.form == "dips" else 0.125)
        return [(float(s), float(s + d)) for s, d in zip(starts, lengths, strict=True)]

    def drive(self, world: World) -> Law:
        joint = self.own
        left = 1.0 - self.loss
        windows = iter([*self._windows(world.seconds), (np.inf, np.inf)])
        start, end = next(windows)

        def law(state: State) -> None:
            nonlocal start, end
            while state.t >= end:
                start, end = next(windows)
            if state.t >= start:
                state.u[joint] *= left

        return law


@dataclass(frozen=True)
class SupplyHum(Effect):
    """The supply's ripple rides on the torque: u · depth · sin(2π f t), or depth · limit · sin, f fixed in time."""

    depth: float
    hertz: float

    cause = "supply-hum"
    foreign = ("multiplied", "added")
    kin = ("torque-ripple",)
    stage = 8
    told = ("depth", "hertz")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> SupplyHum:
        depth = 1.4 * (context.share if form == "multiplied" else context.target)
        return cls(context.joint, form, depth, rng.uniform(3.0, 15.0))

    def drive(self, world: World) -> Law:
        joint = self.own
        depth = self.depth
        omega = 2.0 * pi * self.hertz
        added = self.form == "added"

        def law(state: State) -> None:
            wave = depth * cos(omega * state.t)
            state.u[joint] += wave if added else wave * state.u[joint]

        return law
