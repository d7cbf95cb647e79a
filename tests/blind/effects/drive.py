"""Effects of drive and motor between command and torque: lags, losses, limits, ripple, gain and bias."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import copysign, cos, exp, inf, lcm, pi, sin, sqrt, tanh

import numpy as np

from ..draws import draw_sign
from .base import Forms, MotorEffect, OpposingEffect

LONGEST_LAG = (-inf, 0.025)


class ActuatorLag(MotorEffect):
    """The torque follows its command as a first- or a second-order lag; each step applies the mean over the step."""

    time_constant: float
    damping: float

    cause = "actuator-lag"
    known = ("first-order",)
    foreign = ("second-order",)
    stage = 4
    widest = 60.0
    within = LONGEST_LAG

    @staticmethod
    def first_guess(rng, context, form):
        return 0.05 * context.share + 1e-4, rng.uniform(0.7, 1.1)

    def start(self, world):
        return self._first(world.dt) if self.form == "first-order" else self._second(world.dt)

    def _first(self, dt):
        x = dt / self.time_constant
        keep = exp(-x)
        mean = (1.0 - keep) / x
        y = 0.0

        def follow(u, q, state):
            nonlocal y
            before = y
            y = u + (before - u) * keep
            return u + (before - u) * mean

        return follow

    def _second(self, dt):
        """ÿ = ω²(u - y) - 2 ζ ω ẏ, ω = 2 / time constant; substeps keep the implicit rule accurate."""
        omega = 2.0 / self.time_constant
        zeta = self.damping
        pieces = max(1, int(4.0 * omega * dt) + 1)
        h = dt / pieces
        scale = 1.0 + zeta * omega * h + 0.25 * (omega * h) ** 2
        y = rate = 0.0

        def follow(u, q, state):
            nonlocal y, rate
            total = 0.0
            for _ in range(pieces):
                push = omega * omega * (u - y) - 2.0 * zeta * omega * rate
                step = h * (push - 0.5 * h * omega * omega * rate) / scale
                move = h * (rate + 0.5 * step)
                total += y + 0.5 * move
                y += move
                rate += step
            return total / pieces

        return follow


class Delay(MotorEffect):
    """u(t - d), exact for fractions of a step; or with a d that wanders slowly about its mean."""

    delay: float
    wander: float

    cause = "delay"
    known = ("fixed",)
    foreign = ("wandering",)
    stage = 3
    widest = 60.0
    within = LONGEST_LAG

    @staticmethod
    def first_guess(rng, context, form):
        return 0.05 * context.share + 1e-4, 0.35 if form == "wandering" else 0.0

    def start(self, world):
        length = int(self.delay * (1.0 + self.wander) / world.dt) + 3
        past = deque([0.0] * length, maxlen=length)

        def follow(u, q, state):
            past.appendleft(u)
            slow = (state.t * 0.37) % 2.0 - 1.0
            steps = self.delay * (1.0 + self.wander * (2.0 * abs(slow) - 1.0)) / world.dt
            whole = int(steps)
            return past[whole] + (steps - whole) * (past[whole + 1] - past[whole])

        return follow


class Saturation(MotorEffect):
    """|u| ≤ limit: a hard clip, a smooth one (limit · tanh), or one that is lower in one direction."""

    limit: float

    cause = "saturation"
    known = Forms({"hard": lambda u, limit: min(max(u, -limit), limit)})
    foreign = Forms({
        "smooth": lambda u, limit: limit * tanh(u / limit),
        "one-sided": lambda u, limit: min(max(u, -2.0 * limit), limit),
    })  # fmt: skip
    stage = 2

    @staticmethod
    def first_guess(rng, context, form):
        return (context.torque * (2.2 - 1.5 * sqrt(context.share)),)

    def scaled(self, k):
        return replace(self, limit=self.limit / k**0.3)

    def formula(self, u, q, state):
        return self.shape(u, self.limit)


class DeadZone(MotorEffect):
    """Small torques are lost: u less the width, nothing below the width, or a soft loss around zero."""

    width: float

    cause = "dead-zone"
    known = Forms({"gap": lambda u, width: copysign(max(abs(u) - width, 0.0), u)})
    foreign = Forms({
        "threshold": lambda u, width: u if abs(u) > width else 0.0,
        "soft": lambda u, width: u * (1.0 - exp(-((u / width) ** 2))),
    })  # fmt: skip
    stage = 1

    @staticmethod
    def first_guess(rng, context, form):
        soft = context.torque * sqrt(context.share)
        return (1.2 * context.target if form == "gap" else soft,)

    def scaled(self, k):
        return replace(self, width=k * self.width if self.form == "gap" else k**0.6 * self.width)

    def formula(self, u, q, state):
        return self.shape(u, self.width)


class Cogging(OpposingEffect):
    """amplitude · Σ w cos(kq + φ): one harmonic, several, a steep-flanked one, or one whose height changes with q.

    `waves`: relative amplitude, harmonic of the mechanical angle and phase of each."""

    amplitude: float
    waves: tuple[tuple[float, int, float], ...]

    cause = "cogging"
    known = ("single", "several")
    foreign = ("steep", "modulated")
    told = ("amplitude", "harmonic")
    on_link = False

    @staticmethod
    def first_guess(rng, context, form):
        slots = context.motor.slots
        poles = context.motor.poles
        whole = lcm(slots, poles)
        harmonics = [rng.choice([whole, slots, poles, whole // 2])]
        if form == "several":
            harmonics += [*rng.choice([slots, poles, 2 * slots, whole], 2, replace=False)]
        weights = [1.0, *rng.uniform(0.2, 0.6, len(harmonics) - 1)]
        pairs = zip(weights, harmonics)
        waves = tuple((float(w), int(k), rng.uniform(-pi, pi)) for w, k in pairs)
        return 1.4 * context.target, waves

    @property
    def harmonic(self):
        """The first wave's."""
        return self.waves[0][1]

    def formula(self, q, v, state):
        a = self.amplitude
        if self.form in self.known:
            return a * sum([w * cos(n * q + p) for w, n, p in self.waves])
        ((_, k, phase),) = self.waves
        x = k * q + phase
        if self.form == "steep":
            return a * cos(x + 0.45 * sin(x))
        return a * (1.0 + 0.5 * sin(1.37 * q + phase)) * cos(x)


class TorqueRipple(MotorEffect):
    """u · (1 + depth · s(pq)): a harmonic of the electrical angle, two of them, or the trapezoid of six-step drive."""

    depth: float
    harmonic: int
    phase: float

    cause = "torque-ripple"
    known = Forms({
        "single": lambda x, phase: cos(x),
        "two": lambda x, phase: 0.8 * cos(x) + 0.5 * cos(2.0 * x - phase),
    })  # fmt: skip
    foreign = Forms({"six-step": lambda x, phase: 4.0 * abs((x / (2.0 * pi)) % 1.0 - 0.5) - 1.0})
    stage = 6
    told = ("depth", "harmonic")

    @staticmethod
    def first_guess(rng, context, form):
        order = 6 if form == "six-step" else int(rng.choice([1, 2, 6]))
        return 1.4 * context.share, context.motor.poles // 2 * order, rng.uniform(-pi, pi)

    def formula(self, u, q, state):
        return u * (1.0 + self.depth * self.shape(self.harmonic * q + self.phase, self.phase))


class TorqueGain(MotorEffect):
    """u · (1 + g): the same both ways, or only in one direction of torque."""

    gain: float
    side: float

    cause = "torque-gain"
    known = ("constant",)
    foreign = ("by-sign",)
    stage = 5
    within = (-0.6, inf)

    @staticmethod
    def first_guess(rng, context, form):
        return draw_sign(rng) * context.share, context.lean

    def formula(self, u, q, state):
        both = self.form == "constant"
        return u * (1.0 + self.gain) if both or self.side * u > 0.0 else u


class TorqueBias(MotorEffect):
    """u + bias."""

    bias: float

    cause = "torque-bias"
    known = ("constant",)
    stage = 7

    @staticmethod
    def first_guess(rng, context, form):
        return (draw_sign(rng) * context.target,)

    def formula(self, u, q, state):
        return u + self.bias


# outside the published causes


class VoltageLimit(MotorEffect):
    """At speed the supply runs out: stall (1 - v/v₀) bounds the torque along v, stall (1 + v/v₀) against it."""

    no_load_speed: float
    stall: float

    cause = "voltage-limit"
    foreign = ("hard", "sagging-supply")
    kin = ("saturation",)
    stage = 2

    @staticmethod
    def first_guess(rng, context, form):
        return 4.0 * context.speed, context.torque * (2.5 - 2.0 * sqrt(context.share))

    def scaled(self, k):
        return replace(self, stall=self.stall / k**0.3, no_load_speed=self.no_load_speed / k**0.15)

    def start(self, world):
        dof = world.dof[self.joint]
        stall = self.stall
        sagging = self.form == "sagging-supply"
        supply = 1.0

        def limit(u, q, state):
            nonlocal supply
            if sagging:
                supply += state.dt / 0.5 * (1.15 - 0.3 * min(abs(u) / stall, 1.0) - supply)
            speed = state.v[dof] / self.no_load_speed
            return min(max(u, -stall * max(supply + speed, 0.0)), stall * max(supply - speed, 0.0))

        return limit


class HotMotor(MotorEffect):
    """The torque constant falls as the magnets warm: heat follows u², gain 1 - loss · heat (or loss · √heat)."""

    loss: float
    time_constant: float
    reference_power: float

    cause = "hot-motor"
    foreign = Forms({"linear": float, "root": sqrt})
    kin = ("torque-gain",)
    stage = 5
    within = (-inf, 0.6)

    @staticmethod
    def first_guess(rng, context, form):
        return 1.5 * context.share, context.motor.warm_up, context.torque**2

    def start(self, world):
        rate = world.dt / self.time_constant
        heat = 0.0

        def lose(u, q, state):
            nonlocal heat
            heat += rate * (u**2 / self.reference_power - heat)
            return u * (1.0 - self.loss * min(self.shape(heat), 1.4))

        return lose


class CrossTalk(MotorEffect):
    """Stray field: another axis's torque leaks in as c · u_other · cos(k q), or as c · |u_other|."""

    leak: float
    other: int
    harmonic: int

    cause = "cross-axis-coupling"
    foreign = ("angle-dependent", "rectified")
    kin = ("torque-ripple",)
    stage = 8
    needs_axes = 2

    @staticmethod
    def first_guess(rng, context, form):
        others = [i for i in range(len(context.rig.links)) if i != context.joint]
        return 1.4 * context.share, int(rng.choice(others)), int(rng.integers(2, 8))

    def formula(self, u, q, state):
        stray = state.command[self.other]
        rectified = self.form == "rectified"
        return u + self.leak * (abs(stray) if rectified else stray * cos(self.harmonic * q))


class TorqueSteps(MotorEffect):
    """The drive knows only so many torques: rounded to steps, or rounded with hysteresis."""

    step: float

    cause = "torque-steps"
    foreign = Forms({"rounded": 0.5, "hysteresis": 0.75})
    kin = ("dead-zone",)
    stage = 1

    @staticmethod
    def first_guess(rng, context, form):
        return (3.4 * context.target,)

    def start(self, world):
        slack = self.shape * self.step
        level = 0.0

        def round_off(u, q, state):
            nonlocal level
            if abs(u - level) > slack:
                level = self.step * round(u / self.step)
            return level

        return round_off


class Dropouts(MotorEffect):
    """Now and then the drive loses a part of its torque, or all, for some tens of milliseconds or just for a few."""

    loss: float
    per_second: float
    seed: int

    cause = "dropouts"
    foreign = ("dips", "stutter")
    kin = ("outliers",)
    stage = 2
    within = (-inf, 1.0)

    @staticmethod
    def first_guess(rng, context, form):
        per_second = (1.0 if form == "dips" else 8.0) * max(0.5, 60.0 * context.share**2)
        return min(8.0 * context.share, 1.0), per_second, int(rng.integers(2**31))

    def start(self, world):
        rng = np.random.default_rng(self.seed)
        count = max(2, round(self.per_second * world.seconds))
        starts = np.sort(rng.uniform(0.0, world.seconds, count))
        ends = starts + rng.uniform(0.01, 0.04, count) * (1.0 if self.form == "dips" else 0.125)
        windows = iter([*zip(starts.tolist(), ends.tolist()), (inf, inf)])
        start, end = next(windows)

        def drop(u, q, state):
            nonlocal start, end
            while state.t >= end:
                start, end = next(windows)
            return u * (1.0 - self.loss) if state.t >= start else u

        return drop


class SupplyHum(MotorEffect):
    """The supply's ripple rides on the torque: u · depth · sin(2π f t), or depth · limit · sin, f fixed in time."""

    depth: float
    hertz: float

    cause = "supply-hum"
    foreign = ("multiplied", "added")
    kin = ("torque-ripple",)
    stage = 8

    @staticmethod
    def first_guess(rng, context, form):
        depth = 1.4 * (context.share if form == "multiplied" else context.target)
        return depth, rng.uniform(3.0, 15.0)

    def formula(self, u, q, state):
        wave = self.depth * cos(2.0 * pi * self.hertz * state.t)
        return u + (wave if self.form == "added" else wave * u)
