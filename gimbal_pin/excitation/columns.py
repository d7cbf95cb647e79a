"""What a motion lets one see: base regressor and effect columns in unit torque, with their exact derivative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gimbal_pin.dynamics.model import friction_effects
from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.dynamics.regressor import columns, regressor, rnea, weight
from gimbal_pin.effects import Effect, Sample
from gimbal_pin.excitation.adjoint import (
    Link,
    differentiate_rnea,
    differentiate_samples,
    links,
    regressor_gradient,
)
from gimbal_pin.excitation.limits import Envelope
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import compute_direction
from gimbal_pin.rig.rig import Rig

AFFINE = ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0))
"""Rates and directions of sliding that tell the three numbers of an affine effect."""


@dataclass(frozen=True, eq=False)
class Columns:
    """``W = [Y[:, independent], effects' bases]``: torque per unit of each base parameter and effect coefficient.

    Attributes:
        rig: The rig.
        effects: Effects whose coefficients are to be seen, friction first.
        places: Base parameters' places in `Rig.phi` (b,): the columns that `reduction.reduce` keeps.
    """

    rig: Rig
    effects: tuple[Effect, ...]
    places: Array

    @staticmethod
    def of(rig: Rig, effects: Sequence[Effect] = ()) -> Columns:
        """The rig's base parameters and friction, and the `effects` on top."""
        places = columns(rig)[1][list(reduce(rig).independent)]
        return Columns(rig, (*friction_effects(rig.joints), *effects), places)

    @cached_property
    def scale(self) -> Array:
        """Rms torque of each column over states spread evenly within the rig's limits, N m per unit, (p,).

        Dividing by it brings every column to unit torque *whatever the motion*: a motion that hardly excites a
        column is charged for it. (Scaled by its own rms on the motion, a column that is never excited looks as good
        as any other: optimising that number left standard deviations up to a hundred times larger on the bundled rigs.)
        """
        spread = Envelope.of(self.rig).spread()
        size = np.sqrt(np.mean(self.at(spread, np.sign(spread.v)) ** 2, axis=(0, 1)))
        return np.where(size > 0, size, 1.0)

    def at(self, motion: Motion, slide: Array) -> Array:
        """``W`` along a motion, (N, n, p); `slide` is the direction of sliding (N, n)."""
        constant, per_slide, per_rate = self.affine
        out = np.empty((len(motion), self.rig.n, len(self.places) + constant.shape[1]))
        out[:, :, : len(self.places)] = regressor(self.rig, motion.q, motion.v, motion.a)[:, :, self.places]
        out[:, :, len(self.places) :] = constant + per_slide * slide[..., None] + per_rate * motion.v[..., None]
        tau, weight = self.load(motion), self.weight(motion)
        for j, span, effect in self.others:
            own = (array[:, j] for array in (motion.q, motion.v, motion.a, slide, tau))
            at = Sample(motion.t, *own)._replace(weight=weight[:, j])
            for column, basis in zip(range(len(self.places) + span.start, out.shape[2]), effect.basis(at)):
                out[:, j, column] = basis
        return out

    @cached_property
    def spans(self) -> tuple[tuple[int, slice, Effect], ...]:
        """Joint and coefficients' places of every effect."""
        ends = np.cumsum([0, *(len(effect.coefficients) for effect in self.effects)]).tolist()
        places = (slice(*ends[k : k + 2]) for k in range(len(self.effects)))
        return tuple((self.rig.joint_index(e.joint), place, e) for e, place in zip(self.effects, places))

    @cached_property
    def others(self) -> tuple[tuple[int, slice, Effect], ...]:
        """Those of `spans` whose effects are not affine."""
        return tuple(span for span in self.spans if not span[2].affine)

    @cached_property
    def affine(self) -> Array:
        """``c0, c1, c2`` of the affine effects' bases ``c0 + c1 slide + c2 v``, (3, n, coefficients)."""
        out = np.zeros((3, self.rig.n, self.spans[-1][1].stop))
        for j, place, effect in self.spans:
            if effect.affine:
                still, slides, moves = (np.array(effect.basis(Sample(0, 0, v, 0, s, 0)), float) for v, s in AFFINE)
                out[:, j, place] = still, slides - still, moves - still
        return out

    def load(self, motion: Motion) -> Array:
        """The rigid torque that load-dependent effects see, N m, (N, n); zero where there is no such effect."""
        loaded = any(effect.loaded for effect in self.effects)
        return rnea(self.rig, motion.q, motion.v, motion.a) if loaded else np.zeros_like(motion.q)

    def weight(self, motion: Motion) -> Array:
        """The torque at rest that such effects see, N m, (N, n); zero where there is none."""
        weighed = any(effect.weighed for effect in self.effects)
        return weight(self.rig, motion.q) if weighed else np.zeros_like(motion.q)

    def unit(self, motion: Motion, slide: Array) -> Array:
        """``W`` in unit torque, stacked, (N n, p)."""
        return (self.at(motion, slide) / self.scale).reshape(-1, len(self.scale))

    def gradient(self, motion: Motion, step: float, left: Array, right: Array) -> Array:
        """Gradient of ``sum_r left_r' W right_r`` to each q, v, a of the motion, W in unit torque, (3, N, n).

        Args:
            motion: The motion, N samples.
            step: Interval over which `regression.compute_direction` takes the mean direction, s.
            left: Weights of the rows, (N n, r).
            right: Weights of the columns, (r, p).
        """
        per_unit = right / self.scale
        weights = left @ per_unit
        count, n, bases = len(motion), self.rig.n, len(self.places)
        rigid = np.zeros((10 * n, n, count))
        rigid[self.places] = weights[:, :bases].reshape(count, n, bases).T
        gravity = self.rig.model.gravity.linear
        out = regressor_gradient(self.links, gravity, motion, rigid.reshape(n, 10, n, count))
        return out + self.effects_gradient(motion, step, weights[:, bases:].reshape(count, n, -1))

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The rig's tree for `regressor_gradient`."""
        return links(self.rig.model)

    def sweep(self, motion: Motion, phi: Array, weights: Array) -> Array:
        """Gradient of ``sum weights * rnea(q, v, a; phi)``, (3, N, n)."""
        return np.einsum("ctji,tj->cti", differentiate_rnea(self.rig.with_phi(phi).model, motion), weights)

    def effects_gradient(self, motion: Motion, step: float, weights: Array) -> Array:
        """The effects' part of `gradient`; weights (N, n, coefficients)."""
        direction = compute_direction(motion.v, motion.a, step)
        arrays = (motion.q, motion.v, motion.a, direction, self.load(motion), self.weight(motion))
        bars = np.zeros((len(arrays), *motion.q.shape))
        bars[3], bars[1] = (np.einsum("tjc,jc->tj", weights, per) for per in self.affine[1:])
        for j, place, effect in self.others:
            weight = weights[:, j, place].T

            def total(*at: Array, effect: Effect = effect, weight: Array = weight) -> Array:
                sample = Sample(motion.t, *at[:-1])._replace(weight=at[-1])
                return sum((w * b for w, b in zip(weight, effect.basis(sample))), np.zeros(len(motion)))

            bars[:, :, j] += differentiate_samples(total, [array[:, j] for array in arrays])
        out = bars[:3] + direction_gradient(motion, step, bars[3])
        out += self.sweep(motion, self.rig.phi, bars[4]) if bars[4].any() else 0.0
        if bars[5].any():
            still = np.zeros_like(motion.q)
            out[0] += self.sweep(replace(motion, v=still, a=still), self.rig.phi, bars[5])[0]
        return out


def direction_gradient(motion: Motion, step: float, weights: Array) -> Array:
    """Gradient of ``sum weights * compute_direction`` to q, v, a, (3, N, n): nothing where it is saturated."""
    reach = np.abs(motion.a) * step / 2
    inside = np.abs(motion.v) < reach
    per_rate = np.where(inside, weights / np.where(inside, reach, 1.0), 0.0)
    per_acceleration = -per_rate * motion.v / np.where(inside, motion.a, 1.0)
    return np.stack([np.zeros_like(per_rate), per_rate, per_acceleration])


def condition_number(rig: Rig, motion: Motion, effects: Sequence[Effect] = ()) -> float:
    """Condition number of the base regressor and friction columns in unit torque: the yardstick of any motion.

    Columns (`reduction.reduce`) and scales (`Columns.scale`) are fixed by the rig, so that motions are comparable.
    """
    return float(np.linalg.cond(Columns.of(rig, effects).unit(motion, np.sign(motion.v))))
