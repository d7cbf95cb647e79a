"""What the search makes of noise of a residual's very colour: the residual with random signs of its blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtri

from gimbal_pin.diagnosis.fit import Fit, Placed, Shown, project
from gimbal_pin.diagnosis.score import (
    FEW,
    HIDDEN,
    Beside,
    acting,
    batches,
    chance,
    grams,
    inverse,
    stationary,
    visibility,
)
from gimbal_pin.log import Array


def flipped(now: Fit, candidates: Sequence[Shown], rng: np.random.Generator, flips: int = 499) -> Array:
    """``min over candidates of p`` for random signs of the residual's blocks, (flips,), sorted.

    Where nothing is left to be found the blocks' signs do not matter: what the search makes of flipped residuals is
    what it makes of noise of this very colour.
    """
    signs = rng.choice([-1.0, 1.0], size=(flips, now.blocks))
    shown = [one for one, seen in zip(candidates, visibility(now, candidates)) if seen > HIDDEN]
    lowest = np.ones(flips)
    for batch in batches(shown):
        lower(lowest, now, [shown[i] for i in batch], signs)
    return np.sort(lowest)


def lower(lowest: Array, now: Fit, candidates: Sequence[Placed], signs: Array) -> None:
    """Lower each flip's chance to the least of some candidates of one joint and width c, (flips,).

    Few are lowered: only those are computed which the bound does not tell to stay as they are.

    Args:
        lowest: The chances.
        now: The fit.
        candidates: The candidates.
        signs: Of each block of the residual, (flips, blocks).
    """
    c = candidates[0].own.shape[-1]
    rest = project(now, Beside.of(candidates))
    scatter = now.by_block(rest * now.residual[:, None]).T.reshape(-1, c, now.blocks)
    gram = grams(now, rest, c)
    acts = acting(gram)
    wald = flipped_wald(signs, scatter, gram)
    far = wald > least(lowest, c, max(float(now.blocks), *acts))
    for i, blocks in enumerate(acts.tolist()):
        at = np.flatnonzero(far[i])
        T2 = wald[i, at]
        if blocks < FEW:
            s, V = signs[at] @ scatter[i].T, stationary(now, rest[:, c * i : c * (i + 1)], now.residual)
            T2 = np.minimum(T2, np.sum((s @ inverse(V, 1e-12)) * s, axis=1))
        lowest[at] = np.minimum(lowest[at], chance(T2, c, blocks if blocks >= FEW else float(now.blocks)))


def least(p: Array, width: int, blocks: float) -> Array:
    """Hotelling's T² that has the chance p, (flips,): see `score.chance`."""
    freedom = max(blocks - width, 1.0)
    return np.asarray(fdtri(width, freedom, 1.0 - p) * width * max(blocks - 1, 1.0) / freedom)


def flipped_wald(signs: Array, scatter: Array, gram: Array) -> Array:
    """``sᵀ V⁻¹ s`` as in `score`, for each row of signs: ``s = Σ ±x``, ``V = Σ (±x - G β)(±x - G β)ᵀ``, (k, flips).

    V is symmetric: of each pair of its indices ``i ≤ j`` one is computed, and of the products ``β_e β_f`` those with
    ``e ≤ f``. Flips come last everywhere, side by side in memory.

    Args:
        signs: Of each block, (flips, blocks).
        scatter: Scores x of k candidates in each block, (k, c, blocks).
        gram: G of each block, (k, c, c, blocks).
    """
    flips, (k, c, blocks) = len(signs), scatter.shape
    s = (scatter.reshape(-1, blocks) @ signs.T).reshape(k, c, flips)
    beta = inverse(gram.sum(axis=-1), 1e-8) @ s
    i, j = np.triu_indices(c)
    one, other = gram[:, i], gram[:, j]
    cross = scatter[:, i, None] * other + scatter[:, j, None] * one
    crossed = (cross.reshape(-1, blocks) @ signs.T).reshape(k, len(i), c, flips)
    squared = np.sum(one[:, :, i] * other[:, :, j] + one[:, :, j] * other[:, :, i], axis=-1) / np.where(i == j, 2, 1)
    V = squared @ (beta[:, i] * beta[:, j]) - np.sum(crossed * beta[:, None], axis=2)
    V += np.sum(scatter[:, i] * scatter[:, j], axis=-1)[..., None]
    V[:, i == j] += 1e-12 * np.sum(V[:, i == j], axis=1, keepdims=True)
    return over(V, s)


def over(V: Array, s: Array) -> Array:
    """``sᵀ V⁻¹ s`` of many symmetric V, entries ``i ≤ j`` by rows, (k, m, flips), and s, (k, c, flips): (k, flips).

    Without a solver's call for each small one. Nothing of a V that has no scatter: a column of one block alone.
    """
    c = s.shape[1]
    if c == 1:
        return quotient(s[:, 0] ** 2, V[:, 0])
    if c == 2:
        (x, y), (a, b, d) = np.swapaxes(s, 0, 1), np.swapaxes(V, 0, 1)
        return quotient(x * x * d - 2 * x * y * b + y * y * a, a * d - b * b)
    whole, (i, j) = np.empty((len(V), c, c, s.shape[2])), np.triu_indices(c)
    whole[:, i, j] = whole[:, j, i] = V
    s = np.moveaxis(s, 1, 2)
    return np.asarray(np.sum(s * np.linalg.solve(np.moveaxis(whole, 3, 1), s[..., None])[..., 0], axis=-1))


def quotient(x: Array, y: Array) -> Array:
    """``x/y``, 0 where y is no more than that."""
    return np.asarray(np.divide(x, y, out=np.zeros_like(x), where=y > 0))
