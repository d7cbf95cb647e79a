"""Noise of short logs as a mixture of a few spectra: restricted maximum likelihood, and the freedom that it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import toeplitz
from scipy.special import stdtrit

from gimbal_pin.log import Array
from gimbal_pin.rows import Block

MOST = 320
"""Rows per joint (40 s at 4 Hz) up to which noise is told this way; more tell a process of any shape."""
LONGEST = 100
"""Rows that are inverted at once, for time; between such pieces the noise is taken to have forgotten."""
SLOW = (1 / 12, 1 / 3)
"""Corners of the noises that are white through a first-order low-pass, in cutoffs."""
STARTS = ((0.25, 0.25, 0.25, 0.25, 0.01), (0.01, 0.01, 0.3, 0.3, 1.0))
"""Shares of a joint's power from which the most likely ones are looked for: of every spectrum, and of the mask's."""
TOLD = 0.1
"""A row is looked at where at least this share of its samples was not masked out."""
PASSES, HALVINGS = 30, 8
RIDGE = 1e-9
"""Least curvature in any direction, as a share of the largest: a joint without a row has none."""
SETTLED = 1e-3
"""Change of every share of the power at which the passes stop."""
NUGGET = 1e-6
"""White noise that is added to every mixture, in shares of its power: so it can be inverted."""
SURE = 1.959964
FEWEST = 2.0
"""Degrees of freedom of a variance that is known no better than from so many squares, at least."""
LEAST = 1e-6
"""A spectrum has at least this share of a joint's power: none is lost for good."""
RANK = 1e-12
"""Directions of less than this share of the largest, columns scaled to unit size, are not taken by the fit."""


class Piece(NamedTuple):
    """One joint's rows in one stretch.

    Attributes:
        joint: Which.
        X: What the fit can take out of them, (m, k).
        y: Residual, N m, (m,).
        kernels: Covariance of every spectrum, and of what the mask does, at unit power, (q, m, m).
    """

    joint: int
    X: Array
    y: Array
    kernels: Array


class Told(NamedTuple):
    """What the rows say at some powers.

    Attributes:
        likelihood: Logarithm of the restricted likelihood.
        slope: Its gradient in the powers, (n q,).
        information: Fisher's, (n q, n q).
    """

    likelihood: float
    slope: Array
    information: Array


def autocovariances(lags: int) -> Array:
    """Autocovariance at lags of half a period of the cutoff of each spectrum at unit power, (q, lags).

    Slow noises, white and rising noise (an angle's, differentiated), each through the rows' own filter, a Butterworth
    low-pass of third order forwards and backwards: power ``S(f) / (1 + f⁶)²`` at f cutoffs.
    """
    f = np.linspace(0.0, 2.5, 1251)
    shapes = np.array([*(1 / (1 + (f / corner) ** 2) for corner in SLOW), np.ones_like(f), f**2]) / (1 + f**6) ** 2
    found = shapes @ np.cos(np.pi * np.outer(f, np.arange(lags)))
    return np.asarray(found / found[:, :1])


def pieces(whole: Sequence[Block], columns: Sequence[Array], theta: Array, longest: int = MOST) -> list[Piece]:
    """Return the rows of every joint that are not masked out, apart by stretch, of at most so many rows each.

    Beside the spectra, in proportion to what of a row counts, there is an error of its own in every row that is masked
    in part: noisy rates mask it a little early or late.

    Args:
        whole: Stretches, as `colour.series` joins them.
        columns: Per stretch what the fit's equations were multiplied by, (m, n, k).
        theta: Estimate, (k,).
        longest: Rows of a piece, at most.
    """
    out = []
    for block, z in zip(whole, columns):
        covariances = [toeplitz(row) for row in autocovariances(len(block.t))]
        error = block.b - block.A @ theta
        for j, share in enumerate(block.share.T):
            rows = np.flatnonzero(share > TOLD)
            for part in np.array_split(rows, -(-len(rows) // longest) or 1):
                size = np.outer(share[part], share[part])
                edges = np.diag(share[part] * (1.0 - share[part]))
                kernels = np.array([*(covariance[np.ix_(part, part)] * size for covariance in covariances), edges])
                out.append(Piece(j, z[part, j], error[part, j], kernels))
    return [piece for piece in out if piece.y.any()]


def told(parts: Sequence[Piece], power: Array) -> Told:
    """Restricted likelihood of powers, (n, q), its slope and Fisher's information (Patterson and Thompson 1971).

    With V the covariance, ``P = V⁻¹ - V⁻¹X(XᵀV⁻¹X)⁻¹XᵀV⁻¹``, K a spectrum's part in V: ``2 l = -log|V| - log|XᵀV⁻¹X| -
    yᵀPy``, slope ``½ (yᵀPKPy - tr PK)``, information ``½ tr PKPK'``. P is never formed: V has a block per piece, and
    what X takes is of as many dimensions as there are parameters.
    """
    n, q = power.shape
    mixed = [np.tensordot(power[p.joint], p.kernels, 1) for p in parts]
    roots = [np.linalg.cholesky(V + NUGGET * np.trace(V) / len(V) * np.eye(len(V))) for V in mixed]
    inverses = [half.T @ half for half in map(np.linalg.inv, roots)]
    W = [Vi @ p.X for Vi, p in zip(inverses, parts)]
    half, volume = root(np.sum([p.X.T @ w for p, w in zip(parts, W)], axis=0))
    fit = half @ half.T @ np.sum([w.T @ p.y for p, w in zip(parts, W)], axis=0)
    slope, information = np.zeros(n * q), np.zeros((n * q, n * q))
    moments = np.zeros((n * q, half.shape[1], half.shape[1]))
    likelihood = -volume - 2 * float(np.sum([np.sum(np.log(np.diag(L))) for L in roots]))
    for p, Vi, w in zip(parts, inverses, W):
        at = slice(p.joint * q, (p.joint + 1) * q)
        r, w = Vi @ p.y - w @ fit, w @ half
        through, filtered = p.kernels @ Vi, p.kernels @ w
        inner = w.T @ filtered
        slope[at] += np.einsum("s,ist,t->i", r, p.kernels, r) - np.trace(through, axis1=1, axis2=2)
        slope[at] += np.trace(inner, axis1=1, axis2=2)
        information[at, at] += through.reshape(q, -1) @ through.swapaxes(1, 2).reshape(q, -1).T
        information[at, at] -= 2 * filtered.reshape(q, -1) @ (Vi @ filtered).reshape(q, -1).T
        moments[at] += inner
        likelihood -= float(p.y @ r)
    information += moments.reshape(n * q, -1) @ moments.swapaxes(1, 2).reshape(n * q, -1).T
    return Told(0.5 * likelihood, 0.5 * slope, 0.5 * information)


def root(normal: Array) -> tuple[Array, float]:
    """Return C with ``C Cᵀ = normal⁻¹`` over the directions that it has, (k, seen), and the logarithm of its volume."""
    unit = 1.0 / np.sqrt(np.where(np.diag(normal) > 0, np.diag(normal), 1.0))
    values, vectors = np.linalg.eigh(normal * np.outer(unit, unit))
    seen = values > RANK * values[-1]
    volume = float(np.sum(np.log(values[seen])) - 2 * np.sum(np.log(unit)))
    return unit[:, None] * vectors[:, seen] / np.sqrt(values[seen]), volume


def powers(parts: Sequence[Piece], n: int) -> Array:
    """Return the most likely power of every spectrum at each joint, (N m)², (n, q); zero where there is no residual.

    Fisher's scoring with powers that are not negative; a step that makes them less likely is halved. It may end beside
    the top of another hill, so it starts from slow noise and from fast.
    """
    size, rows = np.zeros(n), np.zeros(n)
    for p in parts:
        size[p.joint] += p.y @ p.y
        rows[p.joint] += len(p.y)
    found = [climbed(parts, np.outer(size / np.maximum(rows, 1.0), start)) for start in STARTS]
    return max(found, key=lambda power: told(parts, power).likelihood)


def climbed(parts: Sequence[Piece], now: Array) -> Array:
    """Return the most likely powers that are reached from some, (n, q)."""
    here = told(parts, now)
    for _ in range(PASSES):
        step, total = scoring(here, now), np.maximum(now.sum(axis=1, keepdims=True), 1e-300)
        for _ in range(HALVINGS):
            after = np.maximum(now + step, LEAST * total)
            there = told(parts, after)
            if there.likelihood >= here.likelihood:
                break
            step = step / 2
        else:
            return now
        now, here = after, there
        if np.max(np.abs(step) / total) < SETTLED:
            break
    return now


def scoring(here: Told, now: Array) -> Array:
    """Return the step to where the likelihood, taken as a parabola, is largest over powers that are not negative."""
    from scipy.optimize import nnls

    unit = np.repeat(np.maximum(now.sum(axis=1), 1e-300), now.shape[1])
    curved, slope = here.information * np.outer(unit, unit), here.slope * unit
    values, turned = np.linalg.eigh(curved)
    # Rounding makes what is as good as zero negative, where a spectrum has no power.
    values = np.maximum(values, RIDGE * max(float(values[-1]), 1e-300))
    upper = np.sqrt(values)[:, None] * turned.T
    aim = upper @ (now.ravel() / unit) + turned.T @ slope / np.sqrt(values)
    return np.reshape(nnls(upper, aim)[0] * unit, now.shape) - now


def widened(whole: Sequence[Block], columns: Sequence[Array], theta: Array, gain: Array, weight: Array) -> Array:
    """Covariance of ``theta = gain Σ zᵀW b``, (k, k), wide enough for ± 1.96 deviations to hold 95 times in 100.

    Few rows tell their own noise badly: each variance is linear in the powers, so that their information says how well
    it is known; it is as good as one from ν squares (Satterthwaite 1946; Kenward and Roger 1997), and its deviation is
    multiplied by the quantile of Student's t of ν degrees of freedom over the normal one.

    Args:
        whole: Stretches, as `colour.series` joins them.
        columns: Per stretch z, (m, n, k).
        theta: Estimate, (k,).
        gain: ``(Σ ZᵀWA)⁻¹``, (k, k), zero where a direction is not seen.
        weight: W, (n,).
    """
    parts = pieces(whole, columns, theta, LONGEST)
    if not parts:
        return np.zeros_like(gain)
    found = powers(parts, len(weight))
    q = found.shape[1]
    each = np.zeros((found.size, *gain.shape))
    for p in pieces(whole, columns, theta):
        z = weight[p.joint] * p.X @ gain.T
        each[p.joint * q : (p.joint + 1) * q] += z.T @ (p.kernels @ z)
    out = np.tensordot(found.ravel(), each, 1)
    widen = stdtrit(freedom(told(parts, found).information, found, np.diagonal(each, axis1=1, axis2=2)), 0.975) / SURE
    return np.asarray(out * np.outer(widen, widen))


def freedom(information: Array, power: Array, each: Array) -> Array:
    """``ν = 2 v² / var v`` of variances ``v = powerᵀ each``, (k,); spectra without any power are left out.

    Args:
        information: Fisher's, of the powers, (n q, n q).
        power: (n, q).
        each: Variance per unit of power, (n q, k).
    """
    there = (power > 1e-3 * power.sum(axis=1, keepdims=True)).ravel()
    v = power.ravel() @ each
    var = np.einsum("ak,ab,bk->k", each[there], np.linalg.pinv(information[np.ix_(there, there)]), each[there])
    return np.asarray(np.maximum(2 * v**2 / np.where(var > 0, var, np.inf).clip(1e-300), FEWEST))
