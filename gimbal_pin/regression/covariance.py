"""Covariance of weighted least squares, with instruments or without, under residuals of each joint's own colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import toeplitz
from scipy.special import stdtrit

from gimbal_pin.log.log import Array
from gimbal_pin.regression.design import Block
from gimbal_pin.regression.linalg import decompose, triangularise
from gimbal_pin.regression.noise import (
    Autoregression,
    compute_autocovariance,
    fit_autoregression,
    join_blocks,
)

MOST_LEVERAGE = 0.95
"""A row of more tells nothing of its own noise."""
NORMAL_975 = 1.959964
FEWEST_SQUARES = 2.0
"""Degrees of freedom of a variance that is known no better than from so many squares, at least."""


class ResidualNoise(NamedTuple):
    """Noise of each joint's residual.

    Attributes:
        processes: Its process, (n).
        gamma: Its autocovariance, (lags + 1, n).
        rows: From how many rows they are known, less those that the fit took, (n,).
    """

    processes: list[Autoregression]
    gamma: Array
    rows: Array


def fit_residual_noise(
    blocks: Sequence[Block], columns: Sequence[Array], theta: Array, gain: Array, weight: Array
) -> ResidualNoise:
    """Return the noise of each joint's residual under ``theta = gain Σ zᵀW b``.

    A fit takes out of the residual what looks like its columns: ``e / (1 - h)`` with the leverage h = w aᵀ gain z of a
    row stands for the noise, which is more than it where the residual is white (HC3, MacKinnon and White 1985): of few
    rows, that is what intervals have to be.

    Args:
        blocks: Rows.
        columns: Per block z, (m, n, k): A itself for least squares, the instruments else.
        theta: Estimate, (k,).
        gain: ``(Σ ZᵀWA)⁻¹``, (k, k), zero where a direction is not seen.
        weight: W, (n,).
    """
    whole = join_blocks(blocks)
    errors = []
    for block, z in zip(whole, join_columns(blocks, columns)):
        leverage = weight * np.einsum("mjk,mjk->mj", block.A @ gain, z)
        errors.append((block.b - block.A @ theta) / (1.0 - np.clip(leverage, 0.0, MOST_LEVERAGE)))
    shares = [block.share for block in whole]
    gamma = compute_autocovariance(errors, shares)
    rows = np.sum([np.sum(share**2, axis=0) for share in shares], axis=0)
    processes = [fit_autoregression(each, float(count)) for each, count in zip(gamma.T, rows)]
    return ResidualNoise(processes, gamma, np.maximum(rows - len(theta) / len(rows), 1.0))


def join_columns(blocks: Sequence[Block], columns: Sequence[Array]) -> list[Array]:
    """Return other columns of the blocks, (m, n, k) each, joined as `join_blocks` joins these."""
    return [
        block.A for block in join_blocks([block._replace(A=z) for block, z in zip(blocks, columns)])
    ]


def compute_coloured_covariance(
    blocks: Sequence[Block], columns: Sequence[Array], theta: Array, gain: Array, weight: Array
) -> Array:
    """Covariance of ``theta = gain Σ zᵀW b`` under residuals of each joint's own colour, (k, k).

    Few rows tell their own noise badly. With N of them the power of a process has the variance 2 power²/N, its
    polynomial the covariance ``power Γ⁻¹/N`` (Mann and Wald 1943), and so each variance v of theta one of its own, by
    its slopes: it is as good as one from ``ν = 2 v² / var v`` squares (Satterthwaite 1946), and its deviation is
    multiplied by the quantile of Student's t of ν degrees of freedom over the normal one, so that ± 1.96 of it hold 95
    times in 100.

    The arguments are those of `fit_residual_noise`.
    """
    noise = fit_residual_noise(blocks, columns, theta, gain, weight)
    lent = [z @ gain.T for z in join_columns(blocks, columns)]
    out = np.zeros_like(gain)
    uncertain = np.zeros(len(gain))
    for j, (process, rows) in enumerate(zip(noise.processes, noise.rows.tolist())):
        order = len(process.polynomial) - 1
        own = np.zeros_like(gain)
        slopes = np.zeros((order, len(gain)))
        for z in lent:
            y = process.colour(weight[j] * z[::-1, j])
            own += process.power * (y.T @ y)
            later = process.colour(y)
            for lag in range(1, min(order, len(y) - 1) + 1):
                slopes[lag - 1] -= 2 * process.power * np.sum(y[lag:] * later[:-lag], axis=0)
        out += own
        uncertain += 2 * np.diag(own) ** 2 / rows
        if order:
            spread = (
                process.power
                / rows
                * np.linalg.pinv(toeplitz(noise.gamma[:order, j]), hermitian=True)
            )
            uncertain += np.einsum("lk,lm,mk->k", slopes, spread, slopes)
    freedom = 2 * np.diag(out) ** 2 / np.where(uncertain > 0, uncertain, np.inf).clip(1e-300)
    widening = stdtrit(np.maximum(freedom, FEWEST_SQUARES), 0.975) / NORMAL_975
    return np.asarray(out * np.outer(widening, widening))


def compute_score_covariance(
    columns: Sequence[Array], processes: Sequence[Autoregression], weight: Array
) -> Array:
    """Covariance of ``Σ_t weight_j z_tj e_tj`` of each joint for residuals e of these colours, (n, k, k).

    ``E (zᵀe)(zᵀe)ᵀ = power yᵀy`` with y the columns through the process backwards in time: no lag is cut off, and what
    comes out is a covariance.

    Args:
        columns: Per segment z, (m, n, k).
        processes: Noise of each joint.
        weight: Weights, (n,).
    """
    out = np.zeros((len(processes), *(columns[0].shape[2],) * 2))
    for z in columns:
        for j, process in enumerate(processes):
            y = process.colour(z[::-1, j])
            out[j] += weight[j] ** 2 * process.power * (y.T @ y)
    return out


def bound_deviations(blocks: Sequence[Block], theta: Array) -> Array:
    """Least standard deviations that any unbiased estimate of theta from some rows has, (k,): Cramér and Rao's.

    ``diag((Σ_j A_jᵀ Γ_j⁻¹ A_j)⁻¹)^½``, Γ_j the covariance of joint j's residual as an autoregressive process. That
    residual holds the noise of all sensors as it comes through the equations, the torque's beside that of the angles,
    rates and accelerations in the regressor.

    Args:
        blocks: Rows, of a cutoff as wide as the motion.
        theta: An estimate, (k,).
    """
    whole = join_blocks(blocks)
    seen = compute_autocovariance(
        [block.b - block.A @ theta for block in whole], [block.share for block in whole]
    )
    rows = float(sum(len(block.t) for block in whole))
    R: Array = np.zeros((0, len(theta)))
    for j, gamma in enumerate(seen.T):
        process = fit_autoregression(gamma, rows)
        for block in whole:
            white = process.whiten(block.A[:, j])
            R = triangularise(np.vstack([R, white / np.sqrt(max(process.power, 1e-300))]))
    return np.linalg.norm(decompose(R).inverse, axis=1)
