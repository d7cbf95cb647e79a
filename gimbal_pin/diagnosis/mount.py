"""Direction of gravity at the base as a whole, before any search: a rig may hang or lie on its side.

With the specific force f of the base, a base that stands has ``τ = Y_0 β + Σ_i f_i Y_i β``: Y_0 is the regressor
without gravity, Y_i its change per unit of f along base axis i.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from math import atan2, hypot, pi

import numpy as np
import pinocchio as pin

from gimbal_pin.diagnosis.problem import Problem
from gimbal_pin.diagnosis.rig_causes import build_standing_platform
from gimbal_pin.diagnosis.rows import OUTER, Rows, Stretch
from gimbal_pin.diagnosis.search import Search, Solution
from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.effects import BaseTilt
from gimbal_pin.log.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig.rig import GRAVITY, Rig

COARSE_SECONDS = 0.04
"""Interval of the samples that are compared, s: a period of twice the band."""
RIDGE = 1e-6
"""Ridge on columns of unit norm."""
DIRECTIONS = np.array([x for x in product((-1.0, 0.0, 1.0), repeat=3) if any(x)])
"""Directions that are tried first: faces, edges and corners of a cube, (26, 3)."""


@dataclass(frozen=True)
class Mount:
    """Another direction of gravity than the URDF's.

    Attributes:
        force: Specific force of the base at rest, m/s², (3,).
        angle: Angle between it and the URDF's, rad.
        share: Share of the squared error that it removes.
    """

    force: tuple[float, float, float]
    angle: float
    share: float

    def mirrored(self) -> Mount:
        """Return the opposite direction: with all first moments reversed, too, it asks for the same torques."""
        x, y, z = self.force
        return Mount((-x, -y, -z), pi - self.angle, self.share)


def find_mount(rig: Rig, rows: Rows, settings: Settings) -> Mount | None:
    """Return the direction of gravity that predicts the torques of a standing base best; None: nearly the URDF's."""
    from scipy.optimize import minimize

    measure = _build_error(rig, rows)
    given = -rig.model.gravity.linear
    before = measure(given)
    coarse = min(DIRECTIONS, key=measure)
    tried = [minimize(measure, start, method="BFGS") for start in (given, coarse)]
    best = min(tried, key=lambda result: float(result.fun))
    mount = _build_mount(best.x, given, 1.0 - best.fun / max(before, 1e-300))
    return mount if mount.angle > settings.small_turn_radians else None


def find_turn(problem: Problem, solution: Solution) -> Mount | None:
    """Return the direction of gravity that a model has found as a small turn; None: it has none."""
    given = -problem.rig.model.gravity.linear
    turned = _add_turn(problem, solution, given)
    return None if np.array_equal(turned, given) else _build_mount(turned, given, 1.0)


def _add_turn(problem: Problem, solution: Solution, force: Array) -> Array:
    """Return a base's specific force with the small turn that a model has found."""
    for turn in solution.accepted:
        if isinstance(turn.cause, BaseTilt):
            roll, pitch = (-solution.fit.theta[solution.get_places(turn, problem)]).tolist()
            force = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ force
    return force


def _build_mount(force: Array, given: Array, share: float) -> Mount:
    """Return a direction of gravity that removes a share of the squared error of the given one."""
    x, y, z = (GRAVITY * force / np.linalg.norm(force)).tolist()
    cosine = force @ given / np.linalg.norm(force) / np.linalg.norm(given)
    return Mount((x, y, z), float(np.arccos(np.clip(cosine, -1.0, 1.0))), share)


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
    std = dict[str, float]()
    for turn in [x.candidate for x in search.changes if isinstance(x.candidate.cause, BaseTilt)]:
        kept = [x for x in solution.accepted if x != turn]
        turned = search.solve([*kept, turn], solution)
        variance = np.diag(turned.fit.covariance)[turned.get_places(turn, search.problem)]
        std = dict(zip(("roll", "pitch"), np.sqrt(variance).tolist()))
    x, y, z = _add_turn(search.problem, solution, np.array(mount.force)).tolist()
    return Tilt(BaseTilt(roll=atan2(y, z), pitch=atan2(-x, hypot(y, z))), std)


def _build_error(rig: Rig, rows: Rows) -> Callable[[Array], float]:
    """Return the squared error, each joint's over its torque's, as a function of the direction of specific force."""
    parts = [_build_equations(rig, part) for part in rows.stretches]
    equations = np.concatenate(parts)
    equations /= np.std(equations[:, :, -1:], axis=0) + 1e-12
    flat = equations.reshape(-1, equations.shape[-1])
    gram = flat.T @ flat
    count = (len(gram) - 1 - 3 * rig.n) // 4
    # Products of the columns of each Y with the friction and the torque, and with those of each Y.
    sides = gram[: 4 * count].reshape(4, -1)
    others = gram[4 * count :, 4 * count :]

    def measure(direction: Array) -> float:
        weights = np.r_[1.0, GRAVITY * direction / np.linalg.norm(direction)]
        mixed = (weights @ sides).reshape(count, -1)
        rigid = np.tensordot(mixed[:, : 4 * count].reshape(count, 4, count), weights, (1, 0))
        beside = mixed[:, 4 * count :]
        products = np.block([[rigid, beside], [beside.T, others]])
        norms = np.sqrt(np.diag(products))
        norms = np.where(norms > 1e-9 * norms.max(), norms, np.inf)
        *_, right = unit = products / np.outer(norms, norms)
        left = unit[:-1, :-1] + RIDGE * np.eye(len(unit) - 1)
        return float(products[-1, -1] * (1.0 - right[:-1] @ np.linalg.solve(left, right[:-1])))

    return measure


def _build_equations(rig: Rig, part: Stretch) -> Array:
    """Return columns and torque at some inner samples, (samples, n, 4 b + 3 n + 1): Y_0 ... Y_3, friction, torque."""
    places = find_base_columns(rig, reduce_parameters(rig, base="tilted"))
    at = np.arange(0, len(part.time), max(1, int(COARSE_SECONDS / part.dt)))
    at = at[part.block[at * part.count // len(part.time)] != OUTER]
    x = part.samples
    t = part.time[at]
    moving, *forced = [
        compute_regressor(rig, x.q[at], x.v[at], x.a[at], build_standing_platform(t, f), places)
        for f in np.vstack([np.zeros(3), np.eye(3)])
    ]
    laws = np.stack([part.direction[at], x.v[at], np.ones_like(x.v[at])], axis=-1)
    friction = (np.eye(rig.n)[:, :, None] * laws[:, :, None]).reshape(len(at), rig.n, 3 * rig.n)
    columns = [moving, *(Y - moving for Y in forced), friction, x.tau[at, :, None]]
    return np.concatenate(columns, axis=-1) * part.weight[at][:, :, None]
