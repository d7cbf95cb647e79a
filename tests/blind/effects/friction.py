"""Friction: at low speed, by direction, load, place, time and speed, and with a stroke before it slides."""

from __future__ import annotations

from dataclasses import replace
from math import copysign, cos, exp, hypot, inf, pi, sqrt

from ..draws import draw_sign
from .base import Effect, Forms, OpposingEffect, RubbingEffect


class Stribeck(RubbingEffect):
    """extra · g(|v| / speed) on top of Coulomb, g falling from 1 to 0; breakaway at Coulomb + extra."""

    extra: float
    speed: float

    cause = "stribeck"
    known = Forms({"gaussian": lambda x: exp(-x * x)})
    foreign = Forms({"exponential": lambda x: exp(-x), "lorentzian": lambda x: 1.0 / (1.0 + x * x)})
    told = ("extra", "speed")

    @staticmethod
    def first_guess(rng, context, form):
        return 1.5 * context.target, context.speed * rng.uniform(0.08, 0.35)

    def formula(self, q, v, state):
        return self.extra * self.shape(abs(v) / self.speed)


class AsymmetricFriction(OpposingEffect, RubbingEffect):
    """Coulomb ± difference/2, or viscous ± difference/2, by direction of motion."""

    difference: float

    cause = "asymmetric-friction"
    known = Forms({"coulomb": lambda half, v: half, "viscous": lambda half, v: half * v})
    foreign = Forms({"saturating": lambda half, v: half * v / (0.5 + v)})
    on_link = False
    backward = -1.0

    @staticmethod
    def first_guess(rng, context, form):
        size = 2.0 * context.target * draw_sign(rng)
        return (size / context.speed if form == "viscous" else size,)

    def parameters(self):
        return {f"{self.form}_difference": self.difference}

    def plant(self, rig):
        kind = "viscous" if self.form == "viscous" else "coulomb"
        return rig.with_motor(self.joint, **{kind: 0.6 * abs(self.difference)})

    frozen = plant

    def formula(self, q, v, state):
        return self.shape(0.5 * self.difference, abs(v))

    def force(self, world):
        return super().force(world) if self.form == "viscous" else None

    def grip(self, world):
        return None if self.form == "viscous" else super().grip(world)


class LoadFriction(RubbingEffect):
    """μ · load on top of Coulomb; the load is the motor's torque, gravity's alone, or √(offset² + gravity²)."""

    ratio: float
    offset: float

    cause = "load-dependent-friction"
    known = Forms({"total": lambda u, gravity, offset: abs(u)})
    foreign = Forms({
        "gravity": lambda u, gravity, offset: abs(gravity),
        "bearing": lambda u, gravity, offset: hypot(offset, gravity + 0.5 * u) - offset,
    })  # fmt: skip

    @staticmethod
    def first_guess(rng, context, form):
        return context.share, 0.7 * context.torque

    def prepare(self, world):
        world.needs_gravity = world.needs_gravity or self.form != "total"

    def start(self, world):
        joint = self.joint
        dof = world.link_dof[joint]
        return lambda q, v, state: (
            self.ratio * self.shape(state.u[joint], state.gravity[dof], self.offset)
        )


class PlaceFriction(RubbingEffect):
    """Coulomb · (1 + s(q)): harmonics of the angle, or one wide stiff place per turn (von Mises)."""

    amplitude: float
    harmonic: int
    phase: float

    cause = "position-dependent-friction"
    known = Forms({
        "harmonic": lambda x, phase: cos(x + phase),
        "two-harmonics": lambda x, phase: 0.8 * cos(x + phase) + 0.4 * cos(2 * x - phase),
    })  # fmt: skip
    foreign = Forms({"von-mises": lambda x, phase: 2.0 * exp(2.0 * (cos(x + phase) - 1.0)) - 0.6})
    told = ("amplitude", "harmonic")

    @staticmethod
    def first_guess(rng, context, form):
        lowest = max(1, round(1.5 / context.width))
        harmonic = int(rng.integers(lowest, lowest + 4))
        return 1.5 * context.target, harmonic, rng.uniform(-pi, pi)

    def plant(self, rig):
        return rig.with_motor(self.joint, coulomb=1.4 * self.amplitude)

    frozen = plant

    def formula(self, q, v, state):
        return self.amplitude * self.shape(self.harmonic * q, self.phase)


class FrictionDrift(RubbingEffect):
    """Coulomb friction that changes over the run: with time, as a warm-up, or with the motor's own heat."""

    change: float
    time_constant: float
    reference_power: float

    cause = "friction-drift"
    known = ("linear",)
    foreign = ("warm-up", "thermal")
    told = ("change", "time_constant")

    @staticmethod
    def first_guess(rng, context, form):
        time_constant = context.seconds if form == "linear" else context.motor.warm_up
        change = 1.7 * float(rng.choice([-1.0, -1.0, 1.0])) * context.target
        return change, time_constant, context.torque**2

    def plant(self, rig):
        return rig.with_motor(self.joint, coulomb=1.3 * max(-self.change, 0.0))

    frozen = plant

    def start(self, world):
        joint = self.joint
        change = self.change
        tau = self.time_constant
        heat = 0.0

        def warm(q, v, state):
            nonlocal heat
            heat += state.dt / tau * (state.u[joint] ** 2 / self.reference_power - heat)
            return change * min(heat, 1.5)

        return {
            "linear": lambda q, v, state: change * state.t / tau,
            "warm-up": lambda q, v, state: change * (1.0 - exp(-state.t / tau)),
            "thermal": warm,
        }[self.form]


class Drag(OpposingEffect):
    """-c |v|ᵖ sign v, p = 2 or another power above one."""

    coefficient: float
    power: float

    cause = "quadratic-drag"
    known = ("quadratic",)
    foreign = ("power",)
    told = ("coefficient", "power")
    on_link = False

    @staticmethod
    def first_guess(rng, context, form):
        power = 2.0 if form == "quadratic" else float(rng.choice([1.7, 2.4, 2.8]))
        return 0.6 * context.target / context.speed**power, power

    def formula(self, q, v, state):
        return self.coefficient * v * abs(v) ** (self.power - 1.0)


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


class Presliding(Effect):
    """Dry friction that needs a stroke (rad) to build up (Dahl, LuGre, Maxwell-slip), in the place of true stick."""

    limit: float
    stroke: float
    inertia: float

    cause = "presliding"
    known = Forms({"dahl": lambda limit, stroke, damping: lugre(limit, stroke, 0.0, 0.0)})
    foreign = Forms({
        "lugre": lambda limit, stroke, damping: lugre(limit, stroke, damping, 0.2),
        "maxwell-slip": maxwell_slip,
    })  # fmt: skip
    stage = 9
    stiff = True
    widest = 300.0
    told = ("limit", "stroke")
    grows = "stroke"
    within = (5e-6, inf)

    @staticmethod
    def first_guess(rng, context, form):
        limit = max(context.motor.coulomb, 2.5 * context.target)
        stroke = 0.005 * min(context.share * context.torque / limit, 1.0) + 2e-4
        return limit, stroke, context.inertia

    def plant(self, rig):
        return rig.with_motor(self.joint, coulomb=self.limit)

    frozen = plant

    def grip(self, world):
        """Whatever limit other causes have set is handed to the bristles, as a share of their own."""
        joint = self.joint
        dof = world.dof[joint]
        damping = 0.6 * sqrt(self.limit / self.stroke * self.inertia)
        advance = self.shape(self.limit, self.stroke, damping)

        def law(state):
            pull = advance(state.v[dof], state.dt)
            side = state.plus if pull > 0.0 else state.minus
            strength = side[joint] / self.limit
            state.force[dof] -= strength * pull
            state.bristle[joint] = strength * pull
            state.plus[joint] = state.minus[joint] = 0.0

        return law


# outside the published causes


class BoucWen(OpposingEffect):
    """A cable with hysteresis: ż = v (1 - |z|ⁿ (β sign(v z) + 1 - β)) / stroke, torque -size · z."""

    size: float
    stroke: float
    beta: float

    cause = "hysteretic-cable"
    foreign = Forms({"round": float, "pinched": lambda z: z * abs(z) ** 0.7})
    kin = ("presliding", "cable-spring")

    @staticmethod
    def first_guess(rng, context, form):
        return 1.5 * context.target, rng.uniform(0.1, 0.5) * context.width, 0.6

    def start(self, world):
        beta = self.beta
        z = 0.0

        def pull(q, v, state):
            nonlocal z
            move = v * state.dt / self.stroke
            z += move * (1.0 - z * z * (beta * copysign(1.0, v * z) + 1.0 - beta))
            return self.size * self.shape(z)

        return pull


class FrictionSpots(RubbingEffect):
    """Dirt in the bearing: narrow places, strewn at random, where dry friction is much higher."""

    height: float
    spots: tuple[tuple[float, float, float], ...]

    cause = "friction-spots"
    foreign = ("bumps",)
    kin = ("position-dependent-friction",)

    @staticmethod
    def first_guess(rng, context, form):
        low, high = context.span
        places = rng.uniform(low, high, 5)
        widths = rng.uniform(0.01, 0.05, 5) * (high - low)
        heights = rng.uniform(0.3, 1.0, 5)
        return 4.0 * context.target, tuple(zip(places.tolist(), widths.tolist(), heights.tolist()))

    def formula(self, q, v, state):
        bumps = [h * exp(-(((q - place) / width) ** 2)) for place, width, h in self.spots]
        return self.height * sum(bumps)


class RubbingStop(OpposingEffect, RubbingEffect):
    """Near one end of travel something rubs and pushes back: a one-sided soft stop with friction of its own."""

    push: float
    edge: float
    width: float

    cause = "rubbing-stop"
    foreign = Forms({"soft": 2.0, "hard": 1.0})
    kin = ("cable-spring", "position-dependent-friction")

    @staticmethod
    def first_guess(rng, context, form):
        low, high = context.span
        width = 0.25 * (high - low)
        return 3.0 * context.target, high - width, width

    def formula(self, q, v, state):
        return self.push * (max(q - self.edge, 0.0) / self.width) ** self.shape

    def grip(self, world):
        return RubbingEffect.grip(replace(self, push=0.5 * self.push), world)


class StickyBrake(RubbingEffect):
    """A brake that drags for a while and lets go again: dry friction that comes and goes with time."""

    drag: float
    period: float

    cause = "dragging-brake"
    foreign = Forms({
        "on-off": lambda wave: float(wave > 0.3),
        "swelling": lambda wave: 0.5 * (1.0 + wave),
    })  # fmt: skip
    kin = ("friction-drift",)

    @staticmethod
    def first_guess(rng, context, form):
        return 1.5 * context.target, rng.uniform(2.0, 7.0)

    def formula(self, q, v, state):
        return self.drag * self.shape(cos(2.0 * pi * state.t / self.period))
