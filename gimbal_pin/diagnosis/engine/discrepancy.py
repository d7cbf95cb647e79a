"""δ: a flexible function of the state, and what of a residual it predicts on blocks that it has not seen.

δ is a sum of bumps over a joint's angle (modulo a turn), rate, torque and slow time, the first, third and fourth also
times the direction of motion, and over the other joints' angles and rates, with a ridge (Kennedy and O'Hagan, J. R.
Statist. Soc. B 63, 2001: a discrepancy beside the model's parameters). What it predicts is structure, however good or
poor the sensor is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.state import State
from gimbal_pin.log.log import Array

PREDICTION_FOLDS = 10
"""Parts of the blocks of which each is predicted from the others."""
RIDGES = tuple(np.geomspace(1e-4, 1.0, 5).tolist())
"""Ridges that are tried, in units of the columns' power: the one that predicts best is taken."""
HARDLY = 1e-9
"""The same of columns without a penalty, as far as a fit to part of the rows needs one."""
NEGLIGIBLE = 0.01
"""Share of the least ridge under which a principal component is left out: it would be shrunk to as little."""
ANGLE_BUMPS, RATE_BUMPS, TORQUE_BUMPS, TIME_BUMPS, OTHER_BUMPS = 24, 12, 10, 6, 7
"""Bumps over each variable: a turn in steps of 15°; drift slower than a tenth of the log; another joint's motion."""


def bumps(values: Array, knots: Array) -> Array:
    """``exp(-(x - k)²/2 w²)``, w the distance between knots, (rows, knots)."""
    width = np.maximum(np.gradient(knots), 1e-12)
    return np.asarray(np.exp(-0.5 * ((values[:, None] - knots) / width) ** 2))


def features(evidence: Evidence, torque: Sequence[Array], joint: int) -> Array:
    """Return δ's columns at a joint, whitened, (rows, k); `torque`: the model's, N m, (m, n) per part."""
    return np.concatenate(list(split_by_variable(evidence, torque, joint).values()), axis=1)


def split_by_variable(evidence: Evidence, torque: Sequence[Array], joint: int) -> dict[str, Array]:
    """Return the same apart by what they are functions of."""
    parts = evidence.parts
    rig = evidence.rig
    way = [part.slide[:, joint] for part in parts]
    variables = {
        "over its angle": (angles(evidence, joint), ANGLE_BUMPS, True),
        "over its rate": (rates(evidence, joint), RATE_BUMPS, False),
        "over its torque": ([x[:, joint] for x in torque], TORQUE_BUMPS, True),
        "over time": ([part.time for part in parts], TIME_BUMPS, True),
    }
    for k in (k for k in range(rig.n) if k != joint):
        variables[f"over the angle of {rig.joints[k]}"] = angles(evidence, k), OTHER_BUMPS, False
        variables[f"over the rate of {rig.joints[k]}"] = rates(evidence, k), OTHER_BUMPS, False
    found: dict[str, Array] = {}
    for name, (values, count, both) in variables.items():
        knots = np.unique(np.quantile(np.concatenate(values), np.linspace(0.01, 0.99, count)))
        if len(knots) > 1:
            plain = [bumps(x, knots) for x in values]
            signed = (
                [np.hstack([columns, columns * s[:, None]]) for columns, s in zip(plain, way)]
                if both
                else plain
            )
            found[name] = evidence.whiten(signed, joint)
    return found


def angles(evidence: Evidence, joint: int) -> list[Array]:
    """Return a joint's angle, rad, (m,) per part; within a turn, where it makes more than one."""
    q = [part.channels.q[:, joint] for part in evidence.parts]
    return [np.mod(x, 2 * np.pi) for x in q] if np.ptp(np.concatenate(q)) > 2 * np.pi else q


def rates(evidence: Evidence, joint: int) -> list[Array]:
    """Return a joint's rate, rad/s, (m,) per part."""
    return [part.channels.v[:, joint] for part in evidence.parts]


def unseen(
    free: Array,
    flexible: Array,
    target: Array,
    block: Array | NDArray[np.intp],
    ridges: Sequence[float] = RIDGES,
) -> Array:
    """Return the errors, (rows,), of predicting each fold of blocks from the others: free columns without a penalty.

    Flexible ones have a ridge, the one that predicts best.

    ``θ_k = argmin ‖y - A θ_a - X θ_x‖² + λ N ‖θ_x‖²`` on all but fold k, the columns of unit power: the errors there
    are ``(I - H_kk)⁻¹ (y - ŷ)_k`` of the fit to all (Cook and Weisberg, Residuals and Influence, 1982).

    Args:
        free: A, (rows, a).
        flexible: X, (rows, x).
        target: y, (rows,).
        block: Block of each row, (rows,).
        ridges: λ to choose from.
    """
    (Q, free_power) = principal(normalise_columns(free), HARDLY * len(target))
    X = normalise_columns(flexible)
    U, power = principal(X - Q @ (Q.T @ X), NEGLIGIBLE * min(ridges) * len(target))
    fold = block % PREDICTION_FOLDS
    found = list[Array]()
    folds = [np.flatnonzero(fold == k) for k in np.unique(fold)]
    for ridge in ridges:
        held, shrunk = (
            x / (x + r * len(target)) for x, r in ((free_power, HARDLY), (power, ridge))
        )
        W = np.concatenate(
            [Q * np.sqrt(held), U * np.sqrt(shrunk)], axis=1
        )  # the fit's hat matrix is W Wᵀ
        left = target - W @ (W.T @ target)
        error = np.empty(len(target))
        for rows in folds:
            error[rows] = unleveraged(W[rows], left[rows])
        found.append(error)
    return min(found, key=lambda one: float(one @ one))


def unleveraged(W: Array, left: Array) -> Array:
    """``(I - W Wᵀ)⁻¹ r``, (rows,), through whichever of ``W Wᵀ`` and ``Wᵀ W`` is smaller."""
    rows, count = W.shape
    if rows <= count:
        return np.asarray(np.linalg.solve(np.eye(rows) - W @ W.T, left))
    return np.asarray(left + W @ np.linalg.solve(np.eye(count) - W.T @ W, W.T @ left))


def normalise_columns(columns: Array) -> Array:
    """Return columns of unit power, without those that are nothing."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(columns[:, size > 1e-12] / size[size > 1e-12])


def principal(columns: Array, least: float) -> tuple[Array, Array]:
    """Return orthonormal principal directions of some columns, (rows, k), and the power along each, of more than one.

    A ridge does not tell the columns from them.
    """
    rows, count = columns.shape
    if count > rows:
        power, along = np.linalg.eigh(columns @ columns.T)
        return np.asarray(along[:, power > least]), power[power > least]
    power, axes = np.linalg.eigh(columns.T @ columns)
    there = power > least
    return np.asarray(columns @ axes[:, there] / np.sqrt(power[there])), power[there]


class Lack(NamedTuple):
    """Lack of fit of a model at one joint.

    Attributes:
        share: Share of the residual's power that δ predicts on unseen blocks; about zero, or less, for noise.
        power: That power in units of the noise's.
        size: Its root over the joint's torque, rms over rms.
    """

    share: float
    power: float
    size: float


def lack_of_fit(state: State, joint: int) -> Lack:
    """``1 - Σ (r - δ)²/Σ r²`` over blocks that δ has not seen, and where the model's coefficients may move beside it.

    They move within the same ridge: free, a few blocks would send them far off where those were left out.
    """
    evidence = state.problem.evidence
    rows = state.fit.rows(joint)
    used = float(evidence.used[joint])
    if used * evidence.rows < state.fit.stack.shape[1]:  # a joint that stands shows nothing
        return Lack(0.0, 0.0, 0.0)
    residual, stack = (
        x[rows] / state.fit.scale[joint] for x in (state.fit.residual, state.fit.stack)
    )
    flexible = np.concatenate([stack, features(evidence, state.torque, joint)], axis=1)
    error = unseen(stack[:, :0], flexible, residual, evidence.block)
    share = 1.0 - float(error @ error) / max(float(residual @ residual), 1e-300)
    power = max(share, 0.0) * float(np.mean(residual**2))
    torque = state.fit.target[rows] / state.fit.scale[joint]
    return Lack(share, power / used, float(np.sqrt(power / max(float(np.mean(torque**2)), 1e-300))))


def place(state: State, joint: int) -> str:
    """Return which variable δ predicts most of a joint's residual by: "over its angle", say."""
    evidence = state.problem.evidence
    rows = state.fit.rows(joint)
    residual = state.fit.residual[rows] / state.fit.scale[joint]
    free = state.fit.stack[rows] / state.fit.scale[joint]
    error = {
        name: unseen(free[:, :0], np.concatenate([free, columns], axis=1), residual, evidence.block)
        for name, columns in split_by_variable(evidence, state.torque, joint).items()
    }
    return min(error, key=lambda name: float(error[name] @ error[name]), default="")
