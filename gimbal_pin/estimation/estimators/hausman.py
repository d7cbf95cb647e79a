"""Is least squares biased on this log? Durbin, Wu and Hausman's test against instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gimbal_pin.estimation.estimators.colour import colours, lending, score, series
from gimbal_pin.estimation.estimators.instrumental import instrumental, moments, solved
from gimbal_pin.estimation.rows import Block
from gimbal_pin.log.log import Array

LEVEL = 0.01
"""Chance that a log on which least squares is not biased is called biased."""
ADMISSIBLE = 0.5
"""Bias that least squares may have, in its own standard deviations: less than this nobody could see."""
RANK = 1e-6
"""Directions of less than this share of the largest variance, in units of each parameter's own, are not judged."""


@dataclass(frozen=True)
class Hausman:
    """What the test says.

    Attributes:
        statistic: ``dᵀ P⁻¹ d``, d the difference of the two estimates and P its covariance.
        freedom: Number of its directions; without bias the statistic is χ² of so many degrees of freedom.
        p_value: Chance of a larger statistic without bias.
        change: Torque that the difference changes, as a share of its rms, in the worst joint.
    """

    statistic: float
    freedom: int
    p_value: float
    change: float

    @property
    def biased(self) -> bool:
        """Whether least squares is biased, at the `LEVEL`."""
        return self.p_value < LEVEL

    @property
    def finding(self) -> str:
        """What it says."""
        chance = f"p = {self.p_value:.2g}" if self.p_value > 1e-12 else "p < 1e-12"
        if not self.biased:
            return f"least squares shows no bias on this log ({chance})"
        shift = f"{100 * self.change:.2g} % of the torque"
        return f"least squares is biased on this log by noise in the motion ({chance}, {shift})"

    @property
    def sentence(self) -> str:
        """What it says, and what to use instead."""
        mend = ": use --estimator output-error or instrumental, or a lower cutoff" if self.biased else ""
        return self.finding + mend

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {**asdict(self), "level": LEVEL, "biased": self.biased, "sentence": self.sentence}


def hausman(blocks: Sequence[Block], instruments: Sequence[Array]) -> Hausman:
    """Test ``E Aᵀe = 0`` by what instruments say instead (Durbin 1954; Wu 1973; Hausman 1978).

    Both estimates take the same weights, so that their difference is linear in the residual,
    ``d = Σ ((ZᵀWA)⁻¹Zᵀ - (AᵀWA)⁻¹Aᵀ) W e``, and its covariance follows from the residual's colour: least squares need
    not be efficient. A model that is wrong in the same way along both motions changes both estimates alike, and that is
    no bias. Every encoder biases least squares by something, and without any noise the smallest something is
    significant: so the question is for a bias of more than `ADMISSIBLE` of least squares' own deviations, and their
    covariance times its square is added.

    `instruments`: per block its Z, (m, n, k).
    """
    found = instrumental(blocks, instruments)
    weight = 1.0 / np.maximum(found.residual_std**2, 1e-6 * np.max(found.residual_std**2) + 1e-30)
    gains, thetas = [], []
    for columns in (instruments, [block.A for block in blocks]):
        target = sum((np.einsum("tjk,j,tj->k", z, weight, block.b) for z, block in zip(columns, blocks)), 0.0)
        theta, gain, _ = solved(moments([(z, b.A) for z, b in zip(columns, blocks)], weight), np.asarray(target))
        gains.append(gain)
        thetas.append(theta)
    joints = colours(blocks, instruments, thetas[0], gains[0], weight)
    apart = [z @ gains[0].T - block.A @ gains[1].T for z, block in zip(instruments, blocks)]
    own = gains[1] @ score([block.A for block in series(blocks)], joints, weight) @ gains[1].T
    spread = score(lending(blocks, apart), joints, weight) + ADMISSIBLE**2 * own
    return judged(thetas[0] - thetas[1], spread, blocks)


def judged(difference: Array, spread: Array, blocks: Sequence[Block]) -> Hausman:
    """Return the test of a difference, (k,), with its covariance, (k, k)."""
    from scipy.stats import chi2

    std = np.sqrt(np.diag(spread))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(spread / np.outer(unit, unit))
    kept = values > RANK * values[-1]
    statistic = float(np.sum((vectors[:, kept].T @ (difference / unit)) ** 2 / values[kept])) if std.any() else 0.0
    freedom = int(np.sum(kept)) if std.any() else 0
    moved = np.sum([np.sum((block.A @ difference) ** 2, axis=0) for block in blocks], axis=0)
    torque = np.sum([np.sum(block.b**2, axis=0) for block in blocks], axis=0)
    share = np.sqrt(moved / np.where(torque > 1e-6 * torque.max(), torque, np.inf))
    return Hausman(statistic, freedom, float(chi2.sf(statistic, freedom)) if freedom else 1.0, float(share.max()))
