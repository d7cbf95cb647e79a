"""What gives between motor and link, and what pulls across the joint: cable, flexibility, backlash, armature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sinh
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from ..mjcf import Appendage, Hinge
from ..rigs import Inertia, Rig
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World


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
    def draw(cls, rng: Generator, context: Context, form: str) -> CableSpring:
        width = context.width
        stiffness = 2.0 * context.target / context.width
        cubic = 2.0 * context.target / width**3 if form == "cubic" else 0.0
        return cls(
            context.joint,
            form,
            0.5 * stiffness if cubic else stiffness,
            cubic,
            context.place(rng),
            width,
        )

    def scaled(self, k: float) -> CableSpring:
        return replace(self, stiffness=k * self.stiffness, cubic=k * self.cubic)

    def parameters(self) -> dict[str, float]:
        more = {"cubic": self.cubic} if self.form == "cubic" else {}
        return {"stiffness": self.stiffness, "rest": self.rest, **more}

    def force(self, world: World) -> Law:
        dof = world.link_dof[self.own]
        k = self.stiffness
        cubic = self.cubic
        rest = self.rest
        width = self.width
        slack = 0.3 * width
        steep = 3.0 / width
        pulls: dict[str, Callable[[float], float]] = {
            "linear": lambda x: k * x,
            "cubic": lambda x: k * x + cubic * x**3,
            "exponential": lambda x: 0.3 * k / steep * sinh(min(max(steep * x, -8.0), 8.0)),
            "slack": lambda x: k * (max(x - slack, 0.0) + min(x + slack, 0.0)),
        }
        pull = pulls[self.form]

        def law(state: State) -> None:
            state.force[dof] -= pull(state.q[dof] - rest)

        return law


@dataclass(frozen=True)
class TwoMasses(Effect):
    """A rotor on the joint's axis, joined to its link by something that gives; motor, bearing, encoder on the rotor."""

    rotor: float
    link: float

    stiff = True
    in_band = True

    def _rotor_name(self) -> str:
        return f"rotor_{self.own}"

    def _rotor_inertia(self, rig: Rig) -> Inertia:
        axis = rig.links[self.own].axis
        tensor = self.rotor * (0.55 * np.eye(3) + 0.45 * np.outer(axis, axis))
        return Inertia(0.05 * rig.links[self.own].inertia.mass, np.zeros(3), tensor)

    def appendages(self, rig: Rig) -> tuple[Appendage, ...]:
        link = rig.links[self.own]
        hinge = Hinge(self._rotor_name(), "hinge", link.axis)
        inertia = self._rotor_inertia(rig)
        return (
            Appendage(hinge.name, self.own - 1, link.position, (hinge,), inertia, link.rotation),
        )

    def frozen(self, rig: Rig) -> Rig:
        return rig.with_body(self.own, self._rotor_inertia(rig))

    def prepare(self, world: World) -> None:
        world.dof[self.own] = world.named(self._rotor_name())

    @property
    def reduced(self) -> float:
        """J_r J_l / (J_r + J_l): what swings against the spring, kg m²."""
        return self.rotor * self.link / (self.rotor + self.link)

    def _coupling(self, world: World, pull: Callable[[float, float], float]) -> Law:
        rotor = world.dof[self.own]
        link = world.link_dof[self.own]

        def law(state: State) -> None:
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
    widest = 300.0

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> JointFlexibility:
        rotor = context.inertia * rng.uniform(0.1, 0.5)
        effect = cls(context.joint, form, rotor, context.inertia, 1.0, rng.uniform(0.02, 0.1))
        omega = 2.0 * pi * float(np.clip(9.0 / np.sqrt(context.share), 6.0, 150.0))
        return replace(effect, stiffness=effect.reduced * omega**2)

    def scaled(self, k: float) -> JointFlexibility:
        softest, hardest = (self.reduced * (2.0 * pi * f) ** 2 for f in (5.0, 180.0))
        return replace(self, stiffness=min(max(self.stiffness / k, softest), hardest))

    def parameters(self) -> dict[str, float]:
        hertz = float(np.sqrt(self.stiffness / self.reduced)) / (2.0 * pi)
        return {"stiffness": self.stiffness, "rotor_inertia": self.rotor, "resonance_hz": hertz}

    def force(self, world: World) -> Law:
        k = self.stiffness
        damping = 2.0 * self.damping_ratio * float(np.sqrt(k * self.reduced))
        if self.form == "linear":
            return self._coupling(world, lambda twist, rate: k * twist + damping * rate)
        scale = 0.5 * world.rig.motors[self.own].tau_max / k
        return self._coupling(
            world, lambda x, rate: 0.7 * k * x * (1.0 + (x / scale) ** 2) + damping * rate
        )


@dataclass(frozen=True)
class Backlash(TwoMasses):
    """A gap between rotor and link, with stiff damped flanks: linear, or Hertzian (power 3/2)."""

    gap: float

    cause = "backlash"
    known = ("linear-flanks",)
    foreign = ("hertz-flanks",)
    widest = 300.0

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Backlash:
        rotor = context.inertia * rng.uniform(0.15, 0.5)
        return cls(
            context.joint,
            form,
            rotor,
            context.inertia,
            float(np.clip(0.5 * context.share**2, 2e-4, 0.02)),
        )

    def scaled(self, k: float) -> Backlash:
        return replace(self, gap=min(max(k * self.gap, 1e-4), 0.15))

    def parameters(self) -> dict[str, float]:
        return {"gap": self.gap, "rotor_inertia": self.rotor}

    def force(self, world: World) -> Law:
        half = 0.5 * self.gap
        hertz, power = (250.0, 1.0) if self.form == "linear-flanks" else (130.0, 1.5)
        stiffness = self.reduced * (2.0 * pi * hertz) ** 2
        damping = 0.4 * float(np.sqrt(stiffness * self.reduced))
        soft = (0.1 * world.rig.motors[self.own].tau_max / stiffness) ** (1.0 - power)

        def pull(twist: float, rate: float) -> float:
            depth = abs(twist) - half
            if depth <= 0.0:
                return 0.0
            side = 1.0 if twist > 0.0 else -1.0
            return side * max(stiffness * soft * depth**power + side * damping * rate, 0.0)

        return self._coupling(world, pull)


@dataclass(frozen=True)
class Armature(Effect):
    """a q̈ on one joint: a geared rotor's reflected inertia."""

    inertia: float

    cause = "armature"
    known = ("reflected",)
    needs_axes = 2

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Armature:
        return cls(context.joint, form, context.inertia * context.share)

    def plant(self, rig: Rig) -> Rig:
        values = list(rig.armature)
        values[self.own] += self.inertia
        return replace(rig, armature=tuple(values))
