"""What a motion lets one see: base regressor and effect columns in unit torque, with their exact derivative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gimbal_pin.dynamics.model import Model, build_stated_effects, is_parameter
from gimbal_pin.dynamics.reduction import Reduction, reduce_parameters
from gimbal_pin.dynamics.regressor import compute_gravity, compute_regressor, compute_rnea
from gimbal_pin.effects import Effect, Term
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.excitation.adjoint import (
    Link,
    build_links,
    compute_regressor_gradient,
    differentiate_rnea,
    differentiate_samples,
)
from gimbal_pin.excitation.criteria import Determinant
from gimbal_pin.excitation.limits import Envelope, assume_limits
from gimbal_pin.log.log import Array, Log, Motion
from gimbal_pin.regression import (
    Design,
    Filtering,
    Samples,
    compute_direction,
    compute_effect_columns,
    find_base_columns,
)
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class ExcitationColumns:
    """``W = [Y[:, independent], effects' bases]``: torque per unit of each base parameter and effect coefficient.

    Attributes:
        rig: The rig.
        effects: Effects whose coefficients are to be seen, friction first.
        reduction: Its base parameters.
    """

    rig: Rig
    effects: tuple[Effect, ...]
    reduction: Reduction

    @staticmethod
    def of(rig: Rig, effects: Sequence[Effect] = ()) -> ExcitationColumns:
        """The rig's base parameters, friction and rotors, and the `effects` on top."""
        reduction = reduce_parameters(rig)
        return ExcitationColumns(rig, (*build_stated_effects(rig, reduction), *effects), reduction)

    @cached_property
    def places(self) -> Array:
        """Base parameters' places in `Rig.phi`, (b,)."""
        return find_base_columns(self.rig, self.reduction)

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The rig's tree for `compute_regressor_gradient`."""
        return build_links(self.rig.model)

    @cached_property
    def scale(self) -> Array:
        """Rms torque of each column over states spread evenly within the rig's limits, N m per unit, (p,).

        Dividing by it brings every column to unit torque *whatever the motion*: a motion that hardly excites a
        column is charged for it. (Scaled by its own rms on the motion, a column that is never excited looks as good
        as any other: optimising that number left standard deviations up to a hundred times larger on the bundled rigs.)
        """
        spread = Envelope.of(self.rig).spread()
        size = np.sqrt(np.mean(self.compute(spread, np.sign(spread.v)) ** 2, axis=(0, 1)))
        return np.where(size > 0, size, 1.0)

    def compute(self, motion: Motion, slide: Array) -> Array:
        """``W`` along a motion, (N, n, p); `slide` is the direction of sliding (N, n)."""
        rigid = compute_regressor(self.rig, motion.q, motion.v, motion.a, places=self.places)
        tau, pull = self.compute_loads(motion)
        states = Samples(
            motion.t, motion.q, motion.v, motion.a, tau, motion.v, np.zeros(self.rig.n)
        )
        effects = compute_effect_columns(self.rig, self.effects, states, slide, pull)
        return np.concatenate([rigid, effects], axis=2)

    def compute_loads(self, motion: Motion) -> tuple[Array, Array]:
        """The rigid torque, and that at rest, which effects see, N m, (N, n); zero where no effect does."""
        q = motion.q
        none = np.zeros_like(motion.q)
        loaded = any(effect.loaded for effect in self.effects)
        weighed = any(effect.weighed for effect in self.effects)
        tau = compute_rnea(self.rig, q, motion.v, motion.a) if loaded else none
        return tau, compute_gravity(self.rig, q) if weighed else none

    def scale_rows(self, motion: Motion, slide: Array | None = None) -> Array:
        """``W`` in unit torque, stacked, (N n, p); without `slide` each joint slides as the sign of its rate says."""
        direction = np.sign(motion.v) if slide is None else slide
        return (self.compute(motion, direction) / self.scale).reshape(-1, len(self.scale))

    def compute_condition_number(self, motion: Motion) -> float:
        """Condition number of `scale_rows`: the yardstick of any motion, as reduction and scale are the rig's."""
        return float(np.linalg.cond(self.scale_rows(motion)))

    def compute_gradient(self, motion: Motion, step: float, left: Array, right: Array) -> Array:
        """Gradient of ``sum_r left_r' W right_r`` to each q, v, a of the motion, W in unit torque, (3, N, n).

        Args:
            motion: The motion, N samples.
            step: Interval over which `regression.compute_direction` takes the mean direction, s.
            left: Weights of the rows, (N n, r).
            right: Weights of the columns, (r, p).
        """
        count = len(motion)
        n = self.rig.n
        bases = len(self.places)
        weights = (left @ (right / self.scale)).reshape(count, n, -1)
        rigid = np.zeros((10 * n, n, count))
        rigid[self.places] = weights[:, :, :bases].T
        gravity = self.rig.model.gravity.linear
        out = compute_regressor_gradient(
            self.links, gravity, motion, rigid.reshape(n, 10, n, count)
        )
        return out + self._differentiate_effects(motion, step, weights[:, :, bases:])

    def _differentiate_effects(self, motion: Motion, step: float, weights: Array) -> Array:
        """The effects' part of `compute_gradient`; weights (N, n, coefficients)."""

        def total(q: Array, v: Array, a: Array, slide: Array, tau: Array, pull: Array) -> Array:
            states = Samples(motion.t, q, v, a, tau, v, np.zeros(self.rig.n))
            columns = compute_effect_columns(self.rig, self.effects, states, slide, pull)
            return np.einsum("tjc,tjc->tj", weights, columns)

        direction = compute_direction(motion.v, motion.a, step)
        states = (motion.q, motion.v, motion.a, direction, *self.compute_loads(motion))
        *own, per_slide, per_tau, per_pull = differentiate_samples(total, states)
        out = np.stack(own) + differentiate_direction(motion, step, per_slide)
        still = replace(motion, v=np.zeros_like(motion.v), a=np.zeros_like(motion.a))
        if per_tau.any():
            out += np.einsum("ctji,tj->cti", differentiate_rnea(self.rig.model, motion), per_tau)
        if per_pull.any():
            out[0] += np.einsum(
                "tji,tj->ti", differentiate_rnea(self.rig.model, still)[0], per_pull
            )
        return out

    def compute_information(self, logs: Sequence[Log]) -> Array:
        """``integral of W'W dt`` over logs, away from standstill, W in unit torque, s, (p, p): of the rows of a fit."""
        filtering = Filtering()
        total = np.zeros((len(self.scale), len(self.scale)))
        for block in Design(self.rig, self.reduction, self.effects, tuple(logs), filtering):
            rows = (block.A / self.scale).reshape(-1, len(self.scale))
            total += rows.T @ rows / (2 * filtering.cutoff)
        return total


def build_criterion_after_logs(
    rig: Rig,
    logs: Sequence[Log],
    seconds: float,
    effects: Sequence[Effect] = (),
    prior: float = 1e-4,
) -> Determinant:
    """Return the determinant criterion of `excite` with the information of earlier logs as its prior.

    Args:
        rig: The rig.
        logs: Earlier logs of it.
        seconds: Length of the motion, s.
        effects: Effects whose coefficients are to be shown, as in `excite`.
        prior: Information about every parameter before any log, s.
    """
    known = ExcitationColumns.of(assume_limits(rig)[0], effects).compute_information(
        [log.ordered(rig) for log in logs]
    )
    return Determinant(known + prior * np.eye(len(known)), seconds * rig.n)


def differentiate_direction(motion: Motion, step: float, weights: Array) -> Array:
    """Gradient of ``sum weights * compute_direction`` to q, v, a, (3, N, n): nothing where it is saturated."""
    reach = np.abs(motion.a) * step / 2
    inside = np.abs(motion.v) < reach
    per_rate = np.where(inside, weights / np.where(inside, reach, 1.0), 0.0)
    per_acceleration = -per_rate * motion.v / np.where(inside, motion.a, 1.0)
    return np.stack([np.zeros_like(per_rate), per_rate, per_acceleration])


def list_shown_effects(model: Model, causes: Sequence[str]) -> list[Effect]:
    """Return the effects of a model but those of `build_stated_effects`, and those of texts for `parse_effect`.

    Raises:
        UsageError: A cause is no torque at a joint; it says what shows that.
    """
    terms = [term.effect for term in model.terms]
    for named in causes:
        planted = parse_effect(named, model.rig)
        if not isinstance(planted, Term):
            what = (
                "adds no torque of its own at a joint, which is what a motion is designed to show"
            )
            mend = f"what shows it is {planted.experiment}; 'simulate --effect' plants it"
            raise UsageError(f"--effect {planted.name}", what, mend)
        terms.append(planted.effect)
    return [
        effect
        for k, effect in enumerate(terms)
        if not is_parameter(model.rig, effect) and effect not in terms[:k]
    ]
