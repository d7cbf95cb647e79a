"""Causes of the whole rig as columns: derivatives of the torque by an encoder's offset, gravity or bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import log

import numpy as np
from scipy.interpolate import make_interp_spline

from gimbal_pin.diagnosis.candidates import LOG_PRIORS, Candidate
from gimbal_pin.diagnosis.problem import Columns, Problem
from gimbal_pin.dynamics.regressor import compute_regressor, name_columns
from gimbal_pin.effects import (
    BaseTilt,
    EncoderOffset,
    OffDiagonalInertia,
    PayloadMass,
    PayloadShift,
    RigEffect,
)
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.regression import find_base_columns

COARSE_SECONDS = 0.02
"""Interval at which derivatives are evaluated, s: a fourth of a period of 12 Hz; they are interpolated between."""
RELATIVE_STEP = 1e-3
"""Step of a difference of bodies, as a share of their change."""
LEAST_CHANGE = 1e-5
"""Least change of bodies that such a step is a share of, m, kg or kg m²."""
STEP = 1e-4
"""Angle by which columns are differenced, rad."""
INVISIBLE = 1e-6
"""Change of base parameters per unit, as a share of the largest, below which the log does not show it."""

BuildBodies = Callable[[Array], list[RigEffect]]


@dataclass(frozen=True, eq=False)
class RigChange:
    """A cause of the whole rig.

    Attributes:
        candidate: The cause.
        derivatives: Change of the rigid columns per unit of each coefficient at some samples of each stretch,
            (m', n, b, k); empty: the bodies change.
        build: Changes of bodies with given coefficients, which need not be linear in them.
        width: Number of coefficients.
    """

    candidate: Candidate
    derivatives: tuple[Array, ...] = ()
    build: BuildBodies = lambda _: []
    width: int = 0

    def build_columns(self, problem: Problem, theta: Array, size: Array | None = None) -> Columns:
        """Return the columns for a model's coefficients, made linear at some of the cause's.

        Args:
            problem: The rows.
            theta: The model's coefficients.
            size: Coefficients of the cause, (k,); None: 0.
        """
        rows = problem.rows
        offset: tuple[Array, ...] = ()
        if self.derivatives:
            beta = problem.urdf + theta[: problem.base_count]
            torques = tuple(
                _interpolate(np.moveaxis(x, -1, -2) @ beta, len(part.time))
                for x, part in zip(self.derivatives, rows.stretches)
            )
        else:
            at = np.zeros(self.width) if size is None else size
            slope, rest = linearise_bodies(problem, self.build, at)
            torques = tuple(Y @ slope for Y in problem.regressor)
            if at.any():
                offset = tuple(Y @ rest for Y in problem.regressor)
        projected = {j: rows.project([x[:, j] for x in torques], j) for j in problem.joints}
        return Columns(torques, projected, None, offset)


def _interpolate(values: Array, count: int) -> Array:
    """Return values at evenly spaced samples, from the first on, of a stretch, (m', ...), at all of them, (m, ...)."""
    step = -(-count // len(values))
    spline = make_interp_spline(step * np.arange(len(values)), values, k=1)
    return np.asarray(spline(np.arange(count)))


def linearise_bodies(problem: Problem, build: BuildBodies, size: Array) -> tuple[Array, Array]:
    """Return slope (b, k) and rest (b,) of bodies' change of base parameters about some coefficients.

    The change is ``slope x + rest``. Where no body can be so, the slope at zero has to do.
    """
    rig = problem.rig
    places = name_columns(rig)[1]

    def compute_change(values: Array) -> Array:
        change = sum(cause.apply(rig).phi - rig.phi for cause in build(values))
        return np.asarray(problem.reduction.mixing @ np.asarray(change)[places])

    try:
        start = compute_change(size)
        steps = RELATIVE_STEP * np.maximum(np.abs(size), LEAST_CHANGE)
        moved = [compute_change(size + step) for step in np.diag(steps)]
    except UsageError:
        if not size.any():
            raise
        return linearise_bodies(problem, build, np.zeros_like(size))
    slope = (np.stack(moved, axis=1) - start[:, None]) / steps
    return slope, start - slope @ size


def list_rig_changes(problem: Problem, platforms: Sequence[Platform | None]) -> list[RigChange]:
    """Return what may change in the whole rig: an encoder's zero, gravity's direction, and trusted bodies."""
    rig = problem.rig
    changes = [_differentiate(problem, platforms, j) for j in (*problem.joints, None)]
    changes = [
        x for x in changes if any(np.any(Z.swapaxes(-1, -2) @ problem.urdf) for Z in x.derivatives)
    ]
    if rig.config.inertia == "trusted":
        changes += _list_body_changes(problem)
    return changes


def _differentiate(
    problem: Problem, platforms: Sequence[Platform | None], joint: int | None
) -> RigChange:
    """Return the derivatives by a joint's angle, or by turns of gravity about two axes across it."""
    rig = problem.rig
    gravity = rig.model.gravity.linear
    places = find_base_columns(rig, problem.reduction)
    axes = np.eye(3)[np.sort(np.argsort(np.abs(gravity))[:2])]
    derivatives = list[Array]()
    for part, platform, start in zip(problem.rows.stretches, platforms, problem.regressor):
        at = slice(None, None, max(1, int(COARSE_SECONDS / part.dt)))
        x = part.samples.select(at)
        base = None if platform is None else platform.part(at)
        moved = [(x.q + STEP * (np.arange(rig.n) == joint), base)]
        if joint is None:
            stands = base or build_standing_platform(x.t, -gravity)
            turns = [stands.f + STEP * np.cross(axis, stands.f) for axis in axes]
            moved = [(x.q, replace(stands, f=f)) for f in turns]
        columns = [compute_regressor(rig, q, x.v, x.a, other, places) for q, other in moved]
        derivatives.append(np.stack([(Y - start[at]) / STEP for Y in columns], axis=-1))
    cause = BaseTilt() if joint is None else EncoderOffset(rig.joints[joint], 0.0)
    share = 0.0 if joint is None else log(rig.n)
    candidate = Candidate(cause, None, LOG_PRIORS.get(cause.name, 0.0) - share)
    return RigChange(candidate, tuple(derivatives))


def build_standing_platform(t: Array, force: Array) -> Platform:
    """Return the motion of a base that stands with some specific force, m/s², (3,)."""
    still = np.zeros((len(t), 3))
    return Platform(t, np.tile(force, (len(t), 1)), still, still)


def _list_body_changes(problem: Problem) -> Iterator[RigChange]:
    """Yield what may differ in bodies that the URDF states rightly otherwise."""
    rig = problem.rig
    corners = [form for form in PayloadMass.forms(rig) if len(form) > 1]

    def build_weights(values: Array) -> list[RigEffect]:
        pairs = zip(corners, values.tolist())
        return [PayloadMass(**{**corner, "extra": extra}) for corner, extra in pairs]

    forms: list[tuple[RigEffect, BuildBodies, int]] = [
        (PayloadShift(), lambda x: [PayloadShift(*x.tolist())], 3),
        (PayloadMass(0.0), lambda x: [PayloadMass(*x.tolist())], 1),
    ]
    if corners:
        forms.append((PayloadMass(**corners[0]), build_weights, len(corners)))
    for joint in rig.joints:
        forms.append((OffDiagonalInertia(joint), partial(_build_products, joint), 3))
    for cause, build, width in forms:
        try:
            slope = linearise_bodies(problem, build, np.zeros(width))[0]
        except UsageError:  # the rig has no payload, or no body can be so
            continue
        if np.any(np.abs(slope) > INVISIBLE * np.abs(problem.urdf).max()):
            candidate = Candidate(cause, None, LOG_PRIORS.get(cause.name, 0.0))
            yield RigChange(candidate, build=build, width=width)


def _build_products(joint: str, values: Array) -> list[RigEffect]:
    """Return products of inertia at a joint, kg m², (3,)."""
    return [OffDiagonalInertia(joint, *values.tolist())]
