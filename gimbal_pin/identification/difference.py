"""The refitted base parameters against the given ones: what of some parameters' change they show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.identification.fitting import given_beta
from gimbal_pin.identification.identified import IdentificationResult
from gimbal_pin.log.log import Array
from gimbal_pin.regression import compute_wald, map_phi_to_base, project_rows, whiten
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

LEAST_KEPT = 1e-6
"""A direction that keeps less than this of the largest, once the others are projected out, is not shown by the rig."""
FALSE_ALARM = 0.003
"""Chance of speaking of a difference where there is none: three deviations."""


class ShownChange(NamedTuple):
    """What of a change of some parameters the base parameters show.

    Attributes:
        basis: Directions in the parameters' space that are shown, orthonormal, (p, r).
        value: The change along each, (r,).
        covariance: Of these, (r, r).
        gain: Change along each per change of the base parameters, (r, b).
        limit: Standard deviation from which a direction is not shown.
    """

    basis: Array
    value: Array
    covariance: Array
    gain: Array
    limit: float = 0.0

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @property
    def change(self) -> Array:
        """The parameters' change, nothing along what is not shown, (p,)."""
        return self.basis @ self.value

    @property
    def std(self) -> Array:
        """Its standard deviations, (p,); the part of a shown axis along hidden directions counts with `limit`."""
        hidden = np.where(self.axes, 1.0 - np.sum(self.basis**2, axis=1), 0.0)
        own = np.diag(self.basis @ self.covariance @ self.basis.T)
        return np.sqrt(np.maximum(own + hidden * self.limit**2, 0.0))

    @property
    def axes(self) -> list[bool]:
        """Whether each of the p axes lies in the directions that are shown, but for a tenth of it at most."""
        return [bool(row @ row > 0.99) for row in self.basis]

    @property
    def is_significant(self) -> bool:
        """Whether chance makes as large a change in less than `FALSE_ALARM` of the cases."""
        power, freedom = compute_wald(self.value, self.covariance)
        return bool(chi2.sf(power, freedom) <= FALSE_ALARM)

    def hide(self) -> ShownChange:
        """Return the same parameters with nothing of them shown."""
        return ShownChange(
            self.basis[:, :0], self.value[:0], self.covariance[:0, :0], self.gain[:0]
        )


@dataclass(frozen=True, eq=False)
class BaseDifference:
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
    def of(found: IdentificationResult) -> BaseDifference:
        """Return what `identify` found less the rig that it was given."""
        rig = found.model.rig.with_phi(found.given)
        width = len(found.reduction.independent)
        spread = found.estimate.covariance[:width, :width]
        change = found.estimate.theta[:width] - given_beta(rig, found.reduction)
        return BaseDifference(rig, found.reduction, change, spread, spread)

    @property
    def refitted(self) -> Array:
        """The refitted base parameters, (b,)."""
        return given_beta(self.rig, self.reduction) + self.change

    @cached_property
    def responses(self) -> Array:
        """Change of the base parameters per change of each entry of `Rig.phi`, (b, 10 n)."""
        return map_phi_to_base(self.rig, self.reduction)

    @cached_property
    def whitener(self) -> Array:
        """``W = L⁻¹/√c``, ``weighting = L Lᵀ``, (b, b): noise of unit variance on average, ``tr(W cov Wᵀ) = b``."""
        W = whiten(self.weighting)
        return np.asarray(W / np.sqrt(np.trace(W @ self.covariance @ W.T) / len(W)))

    def explain(self, wanted: Array, unknown: Array, limit: float) -> ShownChange:
        """Least squares for the wanted parameters, whatever the unknown ones are.

        Axes whose own deviation is small enough are shown, whatever the others are; of the others, directions.

        Args:
            wanted: Base parameters per wanted parameter, (b, p).
            unknown: The same of what is to be left open, (b, m).
            limit: Standard deviation, in the wanted parameters' unit, from which a direction is not shown.
        """
        W = self.whitener
        left, size, right = np.linalg.svd(
            project_rows(W @ wanted, W @ unknown), full_matrices=False
        )
        seen = size > LEAST_KEPT * max(float(np.linalg.norm(W @ wanted)), 1e-300)
        basis = right[seen].T
        gain = (left[:, seen] / size[seen]).T @ W
        spread = gain @ self.covariance @ gain.T
        known = (np.sum(basis**2, axis=1) > 0.99) & (
            np.sum(basis @ spread * basis, axis=1) < limit**2
        )
        count = int(known.sum())
        turned = np.linalg.qr(np.hstack([basis[known].T, np.eye(basis.shape[1])]))[0]
        axes = turned[:, :count]
        rest = turned[:, count:]
        variance, turn = np.linalg.eigh(rest.T @ spread @ rest)
        shown = np.hstack([axes, rest @ turn[:, variance < limit**2]])
        gain = shown.T @ gain
        return ShownChange(basis @ shown, gain @ self.change, shown.T @ spread @ shown, gain, limit)

    def compute_rest(self, columns: Array) -> tuple[float, int]:
        """Power of the change outside the reach of some columns, (b, m), in units of noise, and in how many ways."""
        span = self.whitener @ columns
        rest = project_rows((self.whitener @ self.change)[:, None], span)
        return float(np.sum(rest**2)), len(self.change) - int(np.linalg.matrix_rank(span))

    def widen(self, root: Array) -> BaseDifference:
        """Return it with a root of another covariance, (b, r), in its own."""
        W = self.whitener
        more = root @ root.T
        noise = self.weighting * len(self.change) / np.trace(W @ self.weighting @ W.T)
        return replace(self, covariance=self.covariance + more, weighting=noise + more)
