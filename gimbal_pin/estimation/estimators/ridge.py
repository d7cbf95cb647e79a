"""Least squares with the URDF as one more, uncertain, measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.bodies import TRUST
from gimbal_pin.estimation.estimators.base import Estimate, covariance, effective_rows, factor, residual_power, solve
from gimbal_pin.estimation.estimators.weighted import joint_weights
from gimbal_pin.estimation.rows import Block, Rows, standing_for
from gimbal_pin.log.log import Array
from gimbal_pin.rig.consistency import spread

PASSES = 4


@dataclass(frozen=True)
class Ridge:
    """``argmin Σ_j ‖b_j - A_j theta‖² / σ_j² + (beta - beta_0)ᵀ P₀⁻¹ (beta - beta_0)``, an `Estimator`.

    beta_0 are the URDF's base parameters and ``P₀ = K (trust² G) Kᵀ`` their covariance if every body is the URDF's,
    stretched and sheared at random by `trust`: G as `consistency.spread` says. What the log shows well, it decides;
    what it does not, stays at the URDF, with the deviation that the trust leaves it. Friction is not held.

    Attributes:
        trust: Relative standard deviation of the URDF's masses, 1; lengths to half of that.
    """

    trust: float = TRUST

    def __post_init__(self) -> None:
        """Check the trust."""
        if not 0 < self.trust < np.inf:
            raise UsageError("trust", f"is {self.trust:g}", "give the URDF's relative deviation, such as 0.3")

    def __call__(self, blocks: Sequence[Block]) -> Estimate:
        """Estimate theta."""
        factors, rows = factor(blocks), effective_rows(blocks)
        belief = self.belief(standing_for(blocks), factors.shape[2])
        scale: Array = np.ones(len(factors))
        theta, _, _ = solve(factors, scale)
        for _ in range(PASSES):
            scale = joint_weights(residual_power(factors, theta, rows))
            stacked = np.concatenate([factors * scale[:, None, None], belief[None]])
            theta, information, condition = solve(stacked, np.ones(len(stacked)))
        power = residual_power(factors, theta, rows)
        half = belief[:, :-1] @ np.where(np.isfinite(information), information, 0.0)
        out = covariance(blocks, theta, information, scale) + half.T @ half
        return Estimate(theta, out, np.sqrt(power), condition, sum(len(block.t) for block in blocks), "ridge")

    def belief(self, rows: Rows, width: int) -> Array:
        """``[P₀^-½ 0 P₀^-½ beta_0]`` as rows under the data's factors, (k + 1, k + 1)."""
        root = rows.mixing @ spread(rows.rig.phi) * self.trust
        left, values, _ = np.linalg.svd(root, full_matrices=False)
        whiten = left.T / np.maximum(values, 1e-9 * values[0])[:, None]
        out = np.zeros((width, width))
        out[: len(left), : len(left)] = whiten
        out[: len(left), -1] = whiten @ (rows.mixing @ rows.rig.phi)
        return out
