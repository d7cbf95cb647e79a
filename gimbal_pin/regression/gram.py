"""Inner products of columns and torque, without what free columns and a background explain.

    K = Xᵀ P X,  c = Xᵀ P y,  S = yᵀ P y,  P = V⁻¹ - V⁻¹ F (Fᵀ V⁻¹ F)⁻¹ Fᵀ V⁻¹,  V = I + τ² Z Zᵀ

are all that marginal likelihoods need of the data. Rows of different joints share nothing but the free columns and the
common background, so each joint's columns are split by an orthonormal basis of its own: what is outside of it is final,
and only the few coordinates inside it are joined over the joints. Nothing is subtracted from an inner product, so K of
a column that is nearly explained keeps its digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief


@dataclass(frozen=True, eq=False)
class JointRows:
    """Whitened rows of one joint.

    Attributes:
        torque: y, (N,).
        columns: Those of the columns X that are not zero at this joint, (N, k_j).
        places: Their places among all columns, (k_j,).
        free: The flat columns F, as many at each joint, (N, f).
        background: Features Z of what an error of form may be at this joint, u ~ N(0, τ² I), (N, z_j).
        common: Features of the background that all joints share, with one u for all, (N, c).
    """

    torque: Array
    columns: Array
    places: NDArray[np.intp]
    free: Array
    background: Array
    common: Array

    __repr__ = brief


def find_span(columns: Array) -> Array:
    """Orthonormal basis of columns (N, k) that may depend on each other, (N, r); their scales don't matter."""
    scale = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(scale > 0, scale, 1.0), full_matrices=False)
    return np.asarray(left[:, values > 1e-10 * values.max(initial=0.0)])


def project_rows(rows: Array, columns: Array) -> Array:
    """Rows (N, k) without what lies in the span of some columns (N, m), which may depend on each other."""
    span = find_span(columns)
    return np.asarray(rows - span @ (span.T @ rows))


def factor_posterior(block: Array, variances: Array) -> Array:
    """Lower triangular L of ``L Lᵀ = I + D^½ K D^½``, from a block K and the prior variances D of its columns."""
    root = np.sqrt(variances)
    return np.linalg.cholesky(np.eye(len(root)) + root[:, None] * block * root)


class _Joint(NamedTuple):
    """What is left of one joint's rows.

    Attributes:
        basis: Orthonormal, of background, free and common columns with the background's prior below, (N + z_j, b).
        hidden: Of them, the first are the background's, z_j.
        torque: The torque outside the basis, (N + z_j,).
        pieces: Places of columns, (m,), and the same of them, (m, N + z_j).
    """

    basis: Array
    hidden: int
    torque: Array
    pieces: tuple[tuple[NDArray[np.intp], Array], ...] = ()

    def split(self, columns: Array) -> tuple[Array, Array]:
        """Return columns (N, m) outside the basis, (m, N + z_j), and their coordinates off the background, (m, s_j)."""
        inside = columns.T @ self.basis[: len(columns)]
        outside = inside @ -self.basis.T
        outside[:, : len(columns)] += columns.T
        return outside, inside[:, self.hidden :]

    def gather(self, places: NDArray[np.intp], width: int) -> Array | None:
        """Return the columns at some places, (..., N + z_j); None where all are zero at this joint."""
        out = None
        for own, outside in self.pieces:
            where = np.full(width, -1)
            where[own] = np.arange(len(own))
            found = where[places]
            if (found >= 0).any():
                out = np.zeros((*places.shape, outside.shape[1])) if out is None else out
                out[found >= 0] = outside[found[found >= 0]]
        return out


@dataclass(frozen=True, eq=False)
class Gram:
    """``K = Xᵀ P X``, of which only what is asked for is made, c and S.

    Attributes:
        correlations: c, (k,).
        power: S.
        joints: What is left of each joint's rows.
        span: Orthonormal basis of free and common columns among the coordinates of all joints, (s, r).
        coordinates: Of the columns, off that span, (k, s).
        torque: The same of the torque, (s,).
    """

    correlations: Array
    power: float
    joints: tuple[_Joint, ...]
    span: Array
    coordinates: Array
    torque: Array

    __repr__ = brief

    @classmethod
    def of(cls, rows: Sequence[JointRows], size: float) -> Gram:
        """Return the Gram matrix of all joints' rows, of as many columns as their largest place says.

        Args:
            rows: One or more, with as many free columns and as many common features each.
            size: τ, the standard deviation of the background's u.
        """
        common = rows[0].common.shape[1]
        joints, factors, torque = [], [], []
        for row in rows:
            n, z = row.background.shape
            known = np.zeros((n + z, z + row.free.shape[1] + common))
            known[:n] = np.concatenate([size * row.background, row.free, size * row.common], axis=1)
            known[n:, :z] = np.eye(z)
            basis, factor = np.linalg.qr(known)
            factors.append(factor[z:, z:])
            bare = _Joint(basis, z, np.zeros(0))
            outside, inside = bare.split(row.torque[:, None])
            joints.append(bare._replace(torque=outside[0]))
            torque.append(inside[0])
        prior = np.eye(factors[0].shape[1])[factors[0].shape[1] - common :]
        span = find_span(np.concatenate([*factors, prior]))
        rest = np.concatenate([*torque, np.zeros(common)])
        rest -= span @ (span.T @ rest)
        power = float(rest @ rest + sum(joint.torque @ joint.torque for joint in joints))
        empty = cls(np.zeros(0), power, tuple(joints), span, np.zeros((0, len(rest))), rest)
        width = 1 + max(int(row.places.max(initial=-1)) for row in rows)
        return empty._append([row.columns for row in rows], [row.places for row in rows], width)

    @property
    def width(self) -> int:
        """How many columns there are, k."""
        return len(self.correlations)

    def extend(self, more: Sequence[Array]) -> Gram:
        """Return it with m further columns at the end, from each joint's rows of them, (N, m); they may be zero."""
        felt = [np.flatnonzero(columns.any(axis=0)) for columns in more]
        return self._append([x[:, f] for x, f in zip(more, felt)], felt, more[0].shape[1])

    def _append(self, more: Sequence[Array], places: Sequence[NDArray[np.intp]], width: int) -> Gram:
        """Append so many columns, of which each joint has those at some places among them."""
        coordinates, correlations, joints, begin = np.zeros((width, len(self.torque))), np.zeros(width), [], 0
        for joint, columns, own in zip(self.joints, more, places):
            outside, inside = joint.split(columns)
            coordinates[own, begin : begin + inside.shape[1]] = inside
            correlations[own] += outside @ joint.torque
            joints.append(joint._replace(pieces=(*joint.pieces, (own + self.width, outside))))
            begin += inside.shape[1]
        coordinates -= coordinates @ self.span @ self.span.T
        correlations += coordinates @ self.torque
        return replace(
            self,
            correlations=np.concatenate([self.correlations, correlations]),
            joints=tuple(joints),
            coordinates=np.concatenate([self.coordinates, coordinates]),
        )

    def compute_rows(self, places: ArrayLike) -> Array:
        """``K[places, :]``, (w, k)."""
        places = np.asarray(places, dtype=np.intp)
        out = self.coordinates[places] @ self.coordinates.T
        for joint in self.joints:
            own = joint.gather(places, self.width)
            if own is not None:
                for others, outside in joint.pieces:
                    out[:, others] += own @ outside.T
        return np.asarray(out)

    def compute_blocks(self, places: ArrayLike) -> Array:
        """K's blocks of groups of columns at some places, (g, w), each with itself, (g, w, w)."""
        places = np.asarray(places, dtype=np.intp)
        own = self.coordinates[places]
        out = own @ own.swapaxes(1, 2)
        for joint in self.joints:
            felt = np.isin(places, np.concatenate([others for others, _ in joint.pieces])).any(axis=1)
            own = joint.gather(places[felt], self.width)
            if own is not None:
                out[felt] += own @ own.swapaxes(1, 2)
        return np.asarray(out)

    def fit(self, places: ArrayLike, variances: ArrayLike, means: ArrayLike) -> tuple[Array, Array]:
        """Posterior mean and covariance of some columns' coefficients, from their prior's ``N(m, D)``, (w,) each.

        ``C = (K + D⁻¹)⁻¹``, ``b = m + C (c - K m)``.
        """
        places, m, root = np.asarray(places, dtype=np.intp), np.asarray(means), np.sqrt(variances)
        K = self.compute_blocks(places[None])[0]
        half = solve_triangular(factor_posterior(K, root**2), np.diag(root), lower=True)
        covariance = half.T @ half
        return m + covariance @ (self.correlations[places] - K @ m), covariance
