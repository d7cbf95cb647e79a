"""Causes of the whole rig as columns: derivatives of the torque by an encoder's offset, gravity or bodies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from gimbal_pin.diagnosis.candidates import LOG_PRIORS, Candidate
from gimbal_pin.diagnosis.problem import Columns, Problem
from gimbal_pin.diagnosis.rows import Stretch
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
from gimbal_pin.rig.rig import Rig

COARSE_SECONDS = 0.02
"""Interval at which derivatives are evaluated, s: a fourth of a period of 12 Hz; they are interpolated between."""
RELATIVE_STEP = 1e-3
"""Step of the same about a size, as a share of it."""
STEP = 1e-4
"""Angle by which they are differenced, rad."""
INVISIBLE = 1e-6
"""Size of a direction's torque, as a share of the largest, from which the log shows it."""


@dataclass(frozen=True, eq=False)
class RigChange:
    """A cause of the whole rig, linear in its coefficients.

    Attributes:
        candidate: The cause.
        times: Samples of each stretch at which its derivatives are known.
        derivatives: Change of the rigid columns per unit of each coefficient at these, (k, m', n, b) per stretch.
        parameters: Change of the base parameters per unit of each coefficient, (b, k); None: the columns change.
        build: The bodies' cause of given coefficients, which need not be linear in them; None: the columns change.
    """

    candidate: Candidate
    times: tuple[Array, ...] = ()
    derivatives: tuple[Array, ...] = ()
    parameters: Array | None = None
    build: Callable[[Array], RigEffect] | None = None

    def build_columns(self, problem: Problem, theta: Array, size: Array | None = None) -> Columns:
        """Return its columns for a model's coefficients, made linear at some of its own.

        Args:
            problem: The rows.
            theta: The model's coefficients.
            size: Its own, (k,); None: 0.
        """
        rows = problem.rows
        offset: tuple[Array, ...] = ()
        if self.parameters is not None:
            slope = self.parameters
            if size is not None and self.build is not None:
                slope, rest = _linearise(problem, self.build, size, self.parameters)
                offset = tuple(Y @ rest for Y in problem.regressor)
            torques = tuple(Y @ slope for Y in problem.regressor)
        else:
            beta = problem.urdf + theta[: problem.base_count]
            torques = tuple(
                np.asarray(_interpolate(np.stack([Z @ beta for Z in own], axis=-1), times, part))
                for own, times, part in zip(self.derivatives, self.times, rows.stretches)
            )
        projected = {j: rows.project([x[:, j] for x in torques], j) for j in problem.joints}
        return Columns(torques, projected, None, offset)


def _linearise(
    problem: Problem, build: Callable[[Array], RigEffect], size: Array, slope: Array
) -> tuple[Array, Array]:
    """Return slope (b, k) and rest (b,) of a body's change of base parameters about a size: slope x + rest."""
    rig = problem.rig
    places = name_columns(rig)[1]

    def compute_change(values: Array) -> Array:
        return np.asarray(
            problem.reduction.mixing @ (build(values).apply(rig).phi - rig.phi)[places]
        )

    try:
        at = compute_change(size)
        steps = np.diag(np.maximum(np.abs(size), 1e-6)) * RELATIVE_STEP
        columns = [(compute_change(size + step) - at) / step.max() for step in steps]
    except UsageError:  # no body can be so: the slope at zero has to do
        return slope, np.zeros(len(slope))
    local = np.stack(columns, axis=1)
    return local, at - local @ size


def _interpolate(values: Array, times: Array, part: Stretch) -> Array:
    """Return values at some samples, (m', n, k), at all of a stretch, (m, n, k)."""
    count = len(part.time)
    left = np.clip(np.searchsorted(times, np.arange(count), side="right") - 1, 0, len(times) - 2)
    share = (np.arange(count) - times[left]) / (times[left + 1] - times[left])
    share = share[:, None, None]
    return np.asarray(values[left] * (1 - share) + values[left + 1] * share)


def list_rig_changes(problem: Problem, platforms: Sequence[Platform | None]) -> list[RigChange]:
    """Return what may change in the whole rig: an encoder's zero, gravity's direction, and trusted bodies."""
    rig = problem.rig
    changes = list[RigChange]()
    for j, joint in enumerate(rig.joints):
        cause = EncoderOffset(joint, 0.0)
        candidate = Candidate(cause, None, LOG_PRIORS.get(cause.name, 0.0) - log(rig.n))
        changes.append(_differentiate(problem, platforms, candidate, joint=j))
    tilt = Candidate(BaseTilt(), None, LOG_PRIORS["base-tilt"])
    changes.append(_differentiate(problem, platforms, tilt))
    if rig.config.inertia == "trusted":
        changes += _list_body_changes(problem)
    return [change for change in changes if _is_visible(change, problem)]


def _is_visible(change: RigChange, problem: Problem) -> bool:
    """Return whether a change moves any torque."""
    if change.parameters is not None:
        return bool(np.any(change.parameters))
    return any(np.any(x @ problem.urdf) for x in change.derivatives)


def _differentiate(
    problem: Problem,
    platforms: Sequence[Platform | None],
    candidate: Candidate,
    joint: int | None = None,
) -> RigChange:
    """Return the derivatives by a joint's angle, or by turns of gravity about two axes across it."""
    rig = problem.rig
    places = find_base_columns(rig, problem.reduction)
    times = list[Array]()
    derivatives = list[Array]()
    for part, platform in zip(problem.rows.stretches, platforms):
        count = len(part.time)
        step = max(1, int(COARSE_SECONDS / part.dt))
        at = np.unique(np.r_[np.arange(0, count, step), count - 1])
        x = part.samples
        state = x.q[at], x.v[at], x.a[at]
        base = _select_platform(platform, at)
        if joint is not None:
            moved = state[0].copy()
            moved[:, joint] += STEP
            shifted = [(moved, base)]
            start = compute_regressor(rig, *state, base, places)
        else:
            stands = base or _stand(rig, part.time[at])
            shifted = [
                (
                    state[0],
                    Platform(
                        stands.t, stands.f + STEP * np.cross(axis, stands.f), stands.w, stands.dw
                    ),
                )
                for axis in _list_tilt_axes(rig)
            ]
            start = compute_regressor(rig, *state, stands, places)
        derivatives.append(
            np.stack(
                [
                    (compute_regressor(rig, q, state[1], state[2], other, places) - start) / STEP
                    for q, other in shifted
                ]
            )
        )
        times.append(at)
    return RigChange(candidate, tuple(times), tuple(derivatives))


def _select_platform(platform: Platform | None, at: Array) -> Platform | None:
    """Return a base's motion at some samples."""
    if platform is None:
        return None
    return Platform(platform.t[at], platform.f[at], platform.w[at], platform.dw[at])


def _stand(rig: Rig, t: Array) -> Platform:
    """Return the motion of a base that stands as the URDF says."""
    still = np.zeros((len(t), 3))
    return Platform(t, np.tile(-rig.model.gravity.linear, (len(t), 1)), still, still)


def _list_tilt_axes(rig: Rig) -> Array:
    """Return the base's x and y, or of a gravity along them the axes across it, (2, 3)."""
    along = rig.model.gravity.linear / np.linalg.norm(rig.model.gravity.linear)
    keep = np.argsort(np.abs(along))[:2]
    return np.eye(3)[np.sort(keep)]


def _list_body_changes(problem: Problem) -> list[RigChange]:
    """Return what may differ in bodies that the URDF states rightly otherwise."""
    rig = problem.rig
    places = name_columns(rig)[1]

    def compute_change(cause: RigEffect, size: float) -> Array:
        return np.asarray(
            problem.reduction.mixing @ (cause.apply(rig).phi - rig.phi)[places] / size
        )

    forms: list[tuple[RigEffect, list[tuple[RigEffect, float]]]] = [
        (PayloadShift(), [(PayloadShift(**{axis: 1e-4}), 1e-4) for axis in "xyz"]),
        (PayloadMass(0.0), [(PayloadMass(1e-3), 1e-3)]),
    ]
    corners = [form for form in PayloadMass.forms(rig) if len(form) > 1]
    if corners:
        weights = [(PayloadMass(**{**corner, "extra": 1e-3}), 1e-3) for corner in corners]
        forms.append((PayloadMass(**{**corners[0], "extra": 0.0}), [*weights]))
    for joint in rig.joints:
        products = [
            (OffDiagonalInertia(joint, **{name: 1e-7}), 1e-7) for name in ("Ixy", "Ixz", "Iyz")
        ]
        forms.append((OffDiagonalInertia(joint), [*products]))
    changes = list[RigChange]()
    for cause, steps in forms:
        columns = list[Array]()
        for step, size in steps:
            try:
                columns.append(compute_change(step, size))
            except UsageError:  # the rig has no payload, or no body can be so
                continue
        shown = [x for x in columns if np.any(np.abs(x) > INVISIBLE * np.abs(problem.urdf).max())]
        if shown:
            candidate = Candidate(cause, None, LOG_PRIORS.get(cause.name, 0.0))
            parameters = np.stack(shown, axis=1)
            build = _build_shift if cause.name == "payload-shift" and len(shown) == 3 else None
            changes.append(RigChange(candidate, parameters=parameters, build=build))
    return changes


def _build_shift(values: Array) -> RigEffect:
    """Return a payload moved by so much, m, (3,)."""
    x, y, z = values.tolist()
    return PayloadShift(x, y, z)
