"""What a trusted model gets wrong of the bodies: where the payload sits, what it weighs, products of inertia."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.random import Generator

from ..draws import draw_sign
from ..rigs import Inertia, Link, Rig
from .base import Context, Effect


@dataclass(frozen=True)
class PayloadShift(Effect):
    """The payload's centre of mass lies elsewhere than its (trusted) URDF says."""

    shift: tuple[float, float, float]

    cause = "payload-shift"
    known = ("rigid",)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> PayloadShift:
        direction = rng.normal(size=3)
        size = context.target / (9.81 * context.rig.payload.inertia.mass)
        return cls(None, form, tuple(size * direction / np.linalg.norm(direction)))

    def scaled(self, k: float) -> PayloadShift:
        x, y, z = self.shift
        return replace(self, shift=(k * x, k * y, k * z))

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

    cause = "payload-mass"
    known = ("uniform",)
    foreign = ("bolted-on",)
    within = (-0.8, inf)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> PayloadMass:
        mass = context.rig.payload.inertia.mass
        sign = 1.0 if form == "bolted-on" else draw_sign(rng)
        edge = (mass / 700.0) ** (1.0 / 3.0)
        return cls(None, form, sign * context.share, tuple(0.15 * edge * rng.uniform(-1.0, 1.0, 3)))

    def plant(self, rig: Rig) -> Rig:
        body = rig.payload.inertia
        extra = Inertia(self.share * body.mass, body.com, self.share * body.tensor)
        if self.form == "bolted-on":
            extra = Inertia(extra.mass, body.com + np.array(self.place), 0.02 * extra.tensor)
        return rig.with_payload(body.plus(extra))


@dataclass(frozen=True)
class OffDiagonalInertia(Effect):
    """Products of inertia that the (trusted, diagonal) model lacks; `products` are shares of what a body allows."""

    strength: float
    products: tuple[tuple[float, float, float], ...]

    cause = "off-diagonal-inertia"
    known = ("products",)
    needs_axes = 2
    within = (-inf, 0.9)

    @classmethod
    def draw(cls, rng: Generator, context: Context, form: str) -> OffDiagonalInertia:
        shape = (len(context.rig.links) + 1, 3)
        return cls(
            None,
            form,
            min(2.0 * context.share, 0.6),
            tuple(tuple(row) for row in rng.uniform(-1.0, 1.0, shape)),
        )

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
        return replace(rig, links=links).with_payload(
            self._skewed(rig.payload.inertia, self.products[-1])
        )


def _each(rig: Rig, change: Callable[[int, Link], Inertia]) -> tuple[Link, ...]:
    return tuple(replace(link, inertia=change(i, link)) for i, link in enumerate(rig.links))


def diagonal(rig: Rig) -> Rig:
    """The rig with every product of inertia dropped, as a thesis-style model has it."""
    payload = rig.payload.inertia
    links = _each(
        rig, lambda i, link: replace(link.inertia, tensor=np.diag(np.diag(link.inertia.tensor)))
    )
    return replace(rig, links=links).with_payload(
        replace(payload, tensor=np.diag(np.diag(payload.tensor)))
    )
