"""What is wrong with the rig as a whole: payload, inertias, encoders, a base that is tilted or moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..mjcf import DRIVEN, Base
from ..motion import BaseMotion, handheld, profile_s
from ..rigs import Array, Inertia, Link, Rig, rotation_about
from ..rnea import GRAVITY
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class PayloadShift(Effect):
    """The payload's centre of mass lies elsewhere than its (trusted) URDF says."""

    shift: tuple[float, float, float]

    cause: ClassVar[str] = "payload-shift"
    forms = {"rigid": False}
    can_start_late = False

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> PayloadShift:
        direction = rng.normal(size=3)
        size = context.target / (9.81 * context.rig.payload.inertia.mass)
        return cls(None, form, tuple(size * direction / np.linalg.norm(direction)))

    def scaled(self, k: float) -> PayloadShift:
        return replace(self, shift=tuple(k * x for x in self.shift))

    def parameters(self) -> dict[str, float]:
        return dict(zip(("shift_x", "shift_y", "shift_z"), self.shift, strict=True))

    def plant(self, rig: Rig) -> Rig:
        body = rig.payload.inertia
        return rig.with_payload(replace(body, com=body.com + np.array(self.shift)))


@dataclass(frozen=True)
class PayloadMass(Effect):
    """The payload is heavier or lighter by a share: all of it, or by something bolted on off its centre."""

    share: float
    place: tuple[float, float, float]

    cause: ClassVar[str] = "payload-mass"
    forms = {"uniform": False, "bolted-on": True}
    can_start_late = False

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> PayloadMass:
        mass = context.rig.payload.inertia.mass
        sign = 1.0 if form == "bolted-on" else float(rng.choice([-1.0, 1.0]))
        edge = (mass / 700.0) ** (1.0 / 3.0)
        return cls(None, form, sign * context.share, tuple(0.15 * edge * rng.uniform(-1.0, 1.0, 3)))

    def scaled(self, k: float) -> PayloadMass:
        return replace(self, share=max(k * self.share, -0.8))

    def parameters(self) -> dict[str, float]:
        return {"share": self.share}

    def plant(self, rig: Rig) -> Rig:
        body = rig.payload.inertia
        extra = Inertia(self.share * body.mass, body.com, self.share * body.tensor)
        if self.form == "bolted-on":
            extra = Inertia(extra.mass, body.com + np.array(self.place), 0.02 * extra.tensor)
        return rig.with_payload(body.plus(extra))


@dataclass(frozen=True)
class OffDiagonalInertia(Effect):
    """Products of inertia that the (trusted, diagonal) model leaves out; `products` are shares of what a body allows."""

    strength: float
    products: tuple[tuple[float, float, float], ...]

    cause: ClassVar[str] = "off-diagonal-inertia"
    forms = {"products": False}
    can_start_late = False
    needs_axes: ClassVar[int] = 2

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> OffDiagonalInertia:
        shape = (len(context.rig.links) + 1, 3)
        return cls(None, form, min(2.0 * context.share, 0.6), tuple(tuple(row) for row in rng.uniform(-1.0, 1.0, shape)))

    def scaled(self, k: float) -> OffDiagonalInertia:
        return replace(self, strength=min(k * self.strength, 0.9))

    def parameters(self) -> dict[str, float]:
        return {"strength": self.strength}

    def _skewed(self, inertia: Inertia, row: tuple[float, float, float]) -> Inertia:
        """Products p·√(Σ_a Σ_b)/2 of the second moments Σ: any |p| ≤ 1 leaves a real body."""
        second = 0.5 * np.trace(inertia.tensor) * np.eye(3) - inertia.tensor
        root = np.sqrt(np.diag(second))
        skew = np.zeros((3, 3))
        for value, (a, b) in zip(row, ((0, 1), (0, 2), (1, 2)), strict=True):
            skew[a, b] = skew[b, a] = 0.5 * self.strength * value * root[a] * root[b]
        return replace(inertia, tensor=inertia.tensor - skew)

    def plant(self, rig: Rig) -> Rig:
        links = _each(rig, lambda i, link: self._skewed(link.inertia, self.products[i]))
        return replace(rig, links=links).with_payload(self._skewed(rig.payload.inertia, self.products[-1]))


def _each(rig: Rig, change: Callable[[int, Link], Inertia]) -> tuple[Link, ...]:
    return tuple(replace(link, inertia=change(i, link)) for i, link in enumerate(rig.links))


def diagonal(rig: Rig) -> Rig:
    """The rig with every product of inertia dropped, as a thesis-style model has it."""
    payload = rig.payload.inertia
    links = _each(rig, lambda i, link: replace(link.inertia, tensor=np.diag(np.diag(link.inertia.tensor))))
    return replace(rig, links=links).with_payload(replace(payload, tensor=np.diag(np.diag(payload.tensor))))


@dataclass(frozen=True)
class EncoderOffset(Effect):
    """The encoder shows q + o, or, mounted off its centre, q + o + e sin(q + φ)."""

    offset: float
    eccentricity: float
    phase: float

    cause: ClassVar[str] = "encoder-offset"
    forms = {"constant": False, "eccentric": True}
    can_start_late = False

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> EncoderOffset:
        offset = float(rng.choice([-1.0, 1.0])) * context.share
        return cls(context.joint, form, offset, 0.3 * offset if form == "eccentric" else 0.0, float(rng.uniform(-3.0, 3.0)))

    def scaled(self, k: float) -> EncoderOffset:
        offset = float(np.clip(k * self.offset, -0.5, 0.5))
        return replace(self, offset=offset, eccentricity=offset * (self.eccentricity / self.offset))

    def parameters(self) -> dict[str, float]:
        return {"offset": self.offset}

    def prepare(self, world: World) -> None:
        world.offset[self.own] += self.offset
        world.eccentric[self.own] = (self.eccentricity, self.phase)


@dataclass(frozen=True)
class BaseTilt(Effect):
    """Gravity is not along the base's -z: a tilted base, or one that sinks over to one side during the run."""

    angle: float
    heading: float

    cause: ClassVar[str] = "base-tilt"
    forms = {"static": False, "sinking": True}
    can_start_late = False

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> BaseTilt:
        return cls(None, form, 2.0 * context.share, float(rng.uniform(-np.pi, np.pi)))

    def scaled(self, k: float) -> BaseTilt:
        return replace(self, angle=min(k * self.angle, 1.0))

    def parameters(self) -> dict[str, float]:
        return {"angle": self.angle, "heading": self.heading}

    def _gravity(self, share: float) -> Array:
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        return rotation_about(axis, share * self.angle).T @ GRAVITY

    def prepare(self, world: World) -> None:
        world.model.opt.gravity[:] = self._gravity(1.0)

    def force(self, world: World) -> Law | None:
        if self.form == "static":
            return None
        gravity, seconds = world.model.opt.gravity, world.seconds
        path = [self._gravity(share).tolist() for share in np.linspace(0.0, 2.0, 4001)]

        def law(state: State) -> None:
            gravity[:] = path[min(int(4000 * 0.5 * state.t / seconds), 4000)]

        return law


@dataclass(frozen=True)
class PlatformMotion(Effect):
    """The base moves along a path that its IMU has measured: sums of sines, or a walking hand."""

    size: float
    seed: int

    cause: ClassVar[str] = "platform-motion"
    forms = {"sines": False, "handheld": False}
    can_start_late = False
    base: ClassVar[Base] = Base.DRIVEN

    @classmethod
    def draw(cls, rng: np.random.Generator, context: Context, form: str) -> PlatformMotion:
        return cls(None, form, context.share, int(rng.integers(2**31)))

    def scaled(self, k: float) -> PlatformMotion:
        return replace(self, size=min(k * self.size, 3.0))

    def parameters(self) -> dict[str, float]:
        return {"size": self.size}

    def motion(self) -> BaseMotion:
        """The path of the base: position and Euler angles as functions of time."""
        rng = np.random.default_rng(self.seed)
        return (profile_s if self.form == "sines" else handheld)(rng, self.size)

    def prepare(self, world: World) -> None:
        world.base_path = self.motion().sampled(world.dt, world.seconds)

    def force(self, world: World) -> Law:
        """The driven base's own weight and reaction vanish beside its armature; only its acceleration is wanted."""
        dofs, path = world.base_dofs, world.base_path
        if path is None:
            raise ValueError("platform-motion: prepare() must come before force()")

        def law(state: State) -> None:
            for dof, a in zip(dofs, path(state.t)[2], strict=True):
                state.force[dof] += DRIVEN * a

        return law


@dataclass(frozen=True)
class UnmeasuredMotion(PlatformMotion):
    """The same moving base, and nobody measured it."""

    cause: ClassVar[str] = "unmeasured-platform-motion"
    forms = {"sines": True, "handheld": True}
    kin: ClassVar[tuple[str, ...]] = ("platform-motion",)
    measured: ClassVar[bool] = False
