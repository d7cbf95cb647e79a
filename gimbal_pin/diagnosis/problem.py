"""Parts that every model of a log has: rigid columns, friction, a time shift per joint, and the prior of the URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from gimbal_pin.diagnosis.rows import Rows
from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.regressor import (
    compute_gravity,
    compute_inertia_regressor,
    compute_regressor,
    name_columns,
)
from gimbal_pin.effects import Cause, Sample
from gimbal_pin.effects.base import AMBIENT
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.regression import INERTIA_SAMPLES, compute_motorless_correction, find_base_columns
from gimbal_pin.rig.rig import Rig

OWN_COLUMNS = 3
"""Columns of each joint in every model: dry friction, viscous friction, time shift."""
SHIFT = 2
"""Place of the time shift among them."""
FIRST_NOISE = 0.05
"""Noise that the first fit assumes, as a share of the torque's rms: a start, which the estimate replaces."""
FELT_WEIGHT = 1e-6
"""Gravity torque, as a share of the largest, below which it is rounding."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Rows of logs and the columns of the model that all hypotheses share.

    Attributes:
        rows: The rows.
        reduction: Base parameters.
        settings: Constants.
        regressor: Rigid columns at the samples of each stretch, (m, n, b).
        known: Torque of the URDF's bodies and stated rotors at these, N m, (m, n).
        rigid: Rows of the rigid columns at each joint, n of (N, b).
        friction: Rows of dry and viscous friction at each joint, n of (N, 2).
        target: Rows of the measured torque less `known`, (N, n).
        measured: Rows of the measured torque, (N, n).
        scale: Rows of the torque beside which errors are small: the measured one; where there is no motor, and all
            terms add up to nothing, the largest term of the URDF's bodies, (N, n).
        urdf: Base parameters of the URDF, (b,).
        precision: Prior precision of a base parameter's difference from it, (b,).
        ranges: What the logs show of each joint.
        inertia: Each joint's own inertia per base parameter, mean over the logs, (n, b).
        weight: Torque that the URDF's bodies ask for at rest along each stretch, N m, (m, n).
        projected: Rows of causes that read no torque, (N, k), which are the same beside every model.
    """

    rows: Rows
    reduction: Reduction
    settings: Settings
    regressor: tuple[Array, ...]
    known: tuple[Array, ...]
    rigid: tuple[Array, ...]
    friction: tuple[Array, ...]
    target: Array
    measured: Array
    scale: Array
    urdf: Array
    precision: Array
    ranges: tuple[OperatingRange, ...]
    inertia: Array
    weight: tuple[Array, ...]
    projected: dict[Cause, Array] = field(default_factory=dict)

    @property
    def rig(self) -> Rig:
        """The rig."""
        return self.rows.rig

    @property
    def joints(self) -> range:
        """Numbers of the joints."""
        return range(self.rows.rig.n)

    @property
    def base_count(self) -> int:
        """Number of base parameters."""
        return len(self.urdf)

    @property
    def own_count(self) -> int:
        """Number of columns without any cause."""
        return self.base_count + OWN_COLUMNS * self.rows.rig.n

    def get_own_columns(self, joint: int) -> slice:
        """Return the places of a joint's friction and time shift."""
        first = self.base_count + OWN_COLUMNS * joint
        return slice(first, first + OWN_COLUMNS)

    def compute_rms(self, rows: Array) -> Array:
        """Return the rms of inner rows (N, n) per effective row at each joint, (n,)."""
        power = np.mean(rows**2, axis=0) / np.maximum(self.rows.used, 1e-9)
        return np.asarray(np.sqrt(power)) + 1e-12

    @property
    def torque_rms(self) -> Array:
        """Rms of the torque beside which errors are small, N m, (n,)."""
        return self.compute_rms(self.scale[self.rows.inner])

    def sample(self, stretch: int, joint: int, torque: Array) -> Sample:
        """Return what a joint's effects read along a stretch; `torque`: the model's own, N m, (m, n)."""
        part = self.rows.stretches[stretch]
        x = part.samples
        return Sample(
            part.time,
            x.q[:, joint],
            x.v[:, joint],
            x.a[:, joint],
            part.direction[:, joint],
            torque[:, joint],
            AMBIENT if part.temperature is None else part.temperature[:, joint],
            weight=self.weight[stretch][:, joint],
            losses=part.losses[joint],
        )


def build_problem(
    rows: Rows, reduction: Reduction, settings: Settings, platforms: Sequence[Platform | None]
) -> Problem:
    """Evaluate the rigid columns along the rows' stretches.

    Args:
        rows: The rows.
        reduction: Base parameters.
        settings: Constants.
        platforms: Motion of the base along each stretch; None: it stands upright.
    """
    rig = rows.rig
    places = find_base_columns(rig, reduction)
    urdf = reduction.mixing @ rig.phi[name_columns(rig)[1]]
    regressor = tuple(
        compute_regressor(rig, part.samples.q, part.samples.v, part.samples.a, platform, places)
        for part, platform in zip(rows.stretches, platforms)
    )
    known = tuple(
        Y @ urdf + rig.armature * part.samples.a for Y, part in zip(regressor, rows.stretches)
    )
    tau = [part.samples.tau for part in rows.stretches]
    measured = _project_joints(rows, tau)
    q = rows.join("q")
    columns = [[Y[:, j] for Y in regressor] for j in range(rig.n)]
    for j in np.flatnonzero(~measured.any(axis=0)).tolist():
        left = [compute_motorless_correction(rig, reduction, j, q, x[:, j]) for x in known]
        columns[j] = [x + y for x, y in zip(columns[j], left)]
    rigid = tuple(rows.project(x, j) for j, x in enumerate(columns))
    motion = [
        [np.column_stack([part.direction[:, j], part.samples.v[:, j]]) for part in rows.stretches]
        for j in range(rig.n)
    ]
    weight = tuple(
        compute_gravity(rig, part.samples.q, platform)
        for part, platform in zip(rows.stretches, platforms)
    )
    stands = all(platform is None for platform in platforms)
    pull = np.max([np.abs(x).max(axis=0) for x in weight], axis=0)
    poses = q[:: max(1, len(q) // INERTIA_SAMPLES)]
    return Problem(
        rows=rows,
        reduction=reduction,
        settings=settings,
        regressor=regressor,
        known=known,
        rigid=rigid,
        friction=tuple(rows.project(motion[j], j) for j in range(rig.n)),
        target=_project_joints(rows, [x - y for x, y in zip(tau, known)]),
        measured=measured,
        scale=np.where(measured.any(axis=0), measured, find_largest_terms(rigid, urdf)),
        urdf=urdf,
        precision=_compute_prior_precision(rig, reduction, urdf, settings),
        ranges=tuple(
            _measure_range(rows, j, stands and bool(pull[j] <= FELT_WEIGHT * pull.max()))
            for j in range(rig.n)
        ),
        inertia=np.array(
            [
                compute_inertia_regressor(rig, poses, j, places)[:, j].mean(axis=0)
                for j in range(rig.n)
            ]
        ),
        weight=weight,
    )


def find_largest_terms(columns: Sequence[Array], coefficients: Array) -> Array:
    """Return at each joint the largest of the terms ``A_k x_k`` of columns (N, k), rms, n of them, (N, n)."""
    terms = [A * coefficients for A in columns]
    return np.stack([x[:, np.argmax(np.sum(x**2, axis=0))] for x in terms], axis=1)


def _project_joints(rows: Rows, signals: Sequence[Array]) -> Array:
    """Return the rows of torques (m, n) per stretch, (N, n)."""
    joints = range(rows.rig.n)
    return np.hstack([rows.project([x[:, j] for x in signals], j) for j in joints])


def _compute_prior_precision(
    rig: Rig, reduction: Reduction, urdf: Array, settings: Settings
) -> Array:
    """Return the prior precision of each base parameter, (b,).

    A parameter's size is its URDF value, the rms of its kind over its link, or a share of the largest of its kind,
    whichever is greatest: a URDF states many parameters as zero that are none.
    """
    names = [reduction.names[k].rsplit(".", 1) for k in reduction.independent]
    # An inertia, a first moment or a mass.
    kinds = [symbol if symbol == "m" else symbol[0] for _, symbol in names]
    groups = [f"{link}.{kind}" for (link, _), kind in zip(names, kinds)]
    group = np.unique(groups, return_inverse=True)[1]
    kind = np.unique(kinds, return_inverse=True)[1]
    rms = np.sqrt(np.bincount(group, urdf**2) / np.bincount(group))[group]
    largest = np.zeros(len(kinds))
    np.maximum.at(largest, kind, rms)
    size = np.maximum.reduce([np.abs(urdf), rms, settings.min_size_share * largest[kind]]) + 1e-12
    is_trusted = rig.config.inertia == "trusted"
    width = settings.trusted_width if is_trusted else settings.prior_width
    return np.asarray((width * size) ** -2.0)


def _measure_range(rows: Rows, joint: int, is_upright: bool) -> OperatingRange:
    """Return what the logs show of a joint."""
    q, v, tau = (rows.join(name)[rows.inner_samples, joint] for name in ("q", "v", "tau"))
    stretches = rows.stretches
    rate, torque = (float(np.quantile(np.abs(x), 0.98)) for x in (v, tau))
    return OperatingRange(
        seconds=rows.seconds,
        dt=stretches[0].dt,
        band=rows.band,
        travel=float(np.ptp(q)),
        rate=rate,
        rate_std=float(np.mean([part.samples.rate_std[joint] for part in stretches])),
        torque=torque,
        peak=float(np.quantile(np.abs(tau), 0.995)),
        upright=is_upright,
        middle=float(q.max() + q.min()) / 2,
        rms=float(np.sqrt(np.mean(tau**2))),
        warm=any(
            part.temperature is not None and np.ptp(part.temperature[:, joint]) > 0
            for part in stretches
        ),
    )


@dataclass(frozen=True, eq=False)
class Whitening:
    """Filter of each joint's rows that makes the noise white.

    Attributes:
        frequencies: Evenly spaced, Hz, (f,).
        gains: Gain of each joint at these, 1/(N m), (n, f).
        floor: What no regression on the motion predicts of each joint, N m rms, (n,).
    """

    frequencies: Array
    gains: Array
    floor: Array

    def apply(self, rows: Rows, columns: Array, joint: int) -> Array:
        """Return whitened inner rows of columns (N, k)."""
        filtered = rows.filter(columns, self.gains[joint], self.frequencies)
        return filtered[rows.inner]

    def apply_each(self, rows: Rows, torque: Array) -> Array:
        """Return whitened inner rows of a torque at each joint, (N, n)."""
        return np.hstack([self.apply(rows, torque[:, [j]], j) for j in range(rows.rig.n)])


def build_flat_whitening(problem: Problem) -> Whitening:
    """Return the whitening before there is an estimate: noise of `FIRST_NOISE` at every frequency."""
    gains = 1.0 / (FIRST_NOISE * problem.torque_rms)
    return Whitening(
        np.array([0.0, problem.rows.band]), np.stack([gains, gains], axis=1), problem.torque_rms
    )


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of one cause along the logs.

    Attributes:
        torques: Torque per coefficient along each stretch, N m, (m, n, k) for the rig and (m, k) at one joint.
        rows: Joint → rows of it, (N, k).
        joint: The joint; None: the whole rig.
        offset: Torque beside the coefficients' along each stretch, N m, (m, n), where the cause is not linear.
        precision: Prior precision of each coefficient; 0 where it is free.
    """

    torques: tuple[Array, ...]
    rows: dict[int, Array]
    joint: int | None
    offset: tuple[Array, ...] = ()
    precision: float = 0.0

    @property
    def width(self) -> int:
        """Number of coefficients."""
        return int(self.torques[0].shape[-1])


def build_base_rows(
    problem: Problem, torque: Sequence[Array], added: Sequence[Columns]
) -> list[Array]:
    """Return the rows of a model's columns at each joint, n of (N, p): rigid, friction and shift, causes."""
    rows = problem.rows
    count = len(rows.inner)
    base = list[Array]()
    for j in problem.joints:
        slopes = [np.gradient(x[:, j], part.dt) for x, part in zip(torque, rows.stretches)]
        friction = np.zeros((count, rows.rig.n, OWN_COLUMNS))
        friction[:, j] = np.hstack([problem.friction[j], rows.project(slopes, j)])
        causes = [x.rows.get(j, np.zeros((count, x.width))) for x in added]
        base.append(np.hstack([problem.rigid[j], friction.reshape(count, -1), *causes]))
    return base


def build_precision(problem: Problem, added: Sequence[Columns]) -> Array:
    """Return the prior precision of a model's coefficients, (p,); friction is free."""
    friction = [0.0, 0.0, 1.0 / problem.settings.shift_prior_seconds**2]
    causes = [np.full(x.width, x.precision) for x in added]
    return np.concatenate([problem.precision, friction * problem.rig.n, *causes])


def compute_torque(problem: Problem, theta: Array, added: Sequence[Columns]) -> list[Array]:
    """Return a model's own torque along each stretch, without its time shifts, N m, (m, n)."""
    friction = theta[problem.base_count : problem.own_count].reshape(-1, OWN_COLUMNS)
    values = split_coefficients(problem, theta, added)
    out = list[Array]()
    for s, part in enumerate(problem.rows.stretches):
        torque = problem.known[s] + problem.regressor[s] @ theta[: problem.base_count]
        torque += friction[:, 0] * part.direction + friction[:, 1] * part.samples.v
        for columns, sizes in zip(added, values):
            at = slice(None) if columns.joint is None else columns.joint
            torque[:, at] += columns.torques[s] @ sizes
            if columns.offset:
                torque += columns.offset[s]
        out.append(torque)
    return out


def split_coefficients(problem: Problem, theta: Array, added: Sequence[Columns]) -> list[Array]:
    """Return the coefficients of each of a model's causes."""
    ends = np.cumsum([problem.own_count, *(x.width for x in added)])
    return [theta[first:last] for first, last in pairwise(ends)]


def build_target(problem: Problem, added: Sequence[Columns]) -> Array:
    """Return the rows of the measured torque less what is known and the causes' offsets, (N, n)."""
    target = problem.target
    for columns in added:
        if columns.offset:
            target = target - _project_joints(problem.rows, columns.offset)
    return target


def replace_torque(problem: Problem, joint: int, torque: Sequence[Array]) -> Problem:
    """Return the problem with another torque that acts at a joint, N m, (m,) per stretch."""
    unknown = [x - known[:, joint] for x, known in zip(torque, problem.known)]
    target = problem.target.copy()
    target[:, [joint]] = problem.rows.project(unknown, joint)
    return replace(problem, target=target)
