"""The bodies that fit best among those that can exist: a semidefinite program of small blocks.

``minimise ½ ‖F K φ - y‖² + μ Σ D(P_i ‖ P_i⁰)`` over physical φ, with the divergence of each body's pseudo-inertia from
the URDF's, ``D = tr(P P⁰⁻¹) - log det(P P⁰⁻¹) - 4`` (Lee, Wensing and Park 2020). D is convex in φ, infinite at the
edge of what can exist, and the same in any frame and unit: it is at once the barrier of an interior-point method, whose
μ goes to zero, and what settles the directions that the data do not show. Least squares in log-Cholesky parameters
has the same minimum and does not get there: in them the data's quadratic is a narrow, curved valley with its end at
infinity wherever the best bodies lie on the edge, and any pull that keeps them finite holds them off it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gimbal_pin.errors import DataError
from gimbal_pin.regression.linalg import whiten
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.inertia import pseudo_inertia, thicken_flat_body
from gimbal_pin.rig.types import Array

BARRIER_WEIGHTS = tuple(10.0 ** (0.5 * k) for k in range(2, -17, -1))
"""μ from stage to stage, in units of half a squared deviation; the last decides how near the edge it ends."""
LEANT_WEIGHTS = BARRIER_WEIGHTS[:5]
"""Stages that end at μ = 0.1: that moves an estimate by a share of a deviation, and a body that a log hardly shows does
not end at twenty times the URDF's mass."""
_STEPS = 50
"""Most Newton steps per stage; three or four do."""
_SETTLED = 1e-4
"""Squared Newton decrement, over μ, at which a stage has settled."""
_WITHIN = 0.9
"""Share of the way to the edge that one step may go."""
_MARGIN = 1e-6
"""Every body keeps at least this share of the URDF's, a little fattened: what is written to a file stays physical."""
PSEUDO_INERTIA_BASIS = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
"""Pseudo-inertia per inertial parameter, (10, 4, 4)."""
_PARAMETERS = np.linalg.pinv(PSEUDO_INERTIA_BASIS.reshape(10, 16).T)
"""Inertial parameters per entry of a pseudo-inertia, (10, 16)."""


@dataclass(frozen=True, eq=False)
class Consistent:
    """The physical parameters nearest to an estimate, or to data.

    Attributes:
        phi: Inertial parameters, (10 n,), every body physical.
        distance: Distance of their base parameters from the unconstrained ones in standard deviations (Mahalanobis).
    """

    phi: Array
    distance: float

    __repr__ = brief


class _Body(NamedTuple):
    """One body at one point, in coordinates s in which ``P = L (1 + Σ s_k S_k) Lᵀ`` with S_k orthonormal, symmetric.

    There the Hessian of D is the identity, whatever the body.

    Attributes:
        L: A root of the pseudo-inertia: as long as that is what is kept, rounding cannot lead out of what can exist.
        phi: Inertial parameters, (10,).
        jacobian: Change of phi per coordinate, (10, 10).
        divergence: D.
        slope: Gradient of D, (10,).
    """

    L: Array
    phi: Array
    jacobian: Array
    divergence: float
    slope: Array


_ROW, _COLUMN = np.tril_indices(4)
_SYMMETRIC = np.zeros((10, 4, 4))
"""Orthonormal symmetric matrices S_k."""
_SYMMETRIC[range(10), _ROW, _COLUMN] = np.where(_ROW == _COLUMN, 1, 0.5**0.5)
_SYMMETRIC[range(10), _COLUMN, _ROW] = _SYMMETRIC[range(10), _ROW, _COLUMN]


def find_nearest_bodies(
    start: Array,
    mixing: Array,
    beta: Array,
    covariance: Array,
    weights: Sequence[float] = BARRIER_WEIGHTS,
) -> Consistent:
    """``argmin (K φ - β)ᵀ P⁻¹ (K φ - β)`` over physical φ; nearest to `start` (least D) where K shows nothing.

    With stages that end at a larger μ also where K shows little, see `find_likeliest_bodies`.

    Args:
        start: Parameters to start from and to stay near, physical or on the edge of it (a flat plate), (10 n,).
        mixing: K: base parameters per entry of φ, (b, 10 n).
        beta: Estimated base parameters, (b,).
        covariance: P, their covariance, (b, b).
        weights: μ from stage to stage.

    Raises:
        DataError: A variance is infinite; or the estimate is so far from all bodies that numbers end before one is
            reached.
    """
    if np.isinf(covariance).any():
        what, mend = (
            "are not all shown by the logs",
            "move every joint, several at a time: see 'gimbal-pin excite'",
        )
        raise DataError("the identified parameters", what, mend)
    try:
        W = whiten(covariance)
        return fit_bodies(start, W @ mixing, W @ beta, weights)
    except np.linalg.LinAlgError as error:
        mend = "look at the units of t, q and tau, and map them (--map)"
        raise DataError(
            "the identified parameters", "are near to no bodies that can exist", mend
        ) from error


def find_likeliest_bodies(
    start: Array, mixing: Array, beta: Array, covariance: Array, trust: float
) -> Array:
    """Return the most likely bodies, (10 n,), where every one is `start`'s, deformed at random by `trust`.

    That is μ = 1 / trust²: near `start`, D is half the squared length of a deformation, see
    `compute_deformation_root`. What the log
    shows well, it decides; what it does not stays as it was. Arguments as for `find_nearest_bodies`.
    """
    weight = 1.0 / trust**2
    weights = [*(w for w in BARRIER_WEIGHTS if w > weight), weight]
    return find_nearest_bodies(start, mixing, beta, covariance, weights).phi


def fit_bodies(
    start: Array, rows: Array, target: Array, weights: Sequence[float] = BARRIER_WEIGHTS
) -> Consistent:
    """``argmin ‖rows φ - target‖`` over physical φ, least D from `start` where the rows show nothing.

    Args:
        start: Parameters to start from, (10 n,).
        rows: F K: whitened rows per entry of φ, (r, 10 n).
        target: y, (r,).
        weights: μ from stage to stage.

    Returns:
        The bodies; their distance is how much longer the residual is than without the constraint, in quadrature.
    """
    bodies = [thicken_flat_body(body) for body in np.reshape(start, (-1, 10))]
    roots = [pseudo_inertia(body) for body in bodies]
    inverses = [np.linalg.inv(P) for P in roots]
    margin = np.array(bodies)
    # As thick as each is wide: the mean of its second moments added to each.
    margin[:, [4, 6, 9]] += 2.0 * np.array([[np.trace(P[:3, :3])] for P in roots]) / 3.0
    margin = _MARGIN * margin.ravel()
    now = [_place_body(np.linalg.cholesky(P), inverse) for P, inverse in zip(roots, inverses)]
    for weight in weights:
        now = _minimise(now, rows, target - rows @ margin, inverses, weight)
    phi = np.concatenate([body.phi for body in now]) + margin
    free = np.linalg.lstsq(rows, target, rcond=None)[0]
    return Consistent(phi, float(np.linalg.norm(rows @ (phi - free))))


def _minimise(
    now: list[_Body], rows: Array, target: Array, inverses: list[Array], weight: float
) -> list[_Body]:
    """Return the minimum of ``½ ‖rows φ - target‖² + μ Σ D`` by Newton's method, within what can exist.

    ``[F K J; √μ] s = -[r; √μ ∇D]`` by orthogonal factors: forming the Hessian would square the condition number.
    """

    def residual(bodies: list[_Body]) -> tuple[Array, float]:
        rest = rows @ np.concatenate([body.phi for body in bodies]) - target
        return rest, float(0.5 * rest @ rest + weight * sum(body.divergence for body in bodies))

    root = np.sqrt(weight)
    for _ in range(_STEPS):
        rest, cost = residual(now)
        data = np.concatenate(
            [rows[:, 10 * i : 10 * i + 10] @ body.jacobian for i, body in enumerate(now)], axis=1
        )
        Q, R = np.linalg.qr(np.vstack([data, root * np.eye(10 * len(now))]))
        projected = -Q.T @ np.concatenate([rest, *(root * body.slope for body in now)])
        decrement = float(projected @ projected)
        if decrement < _SETTLED * weight:
            break
        changes = np.einsum(
            "bk,kij->bij", np.linalg.solve(R, projected).reshape(-1, 10), _SYMMETRIC
        )
        least = float(np.linalg.eigvalsh(changes).min())  # -1 / least such steps lead to the edge
        share = min(1.0, _WITHIN * -1.0 / least) if least < 0 else 1.0
        while True:
            moved = [
                body.L @ np.linalg.cholesky(np.eye(4) + share * change)
                for body, change in zip(now, changes)
            ]
            after = [_place_body(L, inverse) for L, inverse in zip(moved, inverses)]
            if residual(after)[1] <= cost - 0.1 * share * decrement:
                break
            share /= 2
            if share < 1e-9:
                return now
        now = after
    return now


def _place_body(L: Array, inverse: Array) -> _Body:
    """Return the body of a root of its pseudo-inertia, (4, 4); `inverse` is that of the URDF's pseudo-inertia."""
    ratio = L.T @ inverse @ L
    jacobian = _PARAMETERS @ (L @ _SYMMETRIC @ L.T).reshape(10, 16).T
    slope = np.einsum("kij,ij->k", _SYMMETRIC, ratio - np.eye(4))
    divergence = float(np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 4.0)
    return _Body(L, _PARAMETERS @ (L @ L.T).ravel(), jacobian, divergence, slope)


def compute_deformation_root(phi: Array) -> Array:
    """A root of the covariance G of bodies' parameters, (10 n, 10 n), if each is deformed at random by 100 %.

    ``P = L (1 + S) Lᵀ`` with S symmetric and its orthonormal coordinates of unit variance: the deviation is that of
    the divergence D, and so the same in any frame and unit; of a mass it is the mass itself.
    """
    out = np.zeros((len(phi), len(phi)))
    for body, part in enumerate(np.reshape(phi, (-1, 10))):
        P = pseudo_inertia(thicken_flat_body(part))
        at = slice(10 * body, 10 * body + 10)
        out[at, at] = _place_body(np.linalg.cholesky(P), np.linalg.inv(P)).jacobian
    return out
