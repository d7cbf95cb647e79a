"""Linear algebra of the estimators: triangular factors, scaled least squares, whitening.

Columns of a regressor differ by ten orders of magnitude, because their units differ. Every function here
therefore compares directions only after scaling, columns to unit norm and covariances to correlations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgeqrf

from gimbal_pin.rig.types import Array

LEAF_SIZE = 8192
"""Numbers in one leaf of the TSQR. A leaf stays in the cache and is too small for BLAS to wake threads, which on a
busy machine cost a hundred times the work that they share."""
RANK = 1e-10
"""Singular values of a scaled matrix below this share of the largest are directions that the data do not show."""
SHOWN = 1.0 - 1e-12
"""Squared length of a unit vector's part in the directions that the data show, from which its parameter is shown."""
JITTER = 1e-12
"""Variance that is added to a correlation's diagonal, so that rounding leaves it positive definite."""


def triangularise(matrix: Array) -> Array:
    """Return the triangular factor R of ``matrix = Q R``, (k, k), or (m, k) of fewer than k rows, leaf by leaf (TSQR).

    ``RᵀR = matrixᵀ matrix``, without the product, which would square the condition number. R is all that least squares
    needs of the rows; further rows are added by stacking them under R. Demmel et al., SIAM J. Sci. Comput. 34 (2012).

    Args:
        matrix: Rows, (m, k).
    """
    width = matrix.shape[1]
    leaf = max(LEAF_SIZE // width, 2 * width)
    R = np.zeros((0, width))
    for begin in range(0, max(len(matrix), 1), leaf):
        rows = matrix[begin : begin + leaf]
        R = np.triu(dgeqrf(np.vstack([R, rows]) if begin else rows, lwork=32 * width)[0][:width])
    return R


class ScaledSVD(NamedTuple):
    """Singular value decomposition ``A = U diag(s) Vᵀ diag(d)`` of the directions that A shows, r of k.

    Attributes:
        U: Left singular vectors, orthonormal, (m, r): they span the columns of A.
        s: Singular values, all above `RANK` of the largest, (r,).
        Vt: Right singular vectors, orthonormal, (r, k).
        d: Scale of each column, (k,).
        condition: Largest over smallest singular value; infinite where a direction is not shown.
    """

    U: Array
    s: Array
    Vt: Array
    d: Array
    condition: float

    @property
    def inverse(self) -> Array:
        """Pseudo-inverse ``diag(1/d) V diag(1/s) Uᵀ``, (k, m): the shortest scaled solution of ``A x = b``."""
        return np.asarray((self.Vt.T / self.s) @ self.U.T / self.d[:, None])

    @property
    def shown(self) -> Array:
        """True for each parameter that the data determine, whatever the others are, (k,)."""
        return np.asarray(np.sum(self.Vt**2, axis=0) > SHOWN)


def decompose(A: Array, scale: Array | None = None) -> ScaledSVD:
    """Decompose a matrix with its columns scaled to unit norm; dependent columns and columns of zeros are allowed.

    Use it for a matrix of any shape; of very many rows, decompose the factor that `triangularise` gives.

    Args:
        A: Matrix, (m, k).
        scale: Divisor of each column, (k,); None: its norm. A column of rounding errors needs ones: scaled to unit
            norm, it would count as a direction.
    """
    norms = np.linalg.norm(A, axis=0) if scale is None else scale
    d = np.where(norms > 0, norms, 1.0)
    U, s, Vt = np.linalg.svd(A / d, full_matrices=False)
    kept = s > RANK * s.max(initial=0.0)
    condition = s[0] / s[-1] if len(Vt) and kept.all() and len(s) == len(d) else np.inf
    return ScaledSVD(U[:, kept], s[kept], Vt[kept], d, float(condition))


def project_rows(rows: Array, columns: Array) -> Array:
    """Project rows (N, k) onto the complement of what columns (N, m) span; these may be dependent and badly scaled."""
    U = decompose(columns).U
    return np.asarray(rows - U @ (U.T @ rows))


class Solution(NamedTuple):
    """Solution of a linear system, with what the covariance of its parameters is made of.

    Attributes:
        theta: Parameters, the shortest scaled ones where several solve it, (k,).
        gain: Inverse of the information matrix ``AᵀWA``, (k, k); zero for the parameters that are not shown.
        shown: True for each parameter that the data determine, (k,).
        condition: Condition number with columns scaled to unit norm.
    """

    theta: Array
    gain: Array
    shown: Array
    condition: float

    def mark_unseen(self, covariance: Array) -> Array:
        """Return a covariance, (k, k), with infinite variances of the parameters that are not shown."""
        return np.where(np.diag(np.logical_not(self.shown)), np.inf, covariance)


def solve_rows(rows: Array) -> Solution:
    """Minimise ``‖A theta - b‖²``.

    Args:
        rows: ``[A b]``, whitened, what is known beforehand among them, (m, k + 1).
    """
    R = triangularise(rows)[: rows.shape[1] - 1]
    svd = decompose(R[:, :-1])
    inverse = svd.inverse
    return _build_solution(svd, inverse @ R[:, -1], inverse @ inverse.T)


def solve_moments(moment: Array, target: Array) -> Solution:
    """Solve ``M theta = z``, M = ZᵀWA: use it with instruments Z, and `solve_rows` where M is a square ``AᵀWA``.

    Args:
        moment: M, scaled from both sides by the roots of its diagonal, (k, k).
        target: z, (k,).
    """
    norms = np.sqrt(np.abs(np.diag(moment)))
    d = np.where(norms > 0, norms, 1.0)
    svd = decompose(moment / d[:, None], d)
    inverse = svd.inverse / d
    return _build_solution(svd, inverse @ target, inverse)


def _build_solution(svd: ScaledSVD, theta: Array, gain: Array) -> Solution:
    """Return a solution whose gain is cleared of the parameters that the decomposed matrix does not show."""
    shown = svd.shown
    return Solution(theta, np.where(np.outer(shown, shown), gain, 0.0), shown, svd.condition)


def whiten(covariance: Array) -> Array:
    """Return W with ``W covariance Wᵀ = 1``, (k, k): the inverse of its Cholesky factor, through the correlation.

    Use it on the parameters of one estimate, whose variances span ten orders of magnitude. Errors of W are those of a
    correlation that is off by `JITTER`.

    Args:
        covariance: Symmetric, its variances positive, (k, k).

    Raises:
        numpy.linalg.LinAlgError: It is not a covariance.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    correlation = covariance / std / std[:, None] + JITTER * np.eye(len(std))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(correlation)) / std)


def compute_wald(difference: Array, covariance: Array, rank: float = RANK) -> tuple[float, int]:
    """Return ``dᵀ P⁺ d``, which is χ² if d is noise of the covariance P, and its degrees of freedom.

    Use it where P may be singular: directions with less than `rank` of the correlation's largest variance are left out.
    Wald, Trans. Amer. Math. Soc. 54 (1943).

    Args:
        difference: d, (k,).
        covariance: P, (k, k).
        rank: Least eigenvalue of the correlation that counts, as a share of the largest.
    """
    std = np.sqrt(np.diag(covariance))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    kept = values > rank * values.max(initial=0.0)
    z = vectors[:, kept].T @ (difference / unit)
    return float(np.sum(z**2 / values[kept])), int(kept.sum())
