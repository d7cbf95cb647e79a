"""What a joint's torque holds beyond the model, as a flexible function of its motion, and what that does to deviations.

``b_j = A_j θ + Φ_j γ_j + e``, γ with variances S_j: columns Φ over the joint's angle and rate, smooth and jumping with
the direction (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001). S is the most likely one, nothing where the
residual is noise. The parameters stay those of the estimator; with ``θ = G Σ AᵀWb`` its covariance grows by
``Σ_j G w_j AᵀΦ S ΦᵀA w_j Gᵀ``: a residual that is a function of the state comes back whenever the state does, so more
periods of a motion do not average it away as the residual's colour in time says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from gimbal_pin.effects import Effect, Sample
from gimbal_pin.effects.functions import cos, sin
from gimbal_pin.estimators import Estimate
from gimbal_pin.estimators.base import effective_rows, factor, solve, triangle
from gimbal_pin.estimators.weighted import joint_weights
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter
from gimbal_pin.rows import Regression, kept

ANGLES, RATES, SIGNED = 24, 12, 6
"""Cosines over the angle's range (a ripple of 14 per turn has six in 2.5 rad), over the rate's, and over the angle
times the direction of motion."""
SLOW = 4
"""Of the angle's and of the rate's, the slowest have a variance of their own: a spring is no ripple."""
GROUPS = np.repeat(np.arange(5), (SLOW, ANGLES - SLOW, SLOW, RATES - SLOW, SIGNED))
"""Which variance each column has."""
SIZES = np.concatenate([[0.0], np.geomspace(1e-4, 1e6, 11)])
"""Variances that are tried, in units of the noise's: a decade apart."""
SWEEPS = 3
"""Passes over the groups; the likelihood has settled then."""


@dataclass(frozen=True)
class Discrepancy(Effect):
    """Cosines over what a joint's angle and rate went through; it stands in no model, its columns widen deviations.

    Attributes:
        angles: Least and largest angle, rad; beyond a turn the columns are harmonics of the turn.
        rates: The same of the rate, rad/s.
    """

    angles: tuple[float, float] = (0.0, 1.0)
    rates: tuple[float, float] = (0.0, 1.0)

    name: ClassVar[str] = "discrepancy"
    linear: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"delta{k}", 0.0, "N m", -np.inf, np.inf) for k in range(len(GROUPS))
    )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Columns over the angle, the rate, and the angle times the direction."""
        low, high = self.angles
        if high - low > 2 * np.pi:
            whole = [part(k * at.q) for k in range(1, ANGLES // 2 + 1) for part in (cos, sin)]
        else:
            whole = [cos(np.pi * k * (at.q - low) / (high - low)) for k in range(1, ANGLES + 1)]
        slowest, fastest = self.rates
        fast = [cos(np.pi * k * (at.v - slowest) / (fastest - slowest)) for k in range(1, RATES + 1)]
        return (*whole, *fast, *(at.slide * column for column in whole[:SIGNED]))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return what it is."""
        return "something that the model does not hold"


class Misfit(NamedTuple):
    """What a model misses at one joint.

    Attributes:
        size: Root mean square of what is a function of the motion, N m.
        noise: The same of the rest.
        variance: Of each of δ's coefficients, (N m)², (f,).
    """

    size: float
    noise: float
    variance: Array


def misfits(blocks: Regression) -> tuple[list[Misfit], list[Array]]:
    """Return what each joint's residual holds, and per block δ's columns, (m, n, f)."""
    rows = blocks.rows
    q, v = np.concatenate([log.q for log in rows.logs]), np.concatenate([block.v for block in blocks])
    own = tuple(Discrepancy(joint, ends(q[:, j]), ends(v[:, j])) for j, joint in enumerate(rows.rig.joints))
    width = len(rows.reduction.independent)
    # A joint's columns act on that joint alone: summed over the joints' sets, each row keeps its own.
    columns = [
        block.A[:, :, width:].reshape(*block.b.shape, len(own), -1).sum(axis=2)
        for block in kept(replace(rows, effects=own))
    ]
    A, b, X = (np.concatenate(x) for x in ([block.A for block in blocks], [block.b for block in blocks], columns))
    used = effective_rows(blocks)
    found = [misfit(A[:, j, A[:, j].any(axis=0)], X[:, j], b[:, j], float(used[j])) for j in range(len(own))]
    return found, columns


def ends(values: Array) -> tuple[float, float]:
    """Range of some values, never empty."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low, max(high, low + 1e-9)


def misfit(A: Array, X: Array, b: Array, count: float) -> Misfit:
    """Fit δ's variances by the likelihood of what A cannot take, the noise's power profiled, by Akaike's rule.

    Args:
        A: Columns that the joint feels, (m, k).
        X: δ's, (m, f).
        b: Torque, (m,).
        count: Rows that were not masked out.
    """
    size = A.shape[1]
    R = triangle(np.column_stack([A, X, b]))
    end = min(len(R), size + X.shape[1])
    left, z, rest = R[size:end, size:-1], R[size:end, -1], float(np.sum(R[end:, -1] ** 2))
    free = max(count - size, 1.0)
    power = (float(z @ z) + rest) / free
    if not len(z) or power <= 0:
        return Misfit(0.0, float(np.sqrt(power)), np.zeros(X.shape[1]))
    each = [left[:, group == GROUPS] @ left[:, group == GROUPS].T for group in range(GROUPS.max() + 1)]

    def cost(sizes: Array) -> tuple[float, float]:
        root = np.linalg.cholesky(np.eye(len(z)) + np.tensordot(sizes, each, 1))
        white = np.linalg.solve(root, z)
        noise = (float(white @ white) + rest) / free
        unlikely = free * float(np.log(max(noise, 1e-300))) + 2 * float(np.sum(np.log(np.diag(root))))
        return unlikely + 2 * int(np.sum(sizes > 0)), noise

    sizes: Array = np.zeros(len(each))
    for _ in range(SWEEPS):
        for group in range(len(each)):
            tried = [np.where(np.arange(len(sizes)) == group, x, sizes) for x in SIZES]
            sizes = min(tried, key=lambda one: cost(one)[0])
    noise = cost(sizes)[1]
    return Misfit(float(np.sqrt(max(power - noise, 0.0))), float(np.sqrt(noise)), noise * sizes[GROUPS])


def honest(blocks: Regression, estimate: Estimate) -> tuple[Estimate, tuple[Misfit, ...]]:
    """Return the estimate with deviations that hold what the model misses, and that at each joint.

    The rows weigh as they do in `weighted`, or alike where the estimator is `ols`.
    """
    found, columns = misfits(blocks)
    weight = np.ones(len(found)) if estimate.method == "ols" else joint_weights(estimate.residual_std**2)
    gain = solve(factor(blocks), weight)[1]
    gain = np.where(np.isfinite(gain), gain, 0.0)
    covariance = estimate.covariance.copy()
    for j, one in enumerate(found):
        if one.size > 0:
            through = sum(block.A[:, j].T @ X[:, j] for block, X in zip(blocks, columns))
            moved = weight[j] ** 2 * gain @ (through * np.sqrt(one.variance))
            covariance += moved @ moved.T
    return replace(estimate, covariance=covariance), tuple(found)
