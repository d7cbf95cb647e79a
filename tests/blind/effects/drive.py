"""What drive and motor do between command and torque: lags, losses, ripple, gain and bias."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from math import copysign, cos, exp, inf, lcm, pi, sin, sqrt, tanh

from ..draws import draw_sign
from .base import Effect, change_torque, oppose


@dataclass(frozen=True)
class ActuatorLag(Effect):
    """The torque follows its command as a first- or a second-order lag; each step applies the mean over the step."""

    time_constant: float
    damping: float

    cause = "actuator-lag"
    known = ("first-order",)
    foreign = ("second-order",)
    stage = 4
    widest = 60.0
    within = (-inf, 0.025)

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, 0.05 * context.share + 1e-4, rng.uniform(0.7, 1.1))

    def drive(self, world):
        return self._first(world.dt) if self.form == "first-order" else self._second(world.dt)

    def _first(self, dt):
        x = dt / self.time_constant
        keep = exp(-x)
        mean = (1.0 - keep) / x
        y = 0.0

        def follow(state, u):
            nonlocal y
            before = y
            y = u + (before - u) * keep
            return u + (before - u) * mean

        return change_torque(self.own, follow)

    def _second(self, dt):
        """ÿ = ω²(u - y) - 2 ζ ω ẏ, ω = 2 / time constant; substeps keep the implicit rule accurate."""
        omega = 2.0 / self.time_constant
        zeta = self.damping
        pieces = max(1, int(4.0 * omega * dt) + 1)
        h = dt / pieces
        scale = 1.0 + zeta * omega * h + 0.25 * (omega * h) ** 2
        y = rate = 0.0

        def follow(state, u):
            nonlocal y, rate
            total = 0.0
            for _ in range(pieces):
                push = omega * omega * (u - y) - 2.0 * zeta * omega * rate
                step = h * (push - 0.5 * h * omega * omega * rate) / scale
                total += y + 0.5 * h * (rate + 0.5 * step)
                y = y + h * (rate + 0.5 * step)
                rate = rate + step
            return total / pieces

        return change_torque(self.own, follow)


@dataclass(frozen=True)
class Delay(Effect):
    """u(t - d), exact for fractions of a step; or with a d that wanders slowly about its mean."""

    delay: float
    wander: float

    cause = "delay"
    known = ("fixed",)
    foreign = ("wandering",)
    stage = 3
    widest = 60.0
    within = (-inf, 0.025)

    @classmethod
    def draw(cls, rng, context, form):
        wander = 0.35 if form == "wandering" else 0.0
        return cls(context.joint, form, 0.05 * context.share + 1e-4, wander)

    def drive(self, world):
        length = int(self.delay * (1.0 + self.wander) / world.dt) + 3
        past = deque([0.0] * length, maxlen=length)

        def follow(state, u):
            past.appendleft(u)
            slow = (state.t * 0.37) % 2.0 - 1.0
            steps = self.delay * (1.0 + self.wander * (2.0 * abs(slow) - 1.0)) / world.dt
            whole = int(steps)
            return past[whole] + (steps - whole) * (past[whole + 1] - past[whole])

        return change_torque(self.own, follow)


@dataclass(frozen=True)
class Saturation(Effect):
    """|u| ≤ limit: a hard clip, a smooth one (limit · tanh), or one that is lower in one direction."""

    limit: float

    cause = "saturation"
    known = ("hard",)
    foreign = ("smooth", "one-sided")
    stage = 2

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, context.torque * (2.2 - 1.5 * sqrt(context.share)))

    def scaled(self, k):
        return replace(self, limit=self.limit / k**0.3)

    def drive(self, world):
        limit = self.limit
        shapes = {
            "hard": lambda state, u: min(max(u, -limit), limit),
            "smooth": lambda state, u: limit * tanh(u / limit),
            "one-sided": lambda state, u: min(max(u, -2.0 * limit), limit),
        }
        return change_torque(self.own, shapes[self.form])


@dataclass(frozen=True)
class DeadZone(Effect):
    """Small torques are lost: u less the width, nothing below the width, or a soft loss around zero."""

    width: float

    cause = "dead-zone"
    known = ("gap",)
    foreign = ("threshold", "soft")
    stage = 1

    @classmethod
    def draw(cls, rng, context, form):
        soft = context.torque * sqrt(context.share)
        return cls(context.joint, form, 1.2 * context.target if form == "gap" else soft)

    def scaled(self, k):
        return replace(self, width=k * self.width if self.form == "gap" else k**0.6 * self.width)

    def drive(self, world):
        width = self.width
        shapes = {
            "gap": lambda state, u: copysign(max(abs(u) - width, 0.0), u),
            "threshold": lambda state, u: u if abs(u) > width else 0.0,
            "soft": lambda state, u: u * (1.0 - exp(-((u / width) ** 2))),
        }
        return change_torque(self.own, shapes[self.form])


@dataclass(frozen=True)
class Cogging(Effect):
    """amplitude · Σ w cos(kq + φ): one harmonic, several, a steep-flanked one, or one whose height changes with q.

    `waves`: relative amplitude, harmonic of the mechanical angle and phase of each."""

    amplitude: float
    waves: tuple[tuple[float, int, float], ...]

    cause = "cogging"
    known = ("single", "several")
    foreign = ("steep", "modulated")

    @classmethod
    def draw(cls, rng, context, form):
        motor = context.rig.motors[context.joint]
        whole = lcm(motor.slots, motor.poles)
        harmonics = [rng.choice([whole, motor.slots, motor.poles, whole // 2])]
        if form == "several":
            others = [motor.slots, motor.poles, 2 * motor.slots, whole]
            harmonics += [*rng.choice(others, 2, replace=False)]
        weights = [1.0, *rng.uniform(0.2, 0.6, len(harmonics) - 1)]
        pairs = zip(weights, harmonics, strict=True)
        waves = tuple((float(w), int(k), rng.uniform(-pi, pi)) for w, k in pairs)
        return cls(context.joint, form, 1.4 * context.target, waves)

    def parameters(self):
        return {"amplitude": self.amplitude, "harmonic": float(self.waves[0][1])}

    def force(self, world):
        dof = world.dof[self.own]
        a = self.amplitude
        waves = self.waves
        (_, k, phase) = waves[0]

        def sum_waves(state):
            q = state.q[dof]
            return a * sum([w * cos(n * q + p) for w, n, p in waves])

        def bend(state):
            x = k * state.q[dof] + phase
            return a * cos(x + 0.45 * sin(x))

        def modulate(state):
            q = state.q[dof]
            return a * (1.0 + 0.5 * sin(1.37 * q + phase)) * cos(k * q + phase)

        return oppose(dof, {"steep": bend, "modulated": modulate}.get(self.form, sum_waves))


@dataclass(frozen=True)
class TorqueRipple(Effect):
    """u · (1 + depth · s(pq)): a harmonic of the electrical angle, two of them, or the trapezoid of six-step drive."""

    depth: float
    harmonic: int
    phase: float

    cause = "torque-ripple"
    known = ("single", "two")
    foreign = ("six-step",)
    stage = 6
    told = ("depth", "harmonic")

    @classmethod
    def draw(cls, rng, context, form):
        pairs = context.rig.motors[context.joint].poles // 2
        order = 6 if form == "six-step" else int(rng.choice([1, 2, 6]))
        return cls(context.joint, form, 1.4 * context.share, pairs * order, rng.uniform(-pi, pi))

    def drive(self, world):
        dof = world.dof[self.own]
        k = self.harmonic
        phase = self.phase
        wave = {
            "single": cos,
            "two": lambda x: 0.8 * cos(x) + 0.5 * cos(2.0 * x - phase),
            "six-step": lambda x: 4.0 * abs((x / (2.0 * pi)) % 1.0 - 0.5) - 1.0,
        }[self.form]
        return change_torque(
            self.own, lambda state, u: u * (1.0 + self.depth * wave(k * state.q[dof] + phase))
        )


@dataclass(frozen=True)
class TorqueGain(Effect):
    """u · (1 + g): the same both ways, or only in one direction of torque."""

    gain: float
    side: float

    cause = "torque-gain"
    known = ("constant",)
    foreign = ("by-sign",)
    stage = 5
    within = (-0.6, inf)

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, draw_sign(rng) * context.share, context.lean)

    def drive(self, world):
        gain = 1.0 + self.gain
        both = self.form == "constant"
        return change_torque(
            self.own, lambda state, u: u * gain if both or self.side * u > 0.0 else u
        )


@dataclass(frozen=True)
class TorqueBias(Effect):
    """u + bias."""

    bias: float

    cause = "torque-bias"
    known = ("constant",)
    stage = 7

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, draw_sign(rng) * context.target)

    def drive(self, world):
        return change_torque(self.own, lambda state, u: u + self.bias)
