"""Least squares on whitened rows, and what a further cause would gain, judged by blocks of time.

Noise of real sensors is coloured: the score ``zᵀr`` of a candidate column is compared with its own scatter over
blocks, not with a white noise's, and with what random signs of the blocks make of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.stats import f as fisher

from gimbal_pin.log import Array
from gimbal_pin.rows import Flags

PASSES = 4
FOLDS = 4


@dataclass(frozen=True, eq=False)
class Fit:
    """``theta = argmin Σ_j ‖b_j - A_j theta‖²/φ_j`` on rows of unit noise.

    Attributes:
        theta: Coefficients, (k,).
        stack: Weighted A, (rows n, k).
        target: Weighted b, (rows n,).
        basis: Orthonormal columns that span the weighted A, (rows n, k).
        residual: Weighted residual, (rows n,).
        scale: ``1/√φ_j``, (n,); the dispersion φ is residual power over predicted noise power.
        information: ``(AᵀWA)⁻¹``, (k, k).
        block: Block of each weighted row, (rows n,).
    """

    theta: Array
    stack: Array
    target: Array
    basis: Array
    residual: Array
    scale: Array
    information: Array
    block: Array

    @property
    def dispersion(self) -> Array:
        """Residual power over predicted noise power, per joint, (n,)."""
        return 1.0 / self.scale**2

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(self.residual @ self.residual)

    def stacked(self, values: Array) -> Array:
        """Weight (rows, n, c) and stack it to (rows n, c)."""
        return (values * self.scale[:, None]).reshape(-1, values.shape[-1])

    def by_block(self, values: Array) -> Array:
        """Sum rows (rows n, c) over each block, (blocks, c)."""
        order = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.add.reduceat(values, order, axis=0)


def fit(A: Array, b: Array, used: Array, block: Array, scale: Array | None = None) -> Fit:
    """Fit b (rows, n) by A (rows, n, k), the joints' dispersions iterated unless `scale` is given.

    Args:
        A: Whitened columns.
        b: Whitened torque.
        used: Share of the rows that count, per joint, (n,).
        block: Block of each row, (rows,).
        scale: ``1/√φ``, (n,), to keep.
    """
    rows, n, k = A.shape
    weight = np.ones(n) if scale is None else scale
    for _ in range(PASSES if scale is None else 1):
        theta = np.linalg.lstsq((A * weight[:, None]).reshape(-1, k), (b * weight).ravel(), rcond=1e-10)[0]
        power = np.sum((b - A @ theta) ** 2, axis=0) / np.maximum(rows * used - k / n, 1.0)
        if scale is None:
            # What fits better than its sensors allow is luck, not knowledge.
            weight = 1.0 / np.sqrt(np.maximum(power, 0.5))
    stacked = (A * weight[:, None]).reshape(-1, k)
    target = (b * weight).ravel()
    theta = np.linalg.lstsq(stacked, target, rcond=1e-10)[0]
    left, values, right = np.linalg.svd(stacked / np.maximum(norms(stacked), 1e-300), full_matrices=False)
    seen = values > 1e-10 * values[0]
    unit = np.maximum(norms(stacked), 1e-300)
    information = (right[seen].T / values[seen] ** 2) @ right[seen] / np.outer(unit, unit)
    residual = target - stacked @ theta
    return Fit(theta, stacked, target, left[:, seen], residual, weight, information, np.repeat(block, n))


def norms(matrix: Array) -> Array:
    """Norm of each column."""
    return np.linalg.norm(matrix, axis=0)


class Candidate(Protocol):
    """Whitened columns with bounds on their coefficients."""

    @property
    def values(self) -> Array:
        """Columns, (rows, n, c)."""

    @property
    def lower(self) -> Array:
        """Bounds of the coefficients, (c,)."""

    @property
    def upper(self) -> Array:
        """The same."""


class Score(NamedTuple):
    """What a candidate would gain.

    Attributes:
        gain: Fall of the weighted sum of squares.
        wald: ``sᵀ V⁻¹ s``, s the score, V its scatter over blocks once the candidate is in.
        p: Of `wald`, without regard to how many were tried.
        beta: Coefficients, (c,).
        visible: Share of the column's power that the base columns leave.
        size: Root mean square of what it explains at each joint, in units of the noise floor, (n,).
    """

    gain: float
    wald: float
    p: float
    beta: Array
    visible: float
    size: Array


NOTHING = Score(0.0, 0.0, 1.0, np.zeros(0), 0.0, np.zeros(1))
HIDDEN = 1e-3
"""Share of a column's power below which the base columns hide it: three hundredths of its size."""


def project(now: Fit, values: Array) -> Array:
    """Weight and stack columns, and take the fitted columns out of them, (rows n, c)."""
    stacked = now.stacked(values)
    return stacked - now.basis @ (now.basis.T @ stacked)


def score(now: Fit, columns: Candidate, fixed: bool) -> Score:
    """Score one candidate; `fixed`: its coefficient is one, as for a drive's signal."""
    stacked = now.stacked(columns.values)
    rest = stacked - now.basis @ (now.basis.T @ stacked)
    whole, left = float(np.sum(stacked**2)), float(np.sum(rest**2))
    if whole <= 0 or left < HIDDEN * whole:
        return NOTHING._replace(visible=left / whole if whole > 0 else 0.0)
    s, gram = rest.T @ now.residual, rest.T @ rest
    beta = np.linalg.lstsq(gram, s, rcond=1e-8)[0]
    if np.any(beta < columns.lower) or np.any(beta > columns.upper) or overdone(now, stacked @ beta):
        return NOTHING._replace(visible=left / whole)
    applied = np.ones(1) if fixed else beta
    after = now.residual - rest @ applied
    gain = now.cost - float(after @ after)
    scatter = now.by_block(rest * (now.residual - rest @ beta)[:, None])
    blocks, width = scatter.shape
    V = scatter.T @ scatter
    wald = float(s @ np.linalg.lstsq(V, s, rcond=1e-12)[0])
    explained = (rest @ applied).reshape(len(columns.values), -1) / now.scale
    size = np.sqrt(np.mean(explained**2, axis=0))
    return Score(gain, wald, float(chance(wald, width, blocks)), applied, left / whole, size)


def overdone(now: Fit, torque: Array) -> bool:
    """Whether a cause would take more torque than there is at its joints: it only works against the rigid model."""
    rows = torque != 0
    return float(np.sum(torque**2)) > float(np.sum(now.target[rows] ** 2))


def chance(wald: Array | float, width: int, blocks: int) -> Array | float:
    """Hotelling's T² with `width` coefficients over `blocks` blocks: chance of as much or more."""
    freedom = max(blocks - width, 1)
    return fisher.sf(wald * freedom / (width * max(blocks - 1, 1)), width, freedom)


def improves(now: Fit, columns: Candidate, fixed: bool) -> bool:
    """Whether a candidate predicts better, in sum and in most of `FOLDS` parts of time that its fit has not seen."""
    extra = now.stacked(columns.values)
    blocks = int(now.block[-1]) + 1
    fold = now.block * FOLDS // blocks
    target = now.target - extra[:, 0] if fixed else now.target
    stack = now.stack if fixed else np.hstack([now.stack, extra])
    gains = []
    for k in range(FOLDS):
        here = fold == k
        before, after = (missed(A, b, here) for A, b in ((now.stack, now.target), (stack, target)))
        gains.append(before - after)
    return sum(gains) > 0 and sum(gain > 0 for gain in gains) > FOLDS / 2


def missed(A: Array, b: Array, here: Flags) -> float:
    """Sum of squares on some rows of a fit to all the others."""
    theta = np.linalg.lstsq(A[~here], b[~here], rcond=1e-8)[0]
    return float(np.sum((b[here] - A[here] @ theta) ** 2))


def flipped(now: Fit, candidates: Sequence[Candidate], rng: np.random.Generator, flips: int = 499) -> Array:
    """``min over candidates of p`` for random signs of the residual's blocks, (flips,), sorted.

    Where nothing is left to be found the blocks' signs do not matter: what the search makes of flipped residuals is
    what it makes of noise of this very colour.
    """
    signs = rng.choice([-1.0, 1.0], size=(flips, int(now.block[-1]) + 1))
    lowest = np.ones(flips)
    for columns in candidates:
        rest = project(now, columns.values)
        if np.sum(rest**2) < HIDDEN * np.sum(now.stacked(columns.values) ** 2):
            continue
        scatter = now.by_block(rest * now.residual[:, None])
        blocks, width = scatter.shape
        V = scatter.T @ scatter
        s = signs @ scatter
        # The candidate's own fit takes its part out of the scatter, as `score` does.
        wald = np.einsum("fi,ij,fj->f", s, np.linalg.pinv(V, rcond=1e-12), s)
        wald = wald / np.maximum(1 - wald / blocks, 0.05)
        lowest = np.minimum(lowest, chance(wald, width, blocks))
    return np.sort(lowest)
