"""What is wrong with how the rig stands or is measured: encoders, a base that is tilted or moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from ..draws import draw_sign
from ..mjcf import DRIVEN, Base
from ..motion import BaseMotion, handheld, profile_s
from ..rigs import Array, rotation_about
from ..rnea import GRAVITY
from .base import Context, Effect, Law

if TYPE_CHECKING:
    from ..world import State, World


@dataclass(frozen=True)
class EncoderOffset(Effect):
    """The encoder shows q + o, or, mounted off its centre, q + o + e sin(q + φ)."""

    offset: float
    eccentricity: float
    phase: float

    cause = "encoder-offset"
    known = ("constant",)
    foreign = ("eccentric",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> EncoderOffset:
        offset = draw_sign(rng) * context.share
        return cls(
            context.joint,
            form,
            offset,
            0.3 * offset if form == "eccentric" else 0.0,
            rng.uniform(-3.0, 3.0),
        )

    def scaled(self, k: float) -> EncoderOffset:
        offset = float(np.clip(k * self.offset, -0.5, 0.5))
        return replace(self, offset=offset, eccentricity=offset * (self.eccentricity / self.offset))

    def prepare(self, world: World) -> None:
        world.offset[self.own] += self.offset
        world.eccentric[self.own] = (self.eccentricity, self.phase)


@dataclass(frozen=True)
class BaseTilt(Effect):
    """Gravity is not along the base's -z: a tilted base, or one that sinks over to one side during the run."""

    angle: float
    heading: float

    cause = "base-tilt"
    known = ("static",)
    foreign = ("sinking",)
    within = (-inf, 1.0)
    told = ("angle", "heading")

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> BaseTilt:
        return cls(None, form, 2.0 * context.share, rng.uniform(-np.pi, np.pi))

    def _gravity(self, share: float) -> Array:
        axis = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        return rotation_about(axis, share * self.angle).T @ GRAVITY

    def prepare(self, world: World) -> None:
        world.model.opt.gravity[:] = self._gravity(1.0)

    def force(self, world: World) -> Law | None:
        if self.form == "static":
            return None
        gravity = world.model.opt.gravity
        seconds = world.seconds
        path = [self._gravity(share).tolist() for share in np.linspace(0.0, 2.0, 4001)]

        def law(state: State) -> None:
            gravity[:] = path[min(int(4000 * 0.5 * state.t / seconds), 4000)]

        return law


@dataclass(frozen=True)
class PlatformMotion(Effect):
    """The base moves along a path that its IMU has measured: sums of sines, or a walking hand."""

    size: float
    seed: int

    cause = "platform-motion"
    known = ("sines", "handheld")
    base = Base.DRIVEN
    within = (-inf, 3.0)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> PlatformMotion:
        return cls(None, form, context.share, int(rng.integers(2**31)))

    def motion(self) -> BaseMotion:
        """The path of the base: position and Euler angles as functions of time."""
        rng = np.random.default_rng(self.seed)
        return (profile_s if self.form == "sines" else handheld)(rng, self.size)

    def prepare(self, world: World) -> None:
        world.base_path = self.motion().sampled(world.dt, world.seconds)

    def force(self, world: World) -> Law:
        """The driven base's own weight and reaction vanish beside its armature; only its acceleration is wanted."""
        dofs = world.base_dofs
        path = world.base_path
        if path is None:
            raise ValueError("platform-motion: prepare() must come before force()")

        def law(state: State) -> None:
            for dof, a in zip(dofs, path(state.t)[2], strict=True):
                state.force[dof] += DRIVEN * a

        return law


@dataclass(frozen=True)
class UnmeasuredMotion(PlatformMotion):
    """The same moving base, and nobody measured it."""

    cause = "unmeasured-platform-motion"
    foreign = ("sines", "handheld")
    kin = ("platform-motion",)
    measured = False
