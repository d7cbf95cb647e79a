"""What gives between motor and link, and what pulls across the joint: cable, flexibility, backlash, armature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sinh

import numpy as np

from ..mjcf import Appendage, Hinge
from ..rigs import Inertia
from .base import Effect, oppose


@dataclass(frozen=True)
class CableSpring(Effect):
    """-k x - k₃ x³, x = q - rest; or a stop that stiffens exponentially, or a cable that is slack for a while."""

    stiffness: float
    cubic: float
    rest: float
    width: float

    cause = "cable-spring"
    known = ("linear", "cubic")
    foreign = ("exponential", "slack")

    @classmethod
    def draw(cls, rng, context, form):
        width = context.width
        cubic = 2.0 * context.target / width**3 if form == "cubic" else 0.0
        stiffness = (0.5 if cubic else 1.0) * (2.0 * context.target / width)
        low, high = context.span
        rest = float(low + (high - low) * rng.uniform(0.25, 0.75))
        return cls(context.joint, form, stiffness, cubic, rest, width)

    def scaled(self, k):
        return replace(self, stiffness=k * self.stiffness, cubic=k * self.cubic)

    def parameters(self):
        more = {"cubic": self.cubic} if self.form == "cubic" else {}
        return {"stiffness": self.stiffness, "rest": self.rest, **more}

    def force(self, world):
        dof = world.link_dof[self.own]
        k = self.stiffness
        slack = 0.3 * self.width
        steep = 3.0 / self.width
        pull = {
            "linear": lambda x: k * x,
            "cubic": lambda x: k * x + self.cubic * x**3,
            "exponential": lambda x: 0.3 * k / steep * sinh(min(max(steep * x, -8.0), 8.0)),
            "slack": lambda x: k * (max(x - slack, 0.0) + min(x + slack, 0.0)),
        }[self.form]
        return oppose(dof, lambda state: pull(state.q[dof] - self.rest))


@dataclass(frozen=True)
class TwoMasses(Effect):
    """A rotor on the joint's axis, joined to its link by something that gives; motor, bearing, encoder on the rotor."""

    rotor: float
    link: float

    stiff = True
    in_band = True
    widest = 300.0

    def appendages(self, rig):
        link = rig.links[self.own]
        hinge = Hinge("rotor", "hinge", link.axis)
        tensor = self.rotor * (0.55 * np.eye(3) + 0.45 * np.outer(link.axis, link.axis))
        inertia = Inertia(0.05 * link.inertia.mass, np.zeros(3), tensor)
        place = (link.position, (hinge,), inertia, link.rotation)
        return (Appendage("rotor", self.own - 1, *place),)

    def frozen(self, rig):
        (rotor,) = self.appendages(rig)
        return rig.with_body(self.own, rotor.inertia)

    def prepare(self, world):
        world.dof[self.own] = world.named("rotor")

    @property
    def reduced(self):
        """J_r J_l / (J_r + J_l): what swings against the spring, kg m²."""
        return self.rotor * self.link / (self.rotor + self.link)

    def couple(self, world, pull):
        """Return the law of a torque between rotor and link, by their twist and its rate."""
        rotor = world.dof[self.own]
        link = world.link_dof[self.own]

        def law(state):
            torque = pull(state.q[rotor] - state.q[link], state.v[rotor] - state.v[link])
            state.force[rotor] -= torque
            state.force[link] += torque

        return law


@dataclass(frozen=True)
class JointFlexibility(TwoMasses):
    """Two masses and a spring: linear, or one that hardens with its twist."""

    stiffness: float
    damping_ratio: float

    cause = "joint-flexibility"
    known = ("linear",)
    foreign = ("hardening",)

    @classmethod
    def draw(cls, rng, context, form):
        rotor = context.inertia * rng.uniform(0.1, 0.5)
        effect = cls(context.joint, form, rotor, context.inertia, 1.0, rng.uniform(0.02, 0.1))
        omega = 2.0 * pi * float(np.clip(9.0 / np.sqrt(context.share), 6.0, 150.0))
        return replace(effect, stiffness=effect.reduced * omega**2)

    def scaled(self, k):
        softest, hardest = (self.reduced * (2.0 * pi * f) ** 2 for f in (5.0, 180.0))
        return replace(self, stiffness=min(max(self.stiffness / k, softest), hardest))

    def parameters(self):
        hertz = float(np.sqrt(self.stiffness / self.reduced)) / (2.0 * pi)
        return {"stiffness": self.stiffness, "rotor_inertia": self.rotor, "resonance_hz": hertz}

    def force(self, world):
        k = self.stiffness
        damping = 2.0 * self.damping_ratio * float(np.sqrt(k * self.reduced))
        scale = 0.5 * world.rig.motors[self.own].tau_max / k
        pull = {
            "linear": lambda x, rate: k * x + damping * rate,
            "hardening": lambda x, rate: 0.7 * k * x * (1.0 + (x / scale) ** 2) + damping * rate,
        }[self.form]
        return self.couple(world, pull)


@dataclass(frozen=True)
class Backlash(TwoMasses):
    """A gap between rotor and link, with stiff damped flanks: linear, or Hertzian (power 3/2)."""

    gap: float

    cause = "backlash"
    known = ("linear-flanks",)
    foreign = ("hertz-flanks",)

    @classmethod
    def draw(cls, rng, context, form):
        rotor = context.inertia * rng.uniform(0.15, 0.5)
        gap = float(np.clip(0.5 * context.share**2, 2e-4, 0.02))
        return cls(context.joint, form, rotor, context.inertia, gap)

    def scaled(self, k):
        return replace(self, gap=min(max(k * self.gap, 1e-4), 0.15))

    def parameters(self):
        return {"gap": self.gap, "rotor_inertia": self.rotor}

    def force(self, world):
        hertz, power = (250.0, 1.0) if self.form == "linear-flanks" else (130.0, 1.5)
        stiffness = self.reduced * (2.0 * pi * hertz) ** 2
        damping = 0.4 * float(np.sqrt(stiffness * self.reduced))
        soft = (0.1 * world.rig.motors[self.own].tau_max / stiffness) ** (1.0 - power)

        def pull(twist, rate):
            depth = abs(twist) - 0.5 * self.gap
            if depth <= 0.0:
                return 0.0
            side = 1.0 if twist > 0.0 else -1.0
            return side * max(stiffness * soft * depth**power + side * damping * rate, 0.0)

        return self.couple(world, pull)


@dataclass(frozen=True)
class Armature(Effect):
    """a q̈ on one joint: a geared rotor's reflected inertia."""

    inertia: float

    cause = "armature"
    known = ("reflected",)
    needs_axes = 2

    @classmethod
    def draw(cls, rng, context, form):
        return cls(context.joint, form, context.inertia * context.share)

    def plant(self, rig):
        values = list(rig.armature)
        values[self.own] += self.inertia
        return replace(rig, armature=tuple(values))
