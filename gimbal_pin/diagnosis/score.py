"""What a further cause would gain, judged by blocks of time.

Noise of real sensors is coloured: the score ``zᵀr`` of a candidate column is compared with its own scatter over
blocks, not with a white noise's, and with what random signs of the blocks make of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy import fft
from scipy.ndimage import uniform_filter1d
from scipy.special import fdtrc, fdtri

from gimbal_pin.diagnosis.fit import Fit, Placed, project
from gimbal_pin.log import Array

OVERDONE = 2.0
"""Torque of a cause over all that its joints carry from which it is none."""
SILENCED = 1.5
"""Gain of a drive's signal over what as much less torque leaves unexplained less, under which it does only that."""
SMOOTH = 25
"""Frequencies over which a residual's spectrum is averaged."""
FEW = 12.0
"""Blocks under which their own scatter says too little."""


class Candidate(Placed, Protocol):
    """Whitened columns with bounds on their coefficients."""

    @property
    def lower(self) -> Array:
        """Bounds of the coefficients, (c,)."""

    @property
    def upper(self) -> Array:
        """The same."""


class Score(NamedTuple):
    """What a candidate would gain.

    Attributes:
        gain: Fall of the weighted sum of squares.
        wald: ``sᵀ V⁻¹ s``, s the score, V its scatter once the candidate is in.
        p: Of `wald`, without regard to how many were tried.
        beta: Coefficients, (c,).
        visible: Share of the column's power that the base columns leave.
        size: Root mean square of what it explains at each joint, in units of the noise floor, (n,).
    """

    gain: float
    wald: float
    p: float
    beta: Array
    visible: float
    size: Array


NOTHING = Score(0.0, 0.0, 1.0, np.zeros(0), 0.0, np.zeros(1))
BATCH = 16
"""Candidates whose flips are computed at once."""
HIDDEN = 1e-3
"""Share of a column's power below which the base columns hide it: three hundredths of its size."""


def score(now: Fit, columns: Candidate, fixed: bool) -> Score:
    """Score one candidate; `fixed`: its coefficient is one, as for a drive's signal."""
    found = gained(now, columns, fixed)
    if found.gain == 0.0:
        return NOTHING._replace(visible=found.visible)
    rest = project(now, columns)
    wald, blocks = strength(now, rest, now.residual - rest @ found.own)
    explained = (rest @ found.beta).reshape(-1, len(now.scale)) / now.scale
    size = np.sqrt(np.mean(explained**2, axis=0))
    return Score(found.gain, wald, float(chance(wald, len(found.own), blocks)), found.beta, found.visible, size)


class Gained(NamedTuple):
    """What a candidate would gain, without how sure that is, which costs most of a score.

    Attributes:
        gain: Fall of the weighted sum of squares; zero where the candidate is none.
        beta: Coefficients as applied, (c,).
        own: Coefficients that fit best, (c,).
        visible: Share of the column's power that the base columns leave.
    """

    gain: float
    beta: Array
    own: Array
    visible: float


def gained(now: Fit, columns: Candidate, fixed: bool) -> Gained:
    """Fit one candidate to the residual; `fixed`: its coefficient is one, as for a drive's signal."""
    return gained_alike(now, [columns], fixed)[0]


def all_gained(now: Fit, candidates: Sequence[Candidate], fixed: bool) -> list[Gained]:
    """As `gained`, of many candidates."""
    alike: dict[tuple[int | None, int], list[int]] = {}
    for i, columns in enumerate(candidates):
        alike.setdefault((columns.joint, columns.own.shape[-1]), []).append(i)
    found: dict[int, Gained] = {}
    for group in alike.values():
        for batch in (group[first : first + BATCH] for first in range(0, len(group), BATCH)):
            found |= zip(batch, gained_alike(now, [candidates[i] for i in batch], fixed))
    return [found[i] for i in range(len(candidates))]


def gained_alike(now: Fit, candidates: Sequence[Candidate], fixed: bool) -> list[Gained]:
    """Fit each of some candidates of one joint and width c to the residual.

    ``R = S - B Bᵀ S`` is what the fitted columns B leave of a candidate's S. As the residual is free of B, its
    products ``RᵀR = SᵀS - (BᵀS)ᵀ(BᵀS)`` and ``Rᵀr = Sᵀr`` need only the rows where S is not zero.
    """
    joint = candidates[0].joint
    rows = now.rows(joint)
    target, residual = now.target[rows], now.residual[rows]
    S = np.stack([now.weighted(columns) for columns in candidates])
    whole = turned(S) @ S
    along = now.along(S, joint)
    gram, s = whole - turned(along) @ along, residual @ S
    visible = share(gram, whole)
    own = fitting(gram, s)
    torque = (S @ own[..., None])[..., 0]
    lower, upper = (np.stack(bounds) for bounds in zip(*((one.lower, one.upper) for one in candidates)))
    wrong = np.any((own < lower) | (own > upper), axis=1) | overdone(target, torque) | (visible < HIDDEN)
    beta = np.ones_like(own) if fixed else own
    gain = 2 * np.sum(s * beta, axis=1) - np.sum(beta * (gram @ beta[..., None])[..., 0], axis=1)
    if fixed:
        wrong |= [silences(target, residual, x[:, 0], y) for x, y in zip(S, gain.tolist())]
    every = map(Gained, gain.tolist(), beta, own, visible.tolist())
    nothing = np.zeros(0)
    return [Gained(0.0, nothing, nothing, one.visible) if none else one for one, none in zip(every, wrong)]


def turned(matrices: Array) -> Array:
    """Each matrix transposed, (..., a, b) to (..., b, a)."""
    return np.swapaxes(matrices, -1, -2)


def fitting(gram: Array, s: Array) -> Array:
    """``G⁺ s``, (k, c), of symmetric G, (k, c, c): what of G is not there asks for no coefficient."""
    if s.shape[1] == 1:
        return np.divide(s, gram[:, 0], out=np.zeros_like(s), where=gram[:, 0] > 0)
    return np.asarray((np.linalg.pinv(gram, rcond=1e-8, hermitian=True) @ s[..., None])[..., 0])


def silences(target: Array, residual: Array, taken: Array, gain: float) -> bool:
    """Whether a drive's signal gains but by what it takes off the torque: of any torque less, less is unexplained."""
    rows = taken != 0
    whole = float(np.sum(target[rows] ** 2))
    less = 1.0 - float(np.sum((target[rows] - taken[rows]) ** 2)) / max(whole, 1e-300)
    return gain < SILENCED * less * float(np.sum(residual[rows] ** 2))


def visibility(now: Fit, columns: Placed) -> float:
    """Share of a candidate's power that the fitted columns leave."""
    S = now.weighted(columns)
    whole, along = S.T @ S, now.along(S, columns.joint)
    return float(share(whole - along.T @ along, whole))


def share(left: Array, whole: Array) -> Array:
    """Trace of one matrix over that of another, (..., c, c); 0 where that is nothing."""
    rest, size = (np.trace(x, axis1=-2, axis2=-1) for x in (left, whole))
    return np.asarray(np.where(size > 0, rest, 0.0) / np.where(size > 0, size, 1.0))


def overdone(target: Array, torque: Array) -> Array:
    """Whether a cause takes far more torque, (..., rows), than there is where it acts, working against the model."""
    there = (torque != 0) @ target**2
    return np.asarray(np.sum(torque**2, axis=-1) > OVERDONE**2 * there)


def strength(now: Fit, rest: Array, after: Array) -> tuple[float, float]:
    """``sᵀ V⁻¹ s`` of projected columns (rows n, c), and how many blocks V rests on; `after`: the residual with them.

    V is the score's own scatter over blocks. Columns that act in few blocks say too little of it: they must stand
    against stationary noise of the residual's spectrum as well.
    """
    s, sums, blocks = rest.T @ now.residual, now.by_block(rest * after[:, None]), effective(now, rest)
    wald = against(sums.T @ sums, s)
    if blocks < FEW:
        return min(wald, against(stationary(now, rest, after), s)), float(now.blocks)
    return wald, blocks


def against(V: Array, s: Array) -> float:
    """``sᵀ V⁻¹ s``."""
    return float(s @ np.linalg.lstsq(V, s, rcond=1e-12)[0])


def stationary(now: Fit, rest: Array, residual: Array) -> Array:
    """``Σ_f R(f)ᴴ S(f) R(f)``: covariance of ``Rᵀr``, (c, c), for stationary noise r of a residual's spectrum S.

    The spectrum is smoothed, and larger by the share of its band that the columns themselves have taken out of it.
    """
    columns, rows = (x.reshape(-1, len(now.scale), x.shape[1]) for x in (rest, residual[:, None]))
    spectrum, power = fft.rfft(columns, axis=0), np.abs(fft.rfft(rows[:, :, 0], axis=0)) ** 2 / len(rows)
    twice = np.full(len(spectrum), 2.0)
    twice[0] = 1.0
    if len(columns) % 2 == 0:
        twice[-1] = 1.0
    smooth = uniform_filter1d(power, SMOOTH, axis=0) * (1.0 + rest.shape[1] / SMOOTH)
    weighted = spectrum * (smooth * twice[:, None] / len(columns))[:, :, None]
    return np.asarray(np.einsum("fjc,fjd->cd", spectrum.conj(), weighted).real)


def effective(now: Fit, rest: Array) -> float:
    """Blocks in which projected columns (rows n, c) act: see `acting`."""
    return float(acting(grams(now, rest)))


def acting(gram: Array) -> Array:
    """``c²/Σ_i h_i²``, h_i the leverage ``tr(G⁻¹ G_i)`` of each block, from their ``G_i = RᵀR``, (..., blocks, c, c).

    What acts in three blocks only has a score of which only three are independent, however long the log.
    """
    inverse = np.linalg.pinv(gram.sum(axis=-3), rcond=1e-12, hermitian=True)
    leverage = np.sum(gram * inverse[..., None, :, :], axis=(-2, -1))
    return np.asarray(np.sum(leverage, axis=-1) ** 2 / np.maximum(np.sum(leverage**2, axis=-1), 1e-300))


def chance(wald: Array | float, width: int, blocks: float) -> Array | float:
    """Hotelling's T² with `width` coefficients over `blocks` blocks: chance of as much or more."""
    freedom = max(blocks - width, 1.0)
    return np.asarray(fdtrc(width, freedom, wald * freedom / (width * max(blocks - 1, 1.0))))


def flipped(now: Fit, candidates: Sequence[Candidate], rng: np.random.Generator, flips: int = 499) -> Array:
    """``min over candidates of p`` for random signs of the residual's blocks, (flips,), sorted.

    Where nothing is left to be found the blocks' signs do not matter: what the search makes of flipped residuals is
    what it makes of noise of this very colour.
    """
    signs = rng.choice([-1.0, 1.0], size=(flips, now.blocks))
    by_width: dict[int, list[Candidate]] = {}
    for columns in candidates:
        if visibility(now, columns) > HIDDEN:
            by_width.setdefault(columns.own.shape[-1], []).append(columns)
    lowest = np.ones(flips)
    for width, group in by_width.items():
        for first in range(0, len(group), BATCH):
            for wald, blocks in flipped_alike(now, group[first : first + BATCH], signs):
                lower(lowest, wald, width, blocks)
    return np.sort(lowest)


def lower(lowest: Array, wald: Array, width: int, blocks: float) -> None:
    """Lower each of some chances to that of a `wald` that is less likely, (flips,).

    Few are: the others cannot be, being under what has the largest of the chances.
    """
    freedom = max(blocks - width, 1.0)
    least = fdtri(width, freedom, 1.0 - np.max(lowest)) * width * max(blocks - 1, 1.0) / freedom
    far = np.flatnonzero(wald > least)
    lowest[far] = np.minimum(lowest[far], chance(wald[far], width, blocks))


def flipped_alike(now: Fit, candidates: Sequence[Candidate], signs: Array) -> Iterator[tuple[Array, float]]:
    """Yield `wald` as in `score`, for each row of signs of the residual's blocks, (flips,), and its number of blocks.

    Args:
        now: The fit.
        candidates: Of one width c.
        signs: Of each block, (flips, blocks).
    """
    rests = [project(now, columns) for columns in candidates]
    scatter = np.stack([now.by_block(rest * now.residual[:, None]) for rest in rests])
    gram = np.stack([grams(now, rest) for rest in rests])
    for row, rest, own, blocks in zip(flipped_wald(signs, scatter, gram), rests, scatter, acting(gram).tolist()):
        if blocks < FEW:
            s, V = signs @ own, stationary(now, rest, now.residual)
            row = np.minimum(row, np.sum(s * np.linalg.lstsq(V, s.T, rcond=1e-12)[0].T, axis=1))
            blocks = float(now.blocks)
        yield row, blocks


def grams(now: Fit, rest: Array) -> Array:
    """``Rᵀ R`` of each block, (blocks, c, c)."""
    products = rest[:, :, None] * rest[:, None, :]
    return now.by_block(products.reshape(len(rest), -1)).reshape(-1, rest.shape[1], rest.shape[1])


def flipped_wald(signs: Array, scatter: Array, gram: Array) -> Array:
    """``sᵀ V⁻¹ s`` as in `score`, for each row of signs: ``s = Σ ±x``, ``V = Σ (±x - G β)(±x - G β)ᵀ``, (k, flips).

    Args:
        signs: Of each block, (flips, blocks).
        scatter: Scores x of k candidates in each block, (k, blocks, c).
        gram: G of each block, (k, blocks, c, c).
    """
    flips, (k, blocks, c) = len(signs), scatter.shape
    s = signs @ scatter
    beta = s @ np.linalg.pinv(gram.sum(axis=1), rcond=1e-8, hermitian=True)
    crossing = (scatter[:, :, :, None, None] * gram[:, :, None]).reshape(k, blocks, -1)
    cross = ((signs @ crossing).reshape(k, flips, c * c, c) @ beta[:, :, :, None]).reshape(k, flips, c, c)
    squared = np.einsum("kbip,kbjq->kpqij", gram, gram, optimize=True).reshape(k, c * c, c * c)
    both = ((beta[..., :, None] * beta[..., None, :]).reshape(k, flips, -1) @ squared).reshape(k, flips, c, c)
    V = (np.swapaxes(scatter, 1, 2) @ scatter)[:, None] - cross - np.swapaxes(cross, 2, 3) + both
    V += 1e-12 * np.trace(V, axis1=2, axis2=3)[..., None, None] * np.eye(c)
    return over(V, s)


def over(V: Array, s: Array) -> Array:
    """``sᵀ V⁻¹ s`` of many symmetric V, (..., c, c), and s, (..., c); without a solver's call for each small one."""
    if s.shape[-1] == 1:
        return np.asarray(s[..., 0] ** 2 / V[..., 0, 0])
    if s.shape[-1] == 2:
        x, y, a, b, d = s[..., 0], s[..., 1], V[..., 0, 0], V[..., 0, 1], V[..., 1, 1]
        return np.asarray((x * x * d - 2 * x * y * b + y * y * a) / (a * d - b * b))
    return np.asarray(np.sum(s * np.linalg.solve(V, s[..., None])[..., 0], axis=-1))
