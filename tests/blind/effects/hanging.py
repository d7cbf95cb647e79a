"""Outside the published causes: masses that swing, slide, slosh, ring or spin on the rig."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin
from operator import mul

import numpy as np

from ..mjcf import Appendage, Hinge
from ..rigs import EYE, Inertia, cube_edge, point_mass
from .base import Effect, Forms

Vector = tuple[float, float, float]


def draw_direction(rng):
    """Draw a unit vector."""
    vector = rng.normal(size=3)
    return tuple((vector / np.linalg.norm(vector)).tolist())


def edge_of(rig):
    """Return the edge of a cube of the payload's mass, m."""
    return cube_edge(rig.payload.inertia.mass)


def _draw_place(rng, rig, reach):
    """Draw a place within `reach` edges of the payload's."""
    return tuple((reach * edge_of(rig) * rng.uniform(-1.0, 1.0, 3)).tolist())


class Hanging(Effect):
    """A ball on hinges or slides (its `shape`) of its own along some axes, on the last link; `frozen` where a rigid
    model would put it."""

    mass: float
    place: Vector

    on_joint = False
    stiff = True
    in_band = True

    def axes(self):
        """Return the directions of its degrees of freedom."""
        return [self.direction]

    def ball(self, rig):
        """Return its centre, seen from `place`, and its radius, m."""
        raise NotImplementedError

    def spring(self, rig):
        """Return spring and damper of each of its degrees of freedom."""
        raise NotImplementedError

    def appendages(self, rig):
        com, radius = self.ball(rig)
        inertia = Inertia(self.mass, np.array(com), 0.4 * self.mass * radius**2 * EYE)
        hinges = [Hinge(f"hanging_{i}", self.shape, axis) for i, axis in enumerate(self.axes())]
        return [Appendage(self.cause, len(rig.links) - 1, np.array(self.place), hinges, inertia)]

    def frozen(self, rig):
        (item,) = self.appendages(rig)
        return rig.with_body(item.parent, item.inertia.seen_from(item.rotation, item.position))

    def force(self, world):
        dofs = [world.named(f"hanging_{i}") for i in range(len(self.axes()))]
        spring, damper = self.spring(world.rig)

        def law(state):
            for dof in dofs:
                state.force[dof] -= spring * state.q[dof] + damper * state.v[dof]

        return law


class Pendulum(Hanging):
    """A mass that hangs on two hinges: a rigid model has it at its pivot."""

    length: float

    def axes(self):
        return EYE[:2]

    def frozen(self, rig):
        return rig.with_body(-1, point_mass(self.mass, np.array(self.place)))


class Slosh(Pendulum):
    """Fluid in the payload: a pendulum with two hinges (or a mass on two sprung slides), lightly damped."""

    damping_ratio: float

    cause = "slosh"
    foreign = Forms({"pendulum": "hinge", "sprung-slides": "slide"})
    kin = ("payload-shift",)

    @staticmethod
    def first_guess(rng, context, form):
        place = _draw_place(rng, context.rig, 0.3)
        mass = 0.5 * context.share * context.rig.payload.inertia.mass
        return mass, place, rng.uniform(0.02, 0.08), rng.uniform(0.03, 0.12)

    def ball(self, rig):
        lever = self.length if self.form == "pendulum" else 0.0
        return (0.0, 0.0, -lever), 0.3 * self.length

    def spring(self, rig):
        omega = (9.81 / self.length) ** 0.5
        hanging = self.form == "pendulum"
        inertia = self.mass * (self.length**2 if hanging else 1.0)
        spring = 0.0 if hanging else inertia * omega**2
        return spring, 2.0 * self.damping_ratio * omega * inertia


class CableWhip(Pendulum):
    """A cable that hangs from the first link: a double-hinged pendulum of its own length, well damped."""

    cause = "cable-whip"
    foreign = Forms({"pendulum": "hinge"})
    kin = ("cable-spring",)

    @staticmethod
    def first_guess(rng, context, form):
        edge = edge_of(context.rig)
        angle = rng.uniform(-pi, pi)
        place = (0.8 * edge * cos(angle), 0.8 * edge * sin(angle), -0.3 * edge)
        mass = 0.3 * context.share * context.rig.payload.inertia.mass
        return mass, place, rng.uniform(0.08, 0.3)

    def ball(self, rig):
        return (0.0, 0.0, -self.length), 0.2 * self.length

    def spring(self, rig):
        return 0.0, 0.1 * self.mass * self.length**2 * (9.81 / self.length) ** 0.5


class Rattle(Hanging):
    """Something loose in the payload: a mass on a slide (or a hinge) that hits stops at both ends of its play."""

    direction: Vector
    play: float

    cause = "loose-payload"
    foreign = Forms({"slide": "slide", "hinge": "hinge"})
    kin = ("backlash", "payload-shift")

    @staticmethod
    def first_guess(rng, context, form):
        place = _draw_place(rng, context.rig, 0.3)
        mass = context.share * context.rig.payload.inertia.mass
        play = rng.uniform(*((0.003, 0.015) if form == "slide" else (0.1, 0.5)))
        return mass, place, draw_direction(rng), play

    def ball(self, rig):
        arm = 0.0 if self.form == "slide" else 0.3
        return arm * edge_of(rig) * np.roll(self.direction, 1), 0.1 * edge_of(rig)

    def force(self, world):
        dof = world.named("hanging_0")
        size = self.mass if self.form == "slide" else self.mass * (0.3 * edge_of(world.rig)) ** 2
        omega = 2.0 * pi * 60.0
        spring = size * omega**2
        damper = 0.5 * size * omega

        def law(state):
            x = state.q[dof]
            v = state.v[dof]
            state.force[dof] -= 0.5 * size * v
            depth = abs(x) - 0.5 * self.play
            if depth > 0.0:
                side = 1.0 if x > 0.0 else -1.0
                state.force[dof] -= side * max(spring * depth + side * damper * v, 0.0)

        return law


class MountResonance(Hanging):
    """A part of the payload (a lens, a screen) on a springy mount of its own, 12–35 Hz."""

    direction: Vector
    hertz: float
    damping_ratio: float

    cause = "mount-resonance"
    foreign = Forms({"turning": "hinge", "shifting": "slide"})
    kin = ("joint-flexibility",)
    widest = 100.0

    @staticmethod
    def first_guess(rng, context, form):
        place = _draw_place(rng, context.rig, 0.5)
        mass = context.rig.payload.inertia.mass * min(3.0 * context.share + 0.03, 0.5)
        return mass, place, draw_direction(rng), rng.uniform(12.0, 35.0), rng.uniform(0.02, 0.08)

    def scaled(self, k):
        hertz = max(self.hertz / max(k / 3.0, 1.0) ** 0.5, 4.0)
        return replace(self, mass=min(k, 3.0) * self.mass, hertz=hertz)

    def ball(self, rig):
        return (0.0, 0.0, 0.0), 0.5 * edge_of(rig) / 0.4**0.5

    def spring(self, rig):
        turning = self.form == "turning"
        size = self.mass * (0.5 * edge_of(rig)) ** 2 if turning else self.mass
        omega = 2.0 * pi * self.hertz
        return size * omega**2, 2.0 * self.damping_ratio * size * omega


class Flywheel(Effect):
    """Something spins in the payload: torque -ω × h on the last link, h fixed in it."""

    momentum: float
    direction: Vector

    cause = "flywheel"
    foreign = ("steady", "spinning-up")
    needs_axes = 2
    on_joint = False

    @staticmethod
    def first_guess(rng, context, form):
        return context.target / context.speed, draw_direction(rng)

    def force(self, world):
        """Q_j = axis_j · (-ω × h), ω = Σ axis_j v_j, all in the world's frame."""
        data = world.data
        body = world.model.body(world.rig.links[-1].name).id
        dofs = world.link_dof

        def law(state):
            axes = data.xaxis[dofs].tolist()
            turn = data.xmat[body].tolist()
            spin = [sum(map(mul, turn[row : row + 3], self.direction)) for row in (0, 3, 6)]
            speeds = [state.v[dof] for dof in dofs]
            rate = [sum(map(mul, along, speeds)) for along in zip(*axes)]
            pull = [spin[i - 2] * rate[i - 1] - spin[i - 1] * rate[i - 2] for i in range(3)]
            size = self.momentum
            if self.form == "spinning-up":
                size = size * 2.0 * state.t / world.seconds
            for axis, dof in zip(axes, dofs):
                state.force[dof] += size * sum(map(mul, axis, pull))

        return law
