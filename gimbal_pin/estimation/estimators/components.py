"""Noise of short logs as a mixture of a few spectra: restricted maximum likelihood, and the freedom that it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.special import stdtrit
from tqdm import tqdm

from gimbal_pin.log.log import Array
from gimbal_pin.regression import Block

Indices = NDArray[np.integer[Any]]

SHORT_LOG = 320
"""Rows per joint (40 s at 4 Hz) up to which noise is modelled this way; more rows show a process of any shape."""
LONGEST_PIECE = 100
"""Rows that are inverted at once, for time; between such pieces the noise is taken to have forgotten."""
SLOW = (1 / 12, 1 / 3)
"""Corners of the noises that are white through a first-order low-pass, in cutoffs."""
STARTS = ((0.25, 0.25, 0.25, 0.25, 0.01), (0.01, 0.01, 0.3, 0.3, 1.0))
"""Shares of a joint's power from which the most likely ones are looked for: of every spectrum, and of the mask's."""
LEAST_SHARE = 0.1
"""A row is looked at where at least this share of its samples was not masked out."""
PASSES, HALVINGS = 30, 8
RIDGE = 1e-9
"""Least curvature in any direction, as a share of the largest: a joint without a row has none."""
NEAR, SETTLED = 0.5, 1e-3
"""Gain of log-likelihood of a pass that is near the top, and at it; a standard deviation of a power is worth half."""
NUGGET = 1e-6
"""White noise that is added to every mixture, in shares of its power: so it can be inverted."""
NORMAL_975 = 1.959964
FEWEST = 2.0
"""Degrees of freedom of a variance that is known no better than from so many squares, at least."""
LEAST_POWER = 1e-6
"""A spectrum has at least this share of a joint's power: none is lost for good."""
RANK = 1e-12
"""Directions of less than this share of the largest, columns scaled to unit size, are not taken by the fit."""


class Piece(NamedTuple):
    """One joint's rows in one stretch.

    Attributes:
        joint: Which.
        felt: Parameters that the joint feels: those of what it carries, (f,).
        X: What the fit can take out of them, (m, f).
        y: Residual, N m, (m,).
        kernels: Covariance of every spectrum, and of what the mask does, at unit power, (q, m, m).
    """

    joint: int
    felt: Indices
    X: Array
    y: Array
    kernels: Array


class Whitened(NamedTuple):
    """Pieces at some powers.

    Attributes:
        inverses: V⁻¹ of each, (m, m).
        W: V⁻¹X of each, (m, f).
        inverse: (XᵀV⁻¹X)⁻¹ of all, (k, k).
        fit: What the residuals show of X, (k,).
        volume: log|V| + log|XᵀV⁻¹X|.
    """

    inverses: Sequence[Array]
    W: Sequence[Array]
    inverse: Array
    fit: Array
    volume: float


class Likelihood(NamedTuple):
    """What the rows say at some powers.

    Attributes:
        likelihood: Logarithm of the restricted likelihood.
        slope: Its gradient in the powers, (n q,).
        information: Fisher's, nearly, (n q, n q).
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


def pieces(whole: Sequence[Block], columns: Sequence[Array], theta: Array, longest: int = SHORT_LOG) -> list[Piece]:
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
            felt = np.flatnonzero(z[:, j].any(axis=0))
            rows = np.flatnonzero(share > LEAST_SHARE)
            for part in np.array_split(rows, -(-len(rows) // longest) or 1):
                size = np.outer(share[part], share[part])
                edges = np.diag(share[part] * (1.0 - share[part]))
                kernels = np.array([*(covariance[np.ix_(part, part)] * size for covariance in covariances), edges])
                out.append(Piece(j, felt, z[part, j][:, felt], error[part, j], kernels))
    return [piece for piece in out if piece.y.any()]


def whitened(parts: Sequence[Piece], power: Array) -> Whitened:
    """Invert the covariances of all pieces at some powers, (n, q), and what X takes out of them."""
    mixed = [np.tensordot(power[p.joint], p.kernels, 1) for p in parts]
    roots = [np.linalg.cholesky(V + NUGGET * np.trace(V) / len(V) * np.eye(len(V))) for V in mixed]
    inverses = [half.T @ half for half in map(np.linalg.inv, roots)]
    W = [Vi @ p.X for Vi, p in zip(inverses, parts)]
    width = 1 + max(int(p.felt.max(initial=-1)) for p in parts)
    normal, right = np.zeros((width, width)), np.zeros(width)
    for p, w in zip(parts, W):
        normal[np.ix_(p.felt, p.felt)] += p.X.T @ w
        right[p.felt] += w.T @ p.y
    inverse, volume = inverted(normal)
    volume += 2 * float(np.sum([np.sum(np.log(np.diag(L))) for L in roots]))
    return Whitened(inverses, W, inverse, inverse @ right, volume)


def restricted_likelihood(parts: Sequence[Piece], power: Array) -> Likelihood:
    """Restricted likelihood of powers, (n, q), its slope and information (Patterson and Thompson 1971).

    With V the covariance, ``P = V⁻¹ - V⁻¹X(XᵀV⁻¹X)⁻¹XᵀV⁻¹``, K a spectrum's part in V: ``2 l = -log|V| - log|XᵀV⁻¹X| -
    yᵀPy``, slope ``½ (yᵀPKPy - tr PK)``. V has a block per piece, and only P's blocks there are formed: Fisher's
    information ``½ tr PKPK'`` is taken as ``½ tr PKV⁻¹K'``, the same for noise of one spectrum, as ``PVP = P``. That
    costs a fifth where there are many joints, and steps need no more.
    """
    n, q = power.shape
    at_powers = whitened(parts, power)
    slope, information = np.zeros(n * q), np.zeros((n * q, n * q))
    likelihood = -at_powers.volume
    for p, Vi, w in zip(parts, at_powers.inverses, at_powers.W):
        at = slice(p.joint * q, (p.joint + 1) * q)
        r = Vi @ p.y - w @ at_powers.fit[p.felt]
        P = Vi - w @ at_powers.inverse[np.ix_(p.felt, p.felt)] @ w.T
        slope[at] += np.einsum("s,ist,t->i", r, p.kernels, r) - np.tensordot(p.kernels, P, 2)
        information[at, at] += traces(p.kernels @ Vi, p.kernels @ P)
        likelihood -= float(p.y @ r)
    return Likelihood(0.5 * likelihood, 0.5 * slope, 0.25 * (information + information.T))


def fisher(parts: Sequence[Piece], power: Array) -> Array:
    """Fisher's information ``½ tr PKPK'`` of powers, (n q, n q), with what joints tell each other of theirs.

    P is never formed: what X takes is of as many dimensions as there are parameters.
    """
    n, q = power.shape
    at_powers = whitened(parts, power)
    inverse, information = at_powers.inverse, np.zeros((n * q, n * q))
    moments = np.zeros((n * q, *inverse.shape))
    for p, Vi, w in zip(parts, at_powers.inverses, at_powers.W):
        at = slice(p.joint * q, (p.joint + 1) * q)
        through, taken = p.kernels @ Vi, p.kernels @ (w @ inverse[np.ix_(p.felt, p.felt)] @ w.T)
        information[at, at] += traces(through, through) - 2 * traces(through, taken)
        moments[at][:, :, p.felt] += inverse[:, p.felt] @ (w.T @ p.kernels @ w)
    information += traces(moments, moments)
    return np.asarray(0.25 * (information + information.T))


def traces(first: Array, second: Array) -> Array:
    """``tr A_i B_j`` of matrices (q, m, m) and (r, m, m), (q, r)."""
    return np.asarray(first.reshape(len(first), -1) @ second.swapaxes(1, 2).reshape(len(second), -1).T)


def inverted(normal: Array) -> tuple[Array, float]:
    """Return the inverse over the directions that a normal matrix has, and the logarithm of its volume."""
    unit = 1.0 / np.sqrt(np.where(np.diag(normal) > 0, np.diag(normal), 1.0))
    values, vectors = np.linalg.eigh(normal * np.outer(unit, unit))
    seen = values > RANK * values.max(initial=0.0)
    volume = float(np.sum(np.log(values[seen])) - 2 * np.sum(np.log(unit)))
    root = unit[:, None] * vectors[:, seen] / np.sqrt(values[seen])
    return root @ root.T, volume


def powers(parts: Sequence[Piece], n: int) -> Array:
    """Return the most likely power of every spectrum at each joint, (N m)², (n, q); zero where there is no residual.

    Fisher's scoring with powers that are not negative; a step that makes them less likely is halved. It may end beside
    the top of another hill, so it starts from slow noise and from fast, and goes on where it is higher near the top.
    """
    size, rows = np.zeros(n), np.zeros(n)
    for p in parts:
        size[p.joint] += p.y @ p.y
        rows[p.joint] += len(p.y)
    found = [maximised(parts, np.outer(size / np.maximum(rows, 1.0), start), NEAR) for start in STARTS]
    return maximised(parts, max(found, key=lambda power: restricted_likelihood(parts, power).likelihood), SETTLED)


def maximised(parts: Sequence[Piece], now: Array, settled: float) -> Array:
    """Return the most likely powers that are reached from some, (n, q); a pass that gains less than `settled` ends."""
    here = restricted_likelihood(parts, now)
    for _ in tqdm(range(PASSES), "noise of short logs", unit="pass", disable=None, leave=False, delay=2):
        step, total = scoring(here, now), np.maximum(now.sum(axis=1, keepdims=True), 1e-300)
        for _ in range(HALVINGS):
            after = np.maximum(now + step, LEAST_POWER * total)
            there = restricted_likelihood(parts, after)
            if there.likelihood >= here.likelihood:
                break
            step = step / 2
        else:
            return now
        gained = there.likelihood - here.likelihood
        now, here = after, there
        if gained < settled:
            break
    return now


def scoring(here: Likelihood, now: Array) -> Array:
    """Return the step to where the likelihood, taken as a parabola, is largest over powers that are not negative."""
    from scipy.optimize import nnls

    unit = np.repeat(np.maximum(now.sum(axis=1), 1e-300), now.shape[1])
    curved, slope = here.information * np.outer(unit, unit), here.slope * unit
    values, turned = np.linalg.eigh(curved)
    # Rounding makes what is as good as zero negative, where a spectrum has no power. One row of noise bends it by half.
    values = np.maximum(values, RIDGE * max(float(values[-1]), 0.5))
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
    parts = pieces(whole, columns, theta, LONGEST_PIECE)
    if not parts:
        return np.zeros_like(gain)
    found = powers(parts, len(weight))
    q = found.shape[1]
    each = np.zeros((found.size, *gain.shape))
    for p in pieces(whole, columns, theta):
        z = weight[p.joint] * p.X @ gain[:, p.felt].T
        each[p.joint * q : (p.joint + 1) * q] += z.T @ (p.kernels @ z)
    out = np.tensordot(found.ravel(), each, 1)
    widen = stdtrit(freedom(fisher(parts, found), found, np.diagonal(each, axis1=1, axis2=2)), 0.975) / NORMAL_975
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
