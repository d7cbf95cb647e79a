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
    """Fit one candidate to the residual; `fixed`: its coefficient is one, as for a drive's signal.

    ``R = S - B Bᵀ S`` is what the fitted columns B leave of the candidate's S. As the residual is free of B, its
    products ``RᵀR = SᵀS - (BᵀS)ᵀ(BᵀS)`` and ``Rᵀr = Sᵀr`` need only the rows where S is not zero.
    """
    S, rows = now.weighted(columns), now.rows(columns.joint)
    whole = S.T @ S
    gram, s = whole - inside(now, S, columns.joint), S.T @ now.residual[rows]
    visible = share(gram, whole)
    nothing = Gained(0.0, np.zeros(0), np.zeros(0), visible)
    if visible < HIDDEN:
        return nothing
    own = np.linalg.lstsq(gram, s, rcond=1e-8)[0] if len(s) > 1 else s / gram[0]
    if np.any(own < columns.lower) or np.any(own > columns.upper) or overdone(now.target[rows], S @ own):
        return nothing
    beta = np.ones(1) if fixed else own
    gain = float(2 * s @ beta - beta @ gram @ beta)
    quiet = fixed and silences(now.target[rows], now.residual[rows], S[:, 0], gain)
    return nothing if quiet else Gained(gain, beta, own, visible)


def silences(target: Array, residual: Array, taken: Array, gain: float) -> bool:
    """Whether a drive's signal gains but by what it takes off the torque: of any torque less, less is unexplained."""
    rows = taken != 0
    whole = float(np.sum(target[rows] ** 2))
    less = 1.0 - float(np.sum((target[rows] - taken[rows]) ** 2)) / max(whole, 1e-300)
    return gain < SILENCED * less * float(np.sum(residual[rows] ** 2))


def visibility(now: Fit, columns: Placed) -> float:
    """Share of a candidate's power that the fitted columns leave."""
    S = now.weighted(columns)
    whole = S.T @ S
    return share(whole - inside(now, S, columns.joint), whole)


def inside(now: Fit, weighted: Array, joint: int | None) -> Array:
    """``(BᵀS)ᵀ(BᵀS)``: what the fitted columns take of a candidate's products, (c, c)."""
    along = now.along(weighted, joint)
    return np.asarray(along.T @ along)


def share(left: Array, whole: Array) -> float:
    """Trace of one matrix over that of another; 0 where that is nothing."""
    size = float(np.trace(whole))
    return float(np.trace(left)) / size if size > 0 else 0.0


def overdone(target: Array, torque: Array) -> bool:
    """Whether a cause takes far more torque than there is where it acts: it only works against the rigid model."""
    return float(torque @ torque) > OVERDONE**2 * float(np.sum(target[torque != 0] ** 2))


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
