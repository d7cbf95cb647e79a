"""Outside the published causes: what else a motor and its drive can do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, inf, pi, sqrt

import numpy as np

from .base import Effect, change_torque


@dataclass(frozen=True)
class VoltageLimit(Effect):
    """At speed the supply runs out: stall (1 - v/v₀) bounds the torque along v, stall (1 + v/v₀) against it."""

    no_load_speed: float
    stall: float

    cause = "voltage-limit"
    foreign = ("hard", "sagging-supply")
    kin = ("saturation",)
    stage = 2

    @classmethod
    def draw(cls, rng, context, form):
        stall = context.torque * (2.5 - 2.0 * sqrt(context.share))
        return cls(context.joint, form, 4.0 * context.speed, stall)

    def scaled(self, k):
        return replace(self, stall=self.stall / k**0.3, no_load_speed=self.no_load_speed / k**0.15)

    def drive(self, world):
        dof = world.dof[self.own]
        stall = self.stall
        sagging = self.form == "sagging-supply"
        supply = 1.0

        def limit(state, u):
            nonlocal supply
            if sagging:
                supply += state.dt / 0.5 * (1.15 - 0.3 * min(abs(u) / stall, 1.0) - supply)
            speed = state.v[dof] / self.no_load_speed
            return min(max(u, -stall * max(supply + speed, 0.0)), stall * max(supply - speed, 0.0))

        return change_torque(self.own, limit)


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

    @classmethod
    def draw(cls, rng, context, form):
        warm_up = context.rig.motors[context.joint].warm_up
        return cls(context.joint, form, 1.5 * context.share, warm_up, context.torque**2)

    def drive(self, world):
        rate = world.dt / self.time_constant
        heat = 0.0

        def lose(state, u):
            nonlocal heat
            heat += rate * (u**2 / self.reference_power - heat)
            return u * (1.0 - self.loss * min(sqrt(heat) if self.form == "root" else heat, 1.4))

        return change_torque(self.own, lose)


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

    @classmethod
    def draw(cls, rng, context, form):
        others = [i for i in range(len(context.rig.links)) if i != context.joint]
        other = int(rng.choice(others))
        return cls(context.joint, form, 1.4 * context.share, other, int(rng.integers(2, 8)))

    def drive(self, world):
        dof = world.dof[self.own]

        def leak(state, u):
            stray = state.command[self.other]
            size = (
                abs(stray)
                if self.form == "rectified"
                else stray * cos(self.harmonic * state.q[dof])
            )
            return u + self.leak * size

        return change_torque(self.own, leak)


@dataclass(frozen=True)
class TorqueSteps(Effect):
    """The drive knows only so many torques: rounded to steps, or rounded with hysteresis."""

    step: float

    cause = "torque-steps"
    foreign = ("rounded", "hysteresis")
    kin = ("dead-zone",)
    stage = 1

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, 3.4 * context.target)

    def drive(self, world):
        slack = (0.75 if self.form == "hysteresis" else 0.5) * self.step
        level = 0.0

        def round_off(state, u):
            nonlocal level
            if abs(u - level) > slack:
                level = self.step * round(u / self.step)
            return level

        return change_torque(self.own, round_off)


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

    @classmethod
    def draw(cls, rng, context, form):
        per_second = (1.0 if form == "dips" else 8.0) * max(0.5, 60.0 * context.share**2)
        loss = min(8.0 * context.share, 1.0)
        return cls(context.joint, form, loss, per_second, int(rng.integers(2**31)))

    def drive(self, world):
        rng = np.random.default_rng(self.seed)
        count = max(2, round(self.per_second * world.seconds))
        starts = np.sort(rng.uniform(0.0, world.seconds, count))
        ends = starts + rng.uniform(0.01, 0.04, count) * (1.0 if self.form == "dips" else 0.125)
        windows = iter([*zip(starts.tolist(), ends.tolist(), strict=True), (inf, inf)])
        start, end = next(windows)

        def drop(state, u):
            nonlocal start, end
            while state.t >= end:
                start, end = next(windows)
            return u * (1.0 - self.loss) if state.t >= start else u

        return change_torque(self.own, drop)


@dataclass(frozen=True)
class SupplyHum(Effect):
    """The supply's ripple rides on the torque: u · depth · sin(2π f t), or depth · limit · sin, f fixed in time."""

    depth: float
    hertz: float

    cause = "supply-hum"
    foreign = ("multiplied", "added")
    kin = ("torque-ripple",)
    stage = 8

    @classmethod
    def draw(cls, rng, context, form):
        depth = 1.4 * (context.share if form == "multiplied" else context.target)
        return cls(context.joint, form, depth, rng.uniform(3.0, 15.0))

    def drive(self, world):
        omega = 2.0 * pi * self.hertz
        added = self.form == "added"

        def hum(state, u):
            wave = self.depth * cos(omega * state.t)
            return u + (wave if added else wave * u)

        return change_torque(self.own, hum)
