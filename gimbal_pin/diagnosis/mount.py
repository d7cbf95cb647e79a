"""Direction of gravity at the base as a whole, before any search: a rig may hang or lie on its side.

With the specific force f of the base, a base that stands has ``τ = Y_0 β + Σ_i f_i Y_i β``: Y_0 is the regressor
without gravity, Y_i its change per unit of f along base axis i.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import asin, atan2, pi

import numpy as np
import pinocchio as pin

from gimbal_pin.diagnosis.problem import Problem
from gimbal_pin.diagnosis.rows import OUTER, Rows
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.effects import BaseTilt
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.rig import GRAVITY, Rig

COARSE_SECONDS = 0.04
"""Interval of the samples that are compared, s."""
FOLDS = 6
"""Folds of the comparison."""
RIDGE = 1e-6
"""Ridge on columns of unit norm."""
MOST_STEPS = 6
"""Most Gauss-Newton steps."""
STEP_SHARES = (1.0, 0.3)
"""Shares of a step that are tried."""
LEAST_PROGRESS = 0.99
"""Squared error after a step over that before from which steps end."""
DIRECTIONS = np.array([x for x in product((-1.0, 0.0, 1.0), repeat=3) if any(x)])
"""Directions that are tried first: faces, edges and corners of a cube, (26, 3)."""


@dataclass(frozen=True)
class Mount:
    """Another direction of gravity than the URDF's.

    Attributes:
        force: Specific force of the base at rest, m/s², (3,).
        angle: Angle between it and the URDF's, rad.
        share: Share of the held-out squared error that it removes.
    """

    force: tuple[float, float, float]
    angle: float
    share: float

    def mirrored(self) -> Mount:
        """Return the opposite direction: with all first moments reversed, too, it asks for the same torques."""
        x, y, z = self.force
        return Mount((-x, -y, -z), pi - self.angle, self.share)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Torques of all joints as functions of the specific force: columns (4, rows, b), friction, torque and folds."""

    columns: Array
    friction: Array
    torque: Array
    fold: Array

    def build(self, force: Array) -> Array:
        """Return the columns of a specific force, of unit norm."""
        rigid = self.columns[0] + np.tensordot(force, self.columns[1:], 1)
        stacked = np.hstack([rigid, self.friction])
        norms = np.linalg.norm(stacked, axis=0)
        kept = norms > 1e-9 * norms.max()
        return np.asarray(stacked[:, kept] / norms[kept])

    def measure(self, force: Array) -> float:
        """Return the held-out squared error of a specific force."""
        X = self.build(force)
        gram = X.T @ X + RIDGE * np.eye(X.shape[1])
        right = X.T @ self.torque
        total = 0.0
        for k in range(FOLDS):
            own = self.fold == k
            less = X[own].T @ X[own]
            values = np.linalg.solve(gram - less, right - X[own].T @ self.torque[own])
            total += float(np.sum((self.torque[own] - X[own] @ values) ** 2))
        return total

    def improve(self, force: Array) -> tuple[float, Array]:
        """Return the squared error and the direction that Gauss-Newton steps in the tangent plane lead to."""
        now = self.measure(force)
        for _ in range(MOST_STEPS):
            rigid = self.columns[0] + np.tensordot(force, self.columns[1:], 1)
            X = np.hstack([rigid, self.friction])
            beta = np.linalg.lstsq(X, self.torque, rcond=1e-7)[0]
            along = force / np.linalg.norm(force)
            plane = np.linalg.svd(np.eye(3) - np.outer(along, along))[0][:, :2]
            change = np.stack([Y @ beta[: rigid.shape[1]] for Y in self.columns[1:]], 1) @ plane
            change -= X @ np.linalg.lstsq(X, change, rcond=1e-7)[0]
            step = plane @ np.linalg.lstsq(change, self.torque - X @ beta, rcond=1e-6)[0]
            tried = [_to_gravity(force + share * step) for share in STEP_SHARES]
            error, best = min(((self.measure(f), f) for f in tried), key=lambda pair: pair[0])
            if error > LEAST_PROGRESS * now:
                break
            now = error
            force = best
        return now, force


def find_mount(rig: Rig, rows: Rows) -> Mount:
    """Return the direction of gravity that predicts the torques of a standing base best."""
    equations = _build_equations(rig, rows)
    given = _to_gravity(-rig.model.gravity.linear)
    before = equations.measure(given)
    tried = [(equations.measure(_to_gravity(x)), _to_gravity(x)) for x in DIRECTIONS]
    coarse = min(tried, key=lambda pair: pair[0])
    starts = [given] if coarse[0] > before else [given, coarse[1]]
    after, force = min((equations.improve(f) for f in starts), key=lambda pair: pair[0])
    cosine = float(np.clip(force @ given / GRAVITY**2, -1.0, 1.0))
    x, y, z = force.tolist()
    return Mount((x, y, z), float(np.arccos(cosine)), 1.0 - after / max(before, 1e-300))


def find_turn(problem: Problem, solution: Solution) -> Mount | None:
    """Return the direction of gravity that a model has found as a small turn; None: it has none."""
    turns = [one for one in solution.accepted if isinstance(one.cause, BaseTilt)]
    if not turns:
        return None
    roll, pitch = (-solution.fit.theta[solution.get_places(turns[0], problem)]).tolist()
    rotation = pin.rpy.rpyToMatrix(roll, pitch, 0.0)
    given = -problem.rig.model.gravity.linear
    x, y, z = (rotation.T @ given).tolist()
    cosine = float((rotation.T @ given) @ given / (given @ given))
    return Mount((x, y, z), float(np.arccos(np.clip(cosine, -1.0, 1.0))), 1.0)


@dataclass(frozen=True)
class Tilt:
    """Another direction of gravity as a lean of the base.

    Attributes:
        cause: The lean.
        std: Name of an angle → its standard deviation, rad.
    """

    cause: BaseTilt
    std: Mapping[str, float]


def measure_tilt(search: Search, solution: Solution, mount: Mount) -> Tilt:
    """Return the lean ``f = Rᵀ f_0``, ``R = Ry(pitch) Rx(roll)``, of a base with specific force f.

    A further small turn that the model has found is part of it. The deviations are those of such a turn.
    """
    force = np.array(mount.force)
    std = dict[str, float]()
    turns = [x.candidate for x in search.changes if isinstance(x.candidate.cause, BaseTilt)]
    for turn in turns:
        kept = [one for one in solution.accepted if one != turn]
        turned = search.solve([*kept, turn], solution)
        variance = np.diag(turned.fit.covariance)[turned.get_places(turn, search.problem)]
        std = dict(zip(("roll", "pitch"), np.sqrt(variance).tolist()))
        if turn in solution.accepted:
            roll, pitch = (-solution.fit.theta[solution.get_places(turn, search.problem)]).tolist()
            force = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ force
    x, y, z = (force / np.linalg.norm(force)).tolist()
    return Tilt(BaseTilt(roll=atan2(y, z), pitch=-asin(min(max(x, -1.0), 1.0))), std)


def _to_gravity(force: Array) -> Array:
    """Return a vector with the size of gravity."""
    return np.asarray(GRAVITY * force / np.linalg.norm(force))


def _build_equations(rig: Rig, rows: Rows) -> _Equations:
    """Return the equations at samples some hundredths of a second apart."""
    places = find_base_columns(rig, reduce_parameters(rig, base="tilted"))
    n = rig.n
    columns = list[Array]()
    friction = list[Array]()
    torque = list[Array]()
    fold = list[Array]()
    forces = np.vstack([np.zeros(3), np.eye(3)])
    for part in rows.stretches:
        at = np.arange(0, len(part.time), max(1, int(COARSE_SECONDS / part.dt)))
        block = part.block[np.minimum(at * part.count // len(part.time), part.count - 1)]
        at = at[block != OUTER]
        block = block[block != OUTER]
        x = part.samples
        still = np.zeros((len(at), 3))
        each = [
            compute_regressor(
                rig,
                x.q[at],
                x.v[at],
                x.a[at],
                Platform(part.time[at], np.tile(f, (len(at), 1)), still, still),
                places,
            )
            for f in forces
        ]
        weight = part.weight[at]
        rigid = np.stack([each[0], *(Y - each[0] for Y in each[1:])])
        columns.append((rigid * weight[None, :, :, None]).reshape(4, -1, len(places)))
        own = np.zeros((len(at), n, 3 * n))
        for j in range(n):
            own[:, j, 3 * j] = part.direction[at, j]
            own[:, j, 3 * j + 1] = x.v[at, j]
            own[:, j, 3 * j + 2] = 1.0
        friction.append((own * weight[:, :, None]).reshape(-1, 3 * n))
        torque.append((x.tau[at] * weight).ravel())
        fold.append(np.repeat(block % FOLDS, n))
    y = np.concatenate(torque)
    joint = np.tile(np.arange(n), len(y) // n)
    scale = np.array([1.0 / (y[joint == j].std() + 1e-12) for j in range(n)])[joint]
    return _Equations(
        np.concatenate(columns, axis=1) * scale[None, :, None],
        np.concatenate(friction) * scale[:, None],
        y * scale,
        np.concatenate(fold),
    )
