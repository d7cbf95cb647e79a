"""Compliance between motor and link, and torques across the joint: cable, flexibility, gaps, rotors, wind, hands."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, pi, sinh

import numpy as np
from scipy.signal import lfilter

from ..mjcf import Appendage, Hinge
from ..rigs import Inertia, put
from .base import Effect, Forms, OpposingEffect

GUST_RATE = 200.0


class CableSpring(OpposingEffect):
    """-k x - k₃ x³, x = q - rest; or a stop that stiffens exponentially, or a cable that is slack for a while."""

    stiffness: float
    cubic: float
    rest: float
    width: float

    cause = "cable-spring"
    known = ("linear", "cubic")
    foreign = ("exponential", "slack")

    @staticmethod
    def first_guess(rng, context, form):
        width = context.width
        cubic = 2.0 * context.target / width**3 if form == "cubic" else 0.0
        stiffness = (0.5 if cubic else 1.0) * (2.0 * context.target / width)
        low, high = context.span
        return stiffness, cubic, low + (high - low) * rng.uniform(0.25, 0.75), width

    def scaled(self, k):
        return replace(self, stiffness=k * self.stiffness, cubic=k * self.cubic)

    @property
    def told(self):
        """Its parameters; a straight spring has no cubic one."""
        return ("stiffness", "rest", "cubic") if self.form == "cubic" else ("stiffness", "rest")

    def formula(self, q, v, state):
        x = q - self.rest
        k = self.stiffness
        if self.form == "slack":
            slack = 0.3 * self.width
            return k * (max(x - slack, 0.0) + min(x + slack, 0.0))
        if self.form == "exponential":
            steep = 3.0 / self.width
            return 0.3 * k / steep * sinh(min(max(steep * x, -8.0), 8.0))
        return k * x + self.cubic * x**3


class TwoMasses(Effect):
    """A rotor on the joint's axis, joined to its link by something that gives; motor, bearing, encoder on the rotor."""

    rotor_inertia: float
    link: float

    stiff = True
    in_band = True
    widest = 300.0

    def appendages(self, rig):
        link = rig.links[self.joint]
        hinge = Hinge("rotor", "hinge", link.axis)
        tensor = self.rotor_inertia * (0.55 * np.eye(3) + 0.45 * np.outer(link.axis, link.axis))
        inertia = Inertia(0.05 * link.inertia.mass, np.zeros(3), tensor)
        place = (link.position, (hinge,), inertia, link.rotation)
        return (Appendage("rotor", self.joint - 1, *place),)

    def frozen(self, rig):
        (rotor,) = self.appendages(rig)
        return rig.with_body(self.joint, rotor.inertia)

    def prepare(self, world):
        world.dof[self.joint] = world.named("rotor")

    @property
    def reduced(self):
        """J_r J_l / (J_r + J_l): what swings against the spring, kg m²."""
        return self.rotor_inertia * self.link / (self.rotor_inertia + self.link)

    def start(self, world):
        """Return the torque between rotor and link by their twist and its rate."""
        raise NotImplementedError

    def force(self, world):
        rotor = world.dof[self.joint]
        link = world.link_dof[self.joint]
        pull = self.start(world)

        def law(state):
            torque = pull(state.q[rotor] - state.q[link], state.v[rotor] - state.v[link])
            state.force[rotor] -= torque
            state.force[link] += torque

        return law


class JointFlexibility(TwoMasses):
    """Two masses and a spring: linear, or one that hardens with its twist."""

    stiffness: float
    damping_ratio: float

    cause = "joint-flexibility"
    known = ("linear",)
    foreign = ("hardening",)
    told = ("stiffness", "rotor_inertia", "resonance_hz")

    @classmethod
    def draw(cls, rng, context, form):
        rotor = context.inertia * rng.uniform(0.1, 0.5)
        effect = cls(context.joint, form, rotor, context.inertia, 1.0, rng.uniform(0.02, 0.1))
        omega = 2.0 * pi * float(np.clip(9.0 / np.sqrt(context.share), 6.0, 150.0))
        return replace(effect, stiffness=effect.reduced * omega**2)

    def scaled(self, k):
        softest, hardest = (self.reduced * (2.0 * pi * f) ** 2 for f in (5.0, 180.0))
        return replace(self, stiffness=min(max(self.stiffness / k, softest), hardest))

    @property
    def resonance_hz(self):
        """Where the two masses swing against each other, Hz."""
        return float(np.sqrt(self.stiffness / self.reduced)) / (2.0 * pi)

    def start(self, world):
        k = self.stiffness
        damping = 2.0 * self.damping_ratio * float(np.sqrt(k * self.reduced))
        scale = 0.5 * world.rig.motors[self.joint].tau_max / k
        return {
            "linear": lambda x, rate: k * x + damping * rate,
            "hardening": lambda x, rate: 0.7 * k * x * (1.0 + (x / scale) ** 2) + damping * rate,
        }[self.form]


class Backlash(TwoMasses):
    """A gap between rotor and link, with stiff damped flanks: linear, or Hertzian (power 3/2)."""

    gap: float

    cause = "backlash"
    known = Forms({"linear-flanks": (250.0, 1.0)})
    foreign = Forms({"hertz-flanks": (130.0, 1.5)})
    told = ("gap", "rotor_inertia")
    grows = "gap"
    within = (1e-4, 0.15)

    @staticmethod
    def first_guess(rng, context, form):
        rotor = context.inertia * rng.uniform(0.15, 0.5)
        return rotor, context.inertia, float(np.clip(0.5 * context.share**2, 2e-4, 0.02))

    def start(self, world):
        hertz, power = self.shape
        stiffness = self.reduced * (2.0 * pi * hertz) ** 2
        damping = 0.4 * float(np.sqrt(stiffness * self.reduced))
        soft = (0.1 * world.rig.motors[self.joint].tau_max / stiffness) ** (1.0 - power)

        def pull(twist, rate):
            depth = abs(twist) - 0.5 * self.gap
            if depth <= 0.0:
                return 0.0
            side = 1.0 if twist > 0.0 else -1.0
            return side * max(stiffness * soft * depth**power + side * damping * rate, 0.0)

        return pull


class Armature(Effect):
    """a q̈ on one joint: a geared rotor's reflected inertia."""

    inertia: float

    cause = "armature"
    known = ("reflected",)
    needs_axes = 2

    @staticmethod
    def first_guess(rng, context, form):
        return (context.inertia * context.share,)

    def plant(self, rig):
        more = rig.armature[self.joint] + self.inertia
        return replace(rig, armature=put(rig.armature, self.joint, more))


# outside the published causes


class Wind(OpposingEffect):
    """Gusts: a coloured torque with a corner at `hertz`; steady in strength, or in squalls."""

    strength: float
    hertz: float
    seed: int

    cause = "wind"
    foreign = ("steady", "squalls")

    @staticmethod
    def first_guess(rng, context, form):
        return context.target, rng.uniform(0.3, 4.0), int(rng.integers(2**31))

    def _gusts(self, seconds):
        """Two first-order filters in a row over white noise, unit rms, GUST_RATE a second."""
        rng = np.random.default_rng(self.seed)
        count = int(seconds * GUST_RATE) + 3
        keep = exp(-2.0 * pi * self.hertz / GUST_RATE)
        low_pass = [1.0 - keep], [1.0, -keep]
        path = lfilter(*low_pass, lfilter(*low_pass, rng.normal(size=count)))
        if self.form == "squalls":
            path *= np.maximum(np.sin(2.0 * pi * np.arange(count) / GUST_RATE / 7.0), 0.0)
        return (self.strength * path / np.sqrt(np.mean(path**2))).tolist()

    def start(self, world):
        gusts = self._gusts(world.seconds)

        def blow(q, v, state):
            x = state.t * GUST_RATE
            i = int(x)
            return -(gusts[i] + (x - i) * (gusts[i + 1] - gusts[i]))

        return blow


class Touch(OpposingEffect):
    """A hand that now and then pushes for a moment: raised cosines at random times."""

    push: float
    seed: int

    cause = "human-touch"
    foreign = ("pushes",)
    kin = ("outliers",)

    @staticmethod
    def first_guess(rng, context, form):
        return 5.0 * context.target, int(rng.integers(2**31))

    def start(self, world):
        rng = np.random.default_rng(self.seed)
        count = max(2, int(world.seconds / 6.0))
        starts = np.sort(rng.uniform(0.03, 0.95, count) * world.seconds)
        lengths = rng.uniform(0.15, 0.9, count)
        sizes = self.push * rng.normal(size=count)
        pushes = np.column_stack([starts, lengths, sizes]).tolist()

        def touch(q, v, state):
            torque = 0.0
            for start, length, size in pushes:
                if start <= state.t < start + length:
                    torque += 0.5 * size * (1.0 - cos(2.0 * pi * (state.t - start) / length))
            return torque

        return touch
