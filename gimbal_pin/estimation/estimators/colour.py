"""Coloured residuals: each joint's as an autoregressive process, and what it does to sums over rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.estimation.estimators import components
from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block

ORDER = 12
"""Highest order: six periods of the cutoff."""
PASSES = 3
"""Colours in turn, each corrected by what the one before says that the fit took away."""
STABLE = 0.995
"""A reflection coefficient beyond this ends the recursion."""


class Colour(NamedTuple):
    """``e_t + Σ_l polynomial[l] e_{t-l} = ε_t``, the variance of ε being `power`."""

    polynomial: Array
    power: float


def series(blocks: Sequence[Block]) -> list[Block]:
    """Join the blocks of one stretch: correlation does not end where a chunk does, but it does across a gap."""
    gaps = [np.diff(block.t) for block in blocks if len(block.t) > 1]
    step = float(np.median(np.concatenate(gaps))) if gaps else 0.0
    runs: list[list[Block]] = []
    for block in blocks:
        if runs and 0 < block.t[0] - runs[-1][-1].t[-1] < 1.5 * step:
            runs[-1].append(block)
        else:
            runs.append([block])
    return [Block(*(np.concatenate(x) for x in zip(*run))) if len(run) > 1 else run[0] for run in runs]


def autocovariance(errors: Sequence[Array], shares: Sequence[Array]) -> Array:
    """Autocovariance at lags 0 ... `ORDER` of residuals (m, n) where their rows count, (ORDER + 1, n)."""
    total = np.zeros((ORDER + 1, errors[0].shape[1]))
    count = np.zeros_like(total)
    for error, share in zip(errors, shares):
        for lag in range(min(ORDER, len(error) - 1) + 1):
            total[lag] += np.sum(error[: len(error) - lag] * error[lag:], axis=0)
            count[lag] += np.sum(share[: len(share) - lag] * share[lag:], axis=0)
    return total / np.maximum(count, 1.0)


def colour(gamma: Array, rows: float) -> Colour:
    """Autoregressive process of an autocovariance, (lags + 1,), by Levinson's recursion; its order by Akaike's rule."""
    polynomial, power = np.ones(1), max(float(gamma[0]), 0.0)
    best, least = Colour(polynomial, power), np.inf
    for order in range(1, len(gamma) + 1):
        if power <= 1e-12 * gamma[0] or gamma[0] <= 0:
            break
        score = rows * np.log(power) + 2 * (order - 1)
        if score < least:
            best, least = Colour(polynomial, power), score
        if order == len(gamma):
            break
        reflection = -float(polynomial @ gamma[order:0:-1]) / power
        if abs(reflection) > STABLE:
            break
        longer = np.append(polynomial, 0.0)
        polynomial = longer + reflection * longer[::-1]
        power *= 1 - reflection**2
    return best


def colours(
    blocks: Sequence[Block], columns: Sequence[Array], theta: Array, gain: Array, weight: Array
) -> list[Colour]:
    """Return the colour of each joint's residual under ``theta = gain Σ zᵀW b``, (n).

    A fit takes out of the residual what looks like its columns, most of all where noise and motion have the same
    frequencies: ``E e eᵀ = Γ - A g Γ - Γ gᵀAᵀ + A P Aᵀ`` with g = gain ZᵀW and P the covariance of theta. So the colour
    is that of the residual plus what the last one says the fit took, in a few passes.

    Args:
        blocks: Rows.
        columns: Per block z, (m, n, k): A itself for least squares, the instruments else.
        theta: Estimate, (k,).
        gain: ``(Σ ZᵀWA)⁻¹``, (k, k), zero where a direction is not seen.
        weight: W, (n,).
    """
    whole, lent = series(blocks), joined_columns(blocks, columns)
    shares = [block.share for block in whole]
    seen = autocovariance([block.b - block.A @ theta for block in whole], shares)
    rows = np.sum([np.sum(share**2, axis=0) for share in shares], axis=0)
    joints = [colour(gamma, float(count)) for gamma, count in zip(seen.T, rows)]
    for _ in range(PASSES):
        spread = gain @ score(lent, joints, weight) @ gain.T
        taken = taken_by_fit(whole, lent, joints, gain, spread, weight)
        joints = [colour(gamma, float(count)) for gamma, count in zip((seen + taken).T, rows)]
    return joints


def joined_columns(blocks: Sequence[Block], columns: Sequence[Array]) -> list[Array]:
    """Return other columns of the blocks, (m, n, k) each, joined as `series` joins these."""
    return [block.A for block in series([block._replace(A=z) for block, z in zip(blocks, columns)])]


def coloured(blocks: Sequence[Block], columns: Sequence[Array], theta: Array, gain: Array, weight: Array) -> Array:
    """Covariance of ``theta = gain Σ zᵀW b`` under residuals of each joint's own colour, (k, k); see `colours`.

    Few rows tell no process of a dozen coefficients: theirs is a mixture of a few spectra, see `components.widened`.
    """
    if sum(len(block.t) for block in blocks) <= components.SHORT_LOG:
        return components.widened(series(blocks), joined_columns(blocks, columns), theta, gain, weight)
    joints = colours(blocks, columns, theta, gain, weight)
    return np.asarray(gain @ score(joined_columns(blocks, columns), joints, weight) @ gain.T)


def taken_by_fit(
    whole: Sequence[Block],
    columns: Sequence[Array],
    joints: Sequence[Colour],
    gain: Array,
    spread: Array,
    weight: Array,
) -> Array:
    """Autocovariance that a fit takes out of residuals of these colours, (lags + 1, n); see `colours`."""
    total, count = np.zeros((ORDER + 1, len(joints))), np.zeros((ORDER + 1, len(joints)))
    for block, z in zip(whole, columns):
        for j, (polynomial, power) in enumerate(joints):
            back = lfilter([1.0], polynomial, z[::-1, j], axis=0)[::-1]
            through = power * weight[j] * lfilter([1.0], polynomial, back, axis=0)  # Γ W z
            a, share = block.A[:, j], block.share[:, j]
            lost, kept = a @ gain, a @ spread
            for lag in range(min(ORDER, len(a) - 1) + 1):
                early, late = slice(0, len(a) - lag), slice(lag, None)
                cross = np.sum(lost[early] * through[late]) + np.sum(lost[late] * through[early])
                total[lag, j] += cross - np.sum(kept[early] * a[late])
                count[lag, j] += np.sum(share[early] * share[late])
    return total / np.maximum(count, 1.0)


def score(columns: Sequence[Array], joints: Sequence[Colour], weight: Array) -> Array:
    """Covariance of ``Σ_t Σ_j weight_j z_tj e_tj`` for residuals e of these colours, (k, k).

    ``E (zᵀe)(zᵀe)ᵀ = power yᵀy`` with y the columns through the process backwards in time: no lag is cut off, and what
    comes out is a covariance.

    Args:
        columns: Per series z, (m, n, k).
        joints: One colour per joint (n).
        weight: Weights, (n,).
    """
    out = np.zeros((columns[0].shape[2],) * 2)
    for z in columns:
        for j, (polynomial, power) in enumerate(joints):
            y = lfilter([1.0], polynomial, z[::-1, j], axis=0)
            out += weight[j] ** 2 * power * (y.T @ y)
    return out


def cramer_rao(blocks: Sequence[Block], theta: Array) -> Array:
    """Least standard deviations that any unbiased estimate of theta from some rows has, (k,): Cramér and Rao's.

    ``diag((Σ_j A_jᵀ Γ_j⁻¹ A_j)⁻¹)^½``, Γ_j the covariance of joint j's residual as an autoregressive process. That
    residual holds the noise of all sensors as it comes through the equations, the torque's beside that of the angles,
    rates and accelerations in the regressor.

    Args:
        blocks: Rows, of a cutoff as wide as the motion.
        theta: An estimate, (k,).
    """
    whole = series(blocks)
    seen = autocovariance([block.b - block.A @ theta for block in whole], [block.share for block in whole])
    rows = float(sum(len(block.t) for block in whole))
    information = np.zeros((len(theta), len(theta)))
    for j, gamma in enumerate(seen.T):
        polynomial, power = colour(gamma, rows)
        for block in whole:
            white = lfilter(polynomial, [1.0], block.A[:, j], axis=0)
            information += white.T @ white / max(power, 1e-300)
    return np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)))
