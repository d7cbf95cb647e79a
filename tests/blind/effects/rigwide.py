"""Effects of the whole rig that a model lacks: its payload, its encoders, a base that is tilted, soft or moves."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np

from ..draws import draw_sign
from ..mjcf import DRIVEN, Base
from ..motion import handheld, profile_s
from ..rigs import Inertia, rotation_about
from ..rnea import GRAVITY
from .base import Effect, Forms
from .hanging import Vector, edge_of


class RigEffect(Effect):
    """An effect on the whole rig."""

    on_joint = False


class PayloadShift(RigEffect):
    """The payload's centre of mass lies elsewhere than its (trusted) URDF says."""

    shift: Vector

    cause = "payload-shift"
    known = ("rigid",)

    @staticmethod
    def first_guess(rng, context, form):
        axis = rng.normal(size=3)
        size = context.target / (9.81 * context.rig.payload.inertia.mass)
        return (tuple(size * axis / np.linalg.norm(axis)),)

    def scaled(self, k):
        return replace(self, shift=tuple(k * x for x in self.shift))

    def parameters(self):
        return dict(zip(("shift_x", "shift_y", "shift_z"), self.shift))

    def plant(self, rig):
        body = rig.payload.inertia
        return rig.with_payload(replace(body, com=body.com + np.array(self.shift)))


class PayloadMass(RigEffect):
    """The payload is heavier or lighter by a share: all of it, or by something bolted on off its centre."""

    share: float
    place: Vector

    cause = "payload-mass"
    known = ("uniform",)
    foreign = ("bolted-on",)
    within = (-0.8, inf)

    @staticmethod
    def first_guess(rng, context, form):
        sign = 1.0 if form == "bolted-on" else draw_sign(rng)
        place = 0.15 * edge_of(context.rig) * rng.uniform(-1.0, 1.0, 3)
        return sign * context.share, tuple(place)

    def plant(self, rig):
        body = rig.payload.inertia
        extra = body.times(self.share)
        if self.form == "bolted-on":
            extra = Inertia(extra.mass, body.com + np.array(self.place), 0.02 * extra.tensor)
        return rig.with_payload(body.plus(extra))


def diagonal(rig):
    """Return the rig with every product of inertia dropped, as a thesis-style model has it."""
    return rig.with_inertias(lambda one: replace(one, tensor=np.diag(np.diag(one.tensor))))


class OffDiagonalInertia(RigEffect):
    """Products of inertia that the (trusted, diagonal) model lacks; `products` are shares of what a body allows."""

    strength: float
    products: tuple[Vector, ...]

    cause = "off-diagonal-inertia"
    known = ("products",)
    needs_axes = 2
    within = (-inf, 0.9)

    @staticmethod
    def first_guess(rng, context, form):
        products = rng.uniform(-1.0, 1.0, (len(context.rig.links) + 1, 3))
        return min(2.0 * context.share, 0.6), tuple(map(tuple, products))

    def plant(self, rig):
        """Products p·√(Σ_a Σ_b)/2 of the second moments Σ: any |p| ≤ 1 leaves a real body."""
        rows = iter(self.products)

        def skew(inertia):
            second = 0.5 * np.trace(inertia.tensor) * np.eye(3) - inertia.tensor
            root = np.sqrt(np.diag(second))
            skewed = np.zeros((3, 3))
            for value, (a, b) in zip(next(rows), ((0, 1), (0, 2), (1, 2))):
                skewed[a, b] = skewed[b, a] = 0.5 * self.strength * value * root[a] * root[b]
            return replace(inertia, tensor=inertia.tensor - skewed)

        return rig.with_inertias(skew)


class EncoderOffset(Effect):
    """The encoder shows q + o, or, mounted off its centre, q + o + e sin(q + φ)."""

    offset: float
    eccentricity: float
    phase: float

    cause = "encoder-offset"
    known = ("constant",)
    foreign = ("eccentric",)

    @staticmethod
    def first_guess(rng, context, form):
        offset = draw_sign(rng) * context.share
        eccentricity = 0.3 * offset if form == "eccentric" else 0.0
        return offset, eccentricity, rng.uniform(-3.0, 3.0)

    def scaled(self, k):
        offset = float(np.clip(k * self.offset, -0.5, 0.5))
        return replace(self, offset=offset, eccentricity=offset * (self.eccentricity / self.offset))

    def prepare(self, world):
        world.offset[self.joint] += self.offset
        world.eccentric[self.joint] = (self.eccentricity, self.phase)


class BaseTilt(RigEffect):
    """Gravity is not along the base's -z: a tilted base, or one that sinks over to one side during the run."""

    angle: float
    heading: float

    cause = "base-tilt"
    known = ("static",)
    foreign = ("sinking",)
    within = (-inf, 1.0)
    told = ("angle", "heading")

    @staticmethod
    def first_guess(rng, context, form):
        return 2.0 * context.share, rng.uniform(-pi, pi)

    def _gravity(self, share):
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        return rotation_about(axis, share * self.angle).T @ GRAVITY

    def prepare(self, world):
        world.model.opt.gravity[:] = self._gravity(1.0)

    def force(self, world):
        gravity = world.model.opt.gravity
        path = [self._gravity(share).tolist() for share in np.linspace(0.0, 2.0, 4001)]

        def law(state):
            gravity[:] = path[min(int(4000 * 0.5 * state.t / world.seconds), 4000)]

        return None if self.form == "static" else law


class PlatformMotion(RigEffect):
    """The base moves along a path that its IMU has measured: sums of sines, or a walking hand."""

    size: float
    seed: int

    cause = "platform-motion"
    known = Forms({"sines": profile_s, "handheld": handheld})
    base = Base.DRIVEN
    within = (-inf, 3.0)

    @staticmethod
    def first_guess(rng, context, form):
        return context.share, int(rng.integers(2**31))

    def motion(self):
        """Return the path of the base: position and Euler angles as functions of time."""
        return self.shape(np.random.default_rng(self.seed), self.size)

    def prepare(self, world):
        world.base_path = self.motion().sampled(world.dt, world.seconds)

    def force(self, world):
        """The driven base's own weight and reaction vanish beside its armature; only its acceleration is wanted."""
        dofs = world.base_dofs
        path = world.base_path

        def law(state):
            for dof, a in zip(dofs, path(state.t)[2]):
                state.force[dof] += DRIVEN * a

        return law


# outside the published causes


class UnmeasuredMotion(PlatformMotion):
    """Moving base that nobody measured; each form is drawn twice, as a known and as a foreign one."""

    cause = "unmeasured-platform-motion"
    foreign = PlatformMotion.known
    kin = ("platform-motion",)
    measured = False


class SoftBase(RigEffect):
    """The head stands on damper springs: three ways to shift and three to turn (or only to turn)."""

    compliance: float
    hertz: float
    damping_ratio: float

    cause = "soft-base"
    foreign = Forms({"six-ways": 1.0, "turning": 40.0})
    kin = ("joint-flexibility", "base-tilt")
    stiff = True
    in_band = True
    base = Base.SPRUNG
    widest = 200.0
    within = (0.02, 8.0)

    @staticmethod
    def first_guess(rng, context, form):
        return 1.0, rng.uniform(6.0, 14.0), rng.uniform(0.05, 0.3)

    def force(self, world):
        mass = 2.0 * sum(body.mass for body in world.rig.bodies)
        inertia = mass * (2.0 * edge_of(world.rig)) ** 2 / 3.0
        omega = 2.0 * pi * self.hertz / self.compliance**0.5
        springs = [self.shape * mass * omega**2] * 3 + [inertia * omega**2] * 3
        damping = 2.0 * self.damping_ratio * omega
        dampers = [damping * mass] * 3 + [damping * inertia] * 3
        table = list(zip(world.base_dofs, springs, dampers))
        sag = 9.81 * mass

        def law(state):
            for dof, spring, damper in table:
                state.force[dof] -= spring * state.q[dof] + damper * state.v[dof]
            state.force[table[2][0]] += sag

        return law
