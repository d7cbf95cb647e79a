"""Outside the published causes: masses that swing, slide, slosh or ring on the rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from ..mjcf import Appendage, Hinge
from ..rigs import Array, Inertia, Rig, point_mass
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World

Vector = tuple[float, float, float]


def _ball(mass: float, com: Array, radius: float) -> Inertia:
    return Inertia(mass, com, 0.4 * mass * radius**2 * np.eye(3))


def direction(rng: Generator) -> Vector:
    vector = rng.normal(size=3)
    return tuple((vector / np.linalg.norm(vector)).tolist())


def edge_of(rig: Rig) -> float:
    return float((rig.payload.inertia.mass / 700.0) ** (1.0 / 3.0))


@dataclass(frozen=True)
class Hanging(Effect):
    """A mass on one or two hinges or slides of its own, on the last link; `frozen` where a rigid model would put it."""

    mass: float
    place: Vector

    stiff = True
    in_band = True

    def _hangers(self, rig: Rig) -> tuple[Appendage, ...]:
        raise NotImplementedError

    def appendages(self, rig: Rig) -> tuple[Appendage, ...]:
        return self._hangers(rig)

    def frozen(self, rig: Rig) -> Rig:
        for item in self._hangers(rig):
            rig = rig.with_body(item.parent, item.inertia.seen_from(item.rotation, item.position))
        return rig


@dataclass(frozen=True)
class Slosh(Hanging):
    """Fluid in the payload: a pendulum with two hinges (or a mass on two sprung slides), lightly damped."""

    length: float
    damping_ratio: float

    cause = "slosh"
    foreign = ("pendulum", "sprung-slides")
    kin = ("payload-shift",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Slosh:
        place = tuple((0.3 * edge_of(context.rig) * rng.uniform(-1.0, 1.0, 3)).tolist())
        mass = 0.5 * context.share * context.rig.payload.inertia.mass
        return cls(None, form, mass, place, rng.uniform(0.02, 0.08), rng.uniform(0.03, 0.12))

    def _hangers(self, rig: Rig) -> tuple[Appendage, ...]:
        kind = "hinge" if self.form == "pendulum" else "slide"
        hinges = tuple(Hinge(f"slosh_{i}", kind, np.eye(3)[i]) for i in range(2))
        lever = self.length if self.form == "pendulum" else 0.0
        inertia = _ball(self.mass, np.array([0.0, 0.0, -lever]), 0.3 * self.length)
        return (Appendage("slosh", len(rig.links) - 1, np.array(self.place), hinges, inertia),)

    def frozen(self, rig: Rig) -> Rig:
        return rig.with_body(len(rig.links) - 1, point_mass(self.mass, np.array(self.place)))

    def force(self, world: World) -> Law:
        omega = (9.81 / self.length) ** 0.5
        inertia = self.mass * (self.length**2 if self.form == "pendulum" else 1.0)
        spring = 0.0 if self.form == "pendulum" else inertia * omega**2
        damper = 2.0 * self.damping_ratio * omega * inertia
        dofs = [world.named(f"slosh_{i}") for i in range(2)]

        def law(state: State) -> None:
            for dof in dofs:
                state.force[dof] -= spring * state.q[dof] + damper * state.v[dof]

        return law


@dataclass(frozen=True)
class Rattle(Hanging):
    """Something loose in the payload: a mass on a slide (or a hinge) that hits stops at both ends of its play."""

    direction: Vector
    play: float

    cause = "loose-payload"
    foreign = ("slide", "hinge")
    kin = ("backlash", "payload-shift")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> Rattle:
        edge = edge_of(context.rig)
        place = tuple((0.3 * edge * rng.uniform(-1.0, 1.0, 3)).tolist())
        mass = context.share * context.rig.payload.inertia.mass
        play = rng.uniform(0.003, 0.015) if form == "slide" else rng.uniform(0.1, 0.5)
        return cls(None, form, mass, place, direction(rng), play)

    def _hangers(self, rig: Rig) -> tuple[Appendage, ...]:
        axis = np.array(self.direction)
        arm = np.zeros(3) if self.form == "slide" else 0.3 * edge_of(rig) * np.roll(axis, 1)
        hinge = Hinge("rattle", self.form, axis)
        inertia = _ball(self.mass, arm, 0.1 * edge_of(rig))
        return (Appendage("rattle", len(rig.links) - 1, np.array(self.place), (hinge,), inertia),)

    def force(self, world: World) -> Law:
        dof = world.named("rattle")
        half = 0.5 * self.play
        size = self.mass if self.form == "slide" else self.mass * (0.3 * edge_of(world.rig)) ** 2
        omega = 2.0 * pi * 60.0
        spring = size * omega**2
        damper = 0.5 * size * omega
        rub = 0.5 * size

        def law(state: State) -> None:
            x = state.q[dof]
            v = state.v[dof]
            state.force[dof] -= rub * v
            depth = abs(x) - half
            if depth > 0.0:
                side = 1.0 if x > 0.0 else -1.0
                state.force[dof] -= side * max(spring * depth + side * damper * v, 0.0)

        return law


@dataclass(frozen=True)
class CableWhip(Hanging):
    """A cable that hangs from the first link: a double-hinged pendulum of its own length, well damped."""

    length: float

    cause = "cable-whip"
    foreign = ("pendulum",)
    kin = ("cable-spring",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> CableWhip:
        edge = edge_of(context.rig)
        angle = rng.uniform(-pi, pi)
        place = (0.8 * edge * float(np.cos(angle)), 0.8 * edge * float(np.sin(angle)), -0.3 * edge)
        mass = 0.3 * context.share * context.rig.payload.inertia.mass
        return cls(None, form, mass, place, rng.uniform(0.08, 0.3))

    def _hangers(self, rig: Rig) -> tuple[Appendage, ...]:
        hinges = tuple(Hinge(f"whip_{i}", "hinge", np.eye(3)[i]) for i in range(2))
        inertia = _ball(self.mass, np.array([0.0, 0.0, -self.length]), 0.2 * self.length)
        return (Appendage("whip", len(rig.links) - 1, np.array(self.place), hinges, inertia),)

    def frozen(self, rig: Rig) -> Rig:
        return rig.with_body(len(rig.links) - 1, point_mass(self.mass, np.array(self.place)))

    def force(self, world: World) -> Law:
        damper = 0.1 * self.mass * self.length**2 * (9.81 / self.length) ** 0.5
        dofs = [world.named(f"whip_{i}") for i in range(2)]

        def law(state: State) -> None:
            for dof in dofs:
                state.force[dof] -= damper * state.v[dof]

        return law


@dataclass(frozen=True)
class MountResonance(Hanging):
    """A part of the payload (a lens, a screen) on a springy mount of its own, 12–35 Hz."""

    direction: Vector
    hertz: float
    damping_ratio: float

    cause = "mount-resonance"
    foreign = ("turning", "shifting")
    kin = ("joint-flexibility",)
    widest = 100.0
    told = ("mass", "hertz")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> MountResonance:
        edge = edge_of(context.rig)
        place = tuple((0.5 * edge * rng.uniform(-1.0, 1.0, 3)).tolist())
        mass = context.rig.payload.inertia.mass * min(3.0 * context.share + 0.03, 0.5)
        return cls(
            None,
            form,
            mass,
            place,
            direction(rng),
            rng.uniform(12.0, 35.0),
            rng.uniform(0.02, 0.08),
        )

    def scaled(self, k: float) -> MountResonance:
        return replace(
            self,
            mass=min(k, 3.0) * self.mass,
            hertz=max(self.hertz / max(k / 3.0, 1.0) ** 0.5, 4.0),
        )

    def _size(self, rig: Rig) -> float:
        return self.mass * (0.5 * edge_of(rig)) ** 2 if self.form == "turning" else self.mass

    def _hangers(self, rig: Rig) -> tuple[Appendage, ...]:
        hinge = Hinge(
            "mount", "hinge" if self.form == "turning" else "slide", np.array(self.direction)
        )
        inertia = _ball(self.mass, np.zeros(3), 0.5 * edge_of(rig) / 0.4**0.5)
        return (Appendage("mount", len(rig.links) - 1, np.array(self.place), (hinge,), inertia),)

    def force(self, world: World) -> Law:
        dof = world.named("mount")
        size = self._size(world.rig)
        omega = 2.0 * pi * self.hertz
        spring = size * omega**2
        damper = 2.0 * self.damping_ratio * size * omega

        def law(state: State) -> None:
            state.force[dof] -= spring * state.q[dof] + damper * state.v[dof]

        return law
