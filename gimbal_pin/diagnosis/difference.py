"""Refitted base parameters less those of the given URDF, with a covariance that holds under coloured noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.diagnosis.fit import Fit
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.estimation.identification import Identified, given_beta
from gimbal_pin.estimation.rows import over_phi
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

RANK = 1e-6
"""A direction that keeps less than this of the largest, once the others are projected out, is not shown by the rig."""


class Seen(NamedTuple):
    """What of some parameters a difference shows.

    Attributes:
        basis: Directions in the parameters' space that are shown, orthonormal, (p, r).
        value: The change along each, (r,).
        covariance: Of these, (r, r).
    """

    basis: Array
    value: Array
    covariance: Array

    @property
    def change(self) -> Array:
        """The parameters' change, nothing along what is not shown, (p,)."""
        return self.basis @ self.value

    @property
    def std(self) -> Array:
        """Its standard deviations, (p,)."""
        return np.sqrt(np.maximum(np.diag(self.basis @ self.covariance @ self.basis.T), 0.0))

    @property
    def axes(self) -> list[bool]:
        """Whether each of the p axes lies more than half in the directions that are shown."""
        return [bool(np.linalg.norm(row) > 0.5) for row in self.basis]

    def turned(self, axes: Array) -> Seen:
        """Return it along other axes, columns (p, p)."""
        return self._replace(basis=axes.T @ self.basis)

    @property
    def chance(self) -> float:
        """Chance of as large a change where there is none."""
        if not len(self.value):
            return 1.0
        return float(chi2.sf(self.value @ np.linalg.solve(self.covariance, self.value), len(self.value)))


@dataclass(frozen=True, eq=False)
class Difference:
    """``change = beta refitted - beta given``.

    Attributes:
        rig: The given rig.
        reduction: Its base parameters.
        change: In SI units, (b,).
        covariance: Of the change under the residual's own colour, (b, b).
        weighting: Of the change if the residual were white, (b, b): what the least squares are weighted by, since a
            covariance estimated from few blocks of time has no inverse that deserves trust.
    """

    rig: Rig
    reduction: Reduction
    change: Array
    covariance: Array
    weighting: Array

    @staticmethod
    def of_fit(rig: Rig, reduction: Reduction, fit: Fit) -> Difference:
        """``cov = H⁻¹ (Σ_blocks g gᵀ) H⁻¹``: what a fit to whitened rows says."""
        width = len(reduction.independent)
        scores = fit.by_block(fit.stack * fit.residual[:, None])
        blocks = len(scores)
        spread = fit.information @ (scores.T @ scores) @ fit.information * blocks / max(blocks - 1, 1)
        change = fit.theta[:width] - given_beta(rig, reduction)
        return Difference(rig, reduction, change, spread[:width, :width], fit.information[:width, :width])

    @staticmethod
    def of_identified(rig: Rig, found: Identified) -> Difference:
        """Return the difference of what `identify` estimated from what the rig states."""
        width = len(found.reduction.independent)
        spread = found.estimate.covariance[:width, :width]
        change = found.estimate.theta[:width] - given_beta(rig, found.reduction)
        return Difference(rig, found.reduction, change, spread, spread)

    @cached_property
    def responses(self) -> Array:
        """Change of the base parameters per change of each entry of `Rig.phi`, (b, 10 n)."""
        return over_phi(self.rig, self.reduction)

    @cached_property
    def whitener(self) -> Array:
        """``W = L⁻¹/√c``, ``weighting = L Lᵀ``, (b, b): noise of unit variance on average, ``tr(W cov Wᵀ) = b``."""
        std = np.sqrt(np.diag(self.weighting))
        correlation = self.weighting / np.outer(std, std) + 1e-12 * np.eye(len(std))
        white = np.linalg.inv(np.linalg.cholesky(correlation)) / std
        return np.asarray(white / np.sqrt(np.trace(white @ self.covariance @ white.T) / len(std)))

    def seen(self, wanted: Array, unknown: Array, limit: float) -> Seen:
        """Least squares for the wanted parameters, whatever the unknown ones are.

        Args:
            wanted: Base parameters per wanted parameter, (b, p).
            unknown: The same of what is to be left open, (b, m).
            limit: Standard deviation, in the wanted parameters' unit, from which a direction is not shown.
        """
        W = self.whitener
        columns = outside(W @ unknown, W @ wanted)
        left, size, right = np.linalg.svd(columns, full_matrices=False)
        floor = RANK * max(float(np.linalg.norm(W @ wanted)), 1e-300)
        shown = (size > floor) & (size * limit > 1.0)
        gain = (left[:, shown] / size[shown]).T @ W
        return Seen(right[shown].T, gain @ self.change, gain @ self.covariance @ gain.T)

    def lack_of_fit(self, columns: Array) -> float:
        """Chance of as much change outside the reach of some columns, (b, m), where there is none."""
        rest = outside(self.whitener @ columns, (self.whitener @ self.change)[:, None])
        freedom = len(self.change) - np.linalg.matrix_rank(self.whitener @ columns, tol=None)
        return float(chi2.sf(float(np.sum(rest**2)), freedom)) if freedom else 1.0


def outside(span: Array, columns: Array) -> Array:
    """Take out of columns (b, p) what lies in the span of others (b, m), which may depend on each other."""
    if not span.shape[1]:
        return columns
    size = np.linalg.norm(span, axis=0)
    unit = span[:, size > 0] / size[size > 0]
    left, values, _ = np.linalg.svd(unit, full_matrices=False)
    basis = left[:, values > 1e-9 * values.max(initial=0.0)]
    once = columns - basis @ (basis.T @ columns)
    return np.asarray(once - basis @ (basis.T @ once))
