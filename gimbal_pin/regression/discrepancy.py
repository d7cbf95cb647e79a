"""What a joint's torque holds beyond the model, as a flexible function of its motion, and what that does to deviations.

``b_j = A_j θ + Φ_j γ_j + e``, γ with variances S_j: columns Φ over the joint's angle and rate, smooth and jumping with
the direction (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001). S is nothing where the residual is noise, else the
mean under the likelihood: few columns tell a variance badly, and the most likely one of four is half of that mean. The
parameters stay those of the estimator; with ``θ = G Σ AᵀWb`` its covariance grows by ``Σ_j G w_j AᵀΦ S ΦᵀA w_j Gᵀ``: a
residual that is a function of the state comes back whenever the state does, so more periods of a motion do not average
it away as the residual's colour in time says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.linalg import decompose, triangularise
from gimbal_pin.regression.solve import (
    Estimate,
    compute_gain,
    compute_residuals,
    count_effective_rows,
)
from gimbal_pin.rig.brief import brief

FORM_ERROR = 0.005
"""Plausible error of a rigid model's form, as a share of its torque, of a moment of inertia or a radius of gyration: no
URDF is right to less."""
STRUCTURED = 0.1
"""Share of what is left, as power, from which it is a structure: flexible columns take less of noise by chance."""
ANGLE_COSINES, RATE_COSINES, SIGNED_COSINES = 24, 12, 6
"""Cosines over the angle's range (a ripple of 14 per turn has six in 2.5 rad), over the rate's, and over the angle
times the direction of motion."""
SLOWEST_COSINES = 4
"""Of the angle's and of the rate's, the slowest have a variance of their own: a spring is no ripple."""
GROUPS = np.repeat(
    np.arange(5),
    (
        SLOWEST_COSINES,
        ANGLE_COSINES - SLOWEST_COSINES,
        SLOWEST_COSINES,
        RATE_COSINES - SLOWEST_COSINES,
        SIGNED_COSINES,
    ),
)
"""Which variance each column has."""
SIZES = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 11)])
"""Variances that are tried, in units of the noise's: a decade apart."""
SWEEPS = 3
"""Passes over the groups; the likelihood has settled then."""

NEIGHBOURS = 8
"""Rows before and after one that share its noise: four periods of the cutoff, as long as the filter rings."""


class Misfit(NamedTuple):
    """What a model misses at one joint.

    Attributes:
        size: Root mean square of what is a function of the motion, N m.
        noise: The same of the rest.
        variance: Of each of δ's coefficients, (N m)², (f,).
        pure_error: The same of what does not come back when the motion does, at most `noise`, see `measure_pure_error`.
    """

    size: float
    noise: float
    variance: Array
    pure_error: float

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @property
    def share(self) -> float:
        """Share of what is left, as power, that is a function of the motion."""
        return self.size**2 / max(self.size**2 + self.noise**2, 1e-300)

    @property
    def group_std(self) -> tuple[float, ...]:
        """Standard deviation of the coefficients of each group, N m."""
        return tuple(
            float(np.sqrt(self.variance[group == GROUPS][0])) for group in range(GROUPS.max() + 1)
        )


def _iterate_joints(blocks: Sequence[Block]) -> Iterator[tuple[Array, Array, Array]]:
    """Yield over all rows each joint's columns, δ's, and its torque, (m, k), (m, f), (m,): one joint's at a time."""
    for j in range(blocks[0].b.shape[1]):
        A, b, q, v, share = (
            np.concatenate([x[:, j] for x in each])
            for each in zip(*(block[1:6] for block in blocks))
        )
        yield A, build_discrepancy_columns(q, v) * share[:, None], b


def build_discrepancy_columns(q: Array, v: Array) -> Array:
    """Return δ's columns over a joint's angle, its rate, and its angle times the direction of motion, (m, f).

    Cosines over the range of each; of an angle that goes beyond a turn the harmonics of the turn. They vary slowly
    beside the rows' low-pass, which is left out. The slowest over the angle fall as 1/k²: of like variance, their sum
    is as smooth as a cubic spline, ``∫ δ''²`` (Wahba, J. R. Statist. Soc. B 40, 1978), and what gravity hides of a
    spring, k = 1, is larger than what shows. Over the rate nothing is smooth: friction has its edge at rest.
    """
    turn = np.outer(q, np.arange(1, ANGLE_COSINES // 2 + 1))
    whole = (
        np.hstack([np.cos(turn), np.sin(turn)])
        if np.ptp(q) > 2 * np.pi
        else _build_cosines(q, ANGLE_COSINES)
    )
    signed = np.sign(v)[:, None] * whole[:, :SIGNED_COSINES]
    whole[:, :SLOWEST_COSINES] /= np.arange(1, SLOWEST_COSINES + 1) ** 2
    return np.hstack([whole, _build_cosines(v, RATE_COSINES), signed])


def _build_cosines(x: Array, count: int) -> Array:
    """``cos(π k (x - min)/(max - min))``, k from 1, (m, count)."""
    along = (x - x.min()) / max(float(np.ptp(x)), 1e-9)
    return np.asarray(np.cos(np.pi * np.outer(along, np.arange(1, count + 1))))


def fit_misfit(A: Array, X: Array, b: Array, count: float) -> Misfit:
    """Fit δ's variances by the likelihood of what A cannot take, the noise's power profiled.

    Which there are is chosen by Akaike's rule; how large each is, is averaged with Akaike's weights.

    Args:
        A: Columns that the joint feels, (m, k).
        X: δ's, (m, f).
        b: Torque, (m,).
        count: Rows that were not masked out.
    """
    joint = triangularise(np.column_stack([A, X, b]))
    # Unscaled: a column that the joint feels by rounding only is no direction.
    svd = decompose(joint[:, : A.shape[1]], np.ones(A.shape[1]))
    R = triangularise(joint[:, A.shape[1] :] - svd.U @ (svd.U.T @ joint[:, A.shape[1] :]))
    end = X.shape[1]
    left = R[:end, :-1]
    z = R[:end, -1]
    rest = float(np.sum(R[end:, -1] ** 2))
    free = max(count - len(svd.s), 1.0)
    power = (float(z @ z) + rest) / free
    if not len(z) or power <= 0:
        return Misfit(0.0, float(np.sqrt(power)), np.zeros(X.shape[1]), float(np.sqrt(power)))
    each = np.stack(
        [left[:, group == GROUPS] @ left[:, group == GROUPS].T for group in range(GROUPS.max() + 1)]
    )

    def compute_costs(sizes: Array) -> tuple[Array, Array]:
        """Akaike's criterion and the noise's power of so many choices of the variances, (c, groups): (c,) each."""
        root = np.linalg.cholesky(np.eye(len(z)) + np.tensordot(sizes, each, 1))
        white = np.linalg.solve(root, z[:, None])[:, :, 0]
        noise = (np.sum(white**2, axis=1) + rest) / free
        spread = 2 * np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
        return free * np.log(np.maximum(noise, 1e-300)) + spread + 2 * np.sum(
            sizes > 0, axis=1
        ), noise

    def vary_size(group: int) -> Array:
        """The choices of one variance beside those of the others, (c, groups)."""
        tried = np.tile(sizes, (len(SIZES), 1))
        tried[:, group] = SIZES
        return tried

    sizes: Array = np.zeros(len(each))
    for _ in range(SWEEPS):
        before = sizes
        for group in range(len(each)):
            tried = vary_size(group)
            sizes = tried[np.argmin(compute_costs(tried)[0])]
        if np.array_equal(sizes, before):
            break
    noise, means = float(compute_costs(sizes[None])[1][0]), sizes.copy()
    for group in np.flatnonzero(sizes).tolist():
        costs = compute_costs(vary_size(group)[1:])[0]
        means[group] = np.average(SIZES[1:], weights=np.exp((costs.min() - costs) / 2))
    size, rest = np.sqrt([max(power - noise, 0.0), noise]).tolist()
    return Misfit(size, rest, noise * means[GROUPS], rest)


def propagate_misfit(gain: Array, through: Array, missed: Misfit) -> Array:
    """``G AᵀX √S``, (k, f): by how much the parameters of ``θ = G Aᵀb`` are off for what a model misses at one joint.

    Times its transpose it is what that adds to their covariance.

    Args:
        gain: G, (k, k).
        through: AᵀX, the joint's columns on δ's there, (k, f).
        missed: What the model misses there.
    """
    return np.asarray(gain @ (through * np.sqrt(missed.variance)))


def add_misfit(
    blocks: Sequence[Block], estimate: Estimate, cameras: int = 1
) -> tuple[Estimate, tuple[Misfit, ...]]:
    """Return the estimate with deviations that hold what the model misses, and that at each joint.

    The rows weigh as they do in `solve`, or alike by ordinary least squares. With several cameras on one gimbal
    δ may be the gimbal's, the same with each, or each camera's own, or in part both: the sum bounds them all.

    Args:
        blocks: Rows.
        estimate: What was estimated from them.
        cameras: Of how many cameras the joints are, one's after another's.
    """
    found = list[Misfit]()
    through = list[Array]()
    pure = measure_pure_error(blocks, estimate.theta)
    used = count_effective_rows(blocks)
    for (A, X, b), count, bound in zip(_iterate_joints(blocks), used.tolist(), pure.tolist()):
        one = fit_misfit(A[:, A.any(axis=0)], X, b, count)
        found.append(one._replace(pure_error=min(one.noise, bound)))
        through.append(A.T @ X)
    return _add_spread(blocks, estimate, found, through, cameras), tuple(found)


def measure_pure_error(blocks: Sequence[Block], theta: Array) -> Array:
    """``√(½ mean (e_i - e_k)²)``, N m, (n,): what of each joint's residual differs when a motion comes back.

    Row k is the nearest to row i in all angles and rates, each in units of its deviation, that is not its neighbour in
    time. A function of the motion drops out as far as they are alike, so this bounds the noise from above (Rice, Ann.
    Statist. 12, 1984; in a designed experiment its repeats' pure error). Infinite where no row has such a partner.

    Args:
        blocks: Rows.
        theta: Parameters, (k,).
    """
    q, v, share = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in ("q", "v", "share")
    )
    error = np.concatenate([compute_residuals(block, theta) for block in blocks])
    state = np.hstack([q, v])
    state = (state - state.mean(axis=0)) / np.maximum(state.std(axis=0), 1e-12)
    order = np.arange(len(state))
    place = np.concatenate([np.arange(len(block.t)) for block in blocks])
    block = np.repeat(np.arange(len(blocks)), [len(block.t) for block in blocks])
    near = (
        cKDTree(state).query(state, min(2 * NEIGHBOURS + 2, len(state)))[1].reshape(len(state), -1)
    )
    apart = (np.abs(place[near] - place[:, None]) > NEIGHBOURS) | (block[near] != block[:, None])
    partner = near[order, np.argmax(apart, axis=1)]
    counts = np.where(apart.any(axis=1)[:, None], share * share[partner], 0.0)
    squares = (counts * (error - error[partner]) ** 2 / 2).sum(axis=0)
    total = counts.sum(axis=0)
    return np.sqrt(np.divide(squares, total, out=np.full(len(total), np.inf), where=total > 0))


def presume_misfit(
    blocks: Sequence[Block], estimate: Estimate, sizes: Array, group_std: Array | None = None
) -> Estimate:
    """Return the estimate with the deviations that a misfit would add, as `add_misfit` does with one that it finds.

    Args:
        blocks: Rows.
        estimate: What was estimated from them.
        sizes: Root mean square of δ at each joint, N m, (n,).
        group_std: Of δ's coefficients, see `Misfit`, (n, groups); None: the same power from every group.
    """
    each = [
        (A.T @ X, np.bincount(GROUPS, np.mean(X**2, axis=0))) for A, X, _ in _iterate_joints(blocks)
    ]
    through = [x for x, _ in each]
    if group_std is None:
        powers = np.array([x for _, x in each])
        group_std = sizes[:, None] / np.sqrt(np.maximum(powers.shape[1] * powers, 1e-300))
    found = [
        Misfit(size, 0.0, (std**2)[GROUPS], 0.0) for size, std in zip(sizes.tolist(), group_std)
    ]
    return _add_spread(
        blocks,
        replace(estimate, residual_std=np.hypot(estimate.residual_std, sizes)),
        found,
        through,
    )


def _add_spread(
    blocks: Sequence[Block],
    estimate: Estimate,
    found: Sequence[Misfit],
    through: Sequence[Array],
    cameras: int = 1,
) -> Estimate:
    """Return the estimate with the deviations that a misfit found at each joint adds, see `add_misfit`.

    `through` is ``AᵀX`` at each joint, (k, f).
    """
    gain, scale = compute_gain(blocks, estimate)
    moved = np.stack(
        [s**2 * propagate_misfit(gain, x, one) for s, x, one in zip(scale, through, found)]
    )
    shared = moved.reshape(cameras, -1, *moved.shape[1:]).sum(axis=0)
    spreads = [
        np.einsum("jkf,jlf->kl", each, each)
        for each in ((moved, shared) if cameras > 1 else (moved,))
    ]
    return replace(estimate, covariance=estimate.covariance + sum(spreads))
