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
from scipy.special import fdtrc

from gimbal_pin.diagnosis.fit import Fit, Placed, Shown, project
from gimbal_pin.log import Array
from gimbal_pin.rows import Flags

OVERDONE = 2.0
"""Torque of a cause over all that its joints carry from which it is none."""
SILENCED = 1.5
"""Gain of a drive's signal over what as much less torque leaves unexplained less, under which it does only that."""
CLEARED = 0.25
"""What is left with a drive's signal over what of the unexplained torque it passes on, from which it explains that."""
SMOOTH = 25
"""Frequencies over which a residual's spectrum is averaged."""
FEW = 12.0
"""Blocks under which their own scatter says too little."""


class Candidate(Shown, Protocol):
    """Whitened columns with bounds on their coefficients."""

    @property
    def lower(self) -> Array:
        """Bounds of the coefficients, (c,)."""

    @property
    def upper(self) -> Array:
        """The same."""

    @property
    def shared(self) -> Array | None:
        """Coulomb friction, (rows,), that takes up any part of them; None: nothing does."""


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
"""Candidates that are computed at once: more do not stay in the processor's own memory."""
HIDDEN = 1e-3
"""Share of a column's power below which the base columns hide it: three hundredths of its size."""
NIL = 1e-24
"""Power of a column, in units of noise, under which it is none: to show, its coefficient would have to be 1e12 of its
units. Dry friction that dies away with speed leaves such columns, of which rounding and underflow are all there is."""


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
    """As `gained`, of many candidates, (k,)."""
    found: dict[int, Gained] = {}
    for batch in batches(candidates):
        found |= zip(batch, gained_alike(now, [candidates[i] for i in batch], fixed))
    return [found[i] for i in range(len(candidates))]


def gained_alike(now: Fit, candidates: Sequence[Candidate], fixed: bool) -> list[Gained]:
    """Fit each of some candidates of one joint and width c to the residual.

    ``R = S - B Bᵀ S`` is what the fitted columns B leave of a candidate's S. As the residual is free of B, its
    products ``RᵀR = SᵀS - (BᵀS)ᵀ(BᵀS)`` and ``Rᵀr = Sᵀr`` need only the rows where S is not zero.
    """
    beside, c = Beside.of(candidates), candidates[0].own.shape[-1]
    S, rows = now.weighted(beside), now.rows(beside.joint)
    whole, target, residual = products(S, c), now.target[rows], now.residual[rows]
    along = now.along(S, beside.joint)
    gram, s = whole - products(along, c), (residual @ S).reshape(-1, c)
    own = fitting(gram, s)
    lower, upper = (np.stack(bounds) for bounds in zip(*((one.lower, one.upper) for one in candidates)))
    visible = share(gram, whole) * np.array([one.bulk for one in candidates])
    torque = (own[:, None] @ each(S, c))[:, 0]
    wrong = (
        np.any((own < lower) | (own > upper), axis=1)
        | overdone(target, beyond(torque, candidates))
        | (visible < HIDDEN)
    )
    beta = np.ones_like(own) if fixed else own
    gain = np.sum(beta * (2 * s - (gram @ beta[..., None])[..., 0]), axis=1)
    if fixed:
        after = residual[:, None] - S + now.basis[rows] @ along
        wrong |= [silences(target, residual, *one) for one in zip(S.T, after.T, gain.tolist())]
    every, nothing = map(Gained, gain.tolist(), beta, own, visible.tolist()), np.zeros(0)
    return [Gained(0.0, nothing, nothing, one.visible) if none else one for one, none in zip(every, wrong)]


class Beside(NamedTuple):
    """Columns of some candidates of one joint, side by side, (rows, k c) or (rows, n, k c); rows next in memory."""

    joint: int | None
    own: Array

    @staticmethod
    def of(candidates: Sequence[Placed]) -> Beside:
        """Put them side by side."""
        return Beside(candidates[0].joint, np.concatenate([one.own.T for one in candidates]).T)


def batches(candidates: Sequence[Placed]) -> Iterator[list[int]]:
    """Yield places of candidates of one joint and width, as many as are computed at once."""
    groups: dict[tuple[int | None, int], list[int]] = {}
    for i, one in enumerate(candidates):
        groups.setdefault((one.joint, one.own.shape[-1]), []).append(i)
    for group in groups.values():
        yield from (group[first : first + BATCH] for first in range(0, len(group), BATCH))


def each(columns: Array, c: int) -> Array:
    """Each c columns of some that stand side by side, (rows, k c), as rows: (k, c, rows)."""
    return columns.T.reshape(-1, c, len(columns))


def products(columns: Array, c: int) -> Array:
    """``SᵀS`` of each c columns of some that stand side by side, (rows, k c): (k, c, c)."""
    S = each(columns, c)
    return np.asarray(S @ S.mT)


def fitting(gram: Array, s: Array) -> Array:
    """``G⁺ s``, (k, c), of symmetric G, (k, c, c): what of G is not there asks for no coefficient."""
    return np.asarray((inverse(gram, 1e-8) @ s[..., None])[..., 0])


def inverse(gram: Array, share: float) -> Array:
    """Pseudo-inverse of symmetric positive G, (..., c, c), without what is under a share of its largest eigenvalue.

    Nor of what is under that share of nothing: see `NIL`.
    """
    if gram.shape[-1] == 1:
        return np.divide(1.0, gram, out=np.zeros_like(gram), where=gram > share * NIL)
    size, axes = np.linalg.eigh(gram)
    there = size > share * np.maximum(size[..., -1:], NIL)
    return np.asarray((axes * np.divide(1.0, size, out=np.zeros_like(size), where=there)[..., None, :]) @ axes.mT)


def silences(target: Array, residual: Array, taken: Array, after: Array, gain: float) -> bool:
    """Whether a drive's signal gains but by what it takes off the torque: of any torque less, less is unexplained.

    One that leaves next to nothing of what is unexplained of the share that it passes on does more, however much it
    takes; `after` is the residual at its joint once it is in.
    """
    rows = taken != 0
    whole, missed = float(np.sum(target[rows] ** 2)), float(np.sum(residual[rows] ** 2))
    passed = float(np.sum((target[rows] - taken[rows]) ** 2)) / max(whole, 1e-300)
    return gain < SILENCED * (1.0 - passed) * missed and float(np.sum(after[rows] ** 2)) > CLEARED * passed * missed


def visibility(now: Fit, candidates: Sequence[Shown]) -> Array:
    """Share of each candidate's power that the fitted columns leave, (k,): of what sets it apart from friction."""
    visible = np.zeros(len(candidates))
    for batch in batches(candidates):
        beside, c = Beside.of([candidates[i] for i in batch]), candidates[batch[0]].own.shape[-1]
        S = now.weighted(beside)
        whole = products(S, c)
        visible[batch] = share(whole - products(now.along(S, beside.joint), c), whole)
    return visible * np.array([one.bulk for one in candidates])


def share(left: Array, whole: Array) -> Array:
    """Traces of some matrices, (k, c, c), over those of others, (k,); 0 where that is `NIL`."""
    size = np.trace(whole, axis1=1, axis2=2)
    return np.divide(np.trace(left, axis1=1, axis2=2), size, out=np.zeros(len(size)), where=size > NIL)


def beyond(torques: Array, candidates: Sequence[Candidate]) -> Array:
    """Torques of candidates, (k, rows), without what of them the friction that they share with the model takes back.

    Over part of a turn the cosine of an angle is nearly one: friction that varies there by a little is the difference
    of two that are large, and how large is the formula's choice.
    """
    parted = [t if one.shared is None else less(t, one.shared) for t, one in zip(torques, candidates)]
    return np.stack(parted)


def less(torque: Array, other: Array) -> Array:
    """``x - y (y·x)/(y·y)``."""
    return np.asarray(torque - other * (other @ torque) / max(float(other @ other), NIL))


def overdone(target: Array, torque: Array) -> Flags:
    """Whether causes, (k, rows), take far more torque than there is where they act: they only work against the model.

    ``Σ τ² > OVERDONE² Σ target²`` over the rows where τ is not zero.
    """
    return np.asarray(np.sum(torque**2, axis=1) > OVERDONE**2 * ((torque != 0).astype(float) @ target**2))


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

    The spectrum is smoothed, and larger by the share of its band that the columns themselves have taken out of it, and
    by how much louder than on the whole the residual is where the columns act: see `local`.
    """
    columns, rows = (x.reshape(-1, len(now.scale), x.shape[1]) for x in (rest, residual[:, None]))
    spectrum, power = fft.rfft(columns, axis=0), np.abs(fft.rfft(rows[:, :, 0], axis=0)) ** 2 / len(rows)
    twice = np.full(len(spectrum), 2.0)
    twice[0] = 1.0
    if len(columns) % 2 == 0:
        twice[-1] = 1.0
    smooth = uniform_filter1d(power, SMOOTH, axis=0) * (1.0 + rest.shape[1] / SMOOTH) * local(columns, rows[:, :, 0])
    weighted = spectrum * (smooth * twice[:, None] / len(columns))[:, :, None]
    return np.asarray(np.einsum("fjc,fjd->cd", spectrum.conj(), weighted).real)


def local(columns: Array, residual: Array) -> Array:
    """``Σ_t h r² / (Σ_t h ⟨r²⟩)``, (n,), at least one: power of a residual, (rows, n), where columns act over its mean.

    h is the columns' power, (rows, n, c) summed. What a model leaves in few moments, at the steps of a staircase, is no
    stationary noise, and whatever acts in those moments alone would stand far out from its mean.
    """
    acts, power = np.sum(columns**2, axis=2), residual**2
    mean = np.sum(acts, axis=0) * np.mean(power, axis=0)
    return np.maximum(np.sum(acts * power, axis=0) / np.maximum(mean, 1e-300), 1.0)


def effective(now: Fit, rest: Array) -> float:
    """Blocks in which projected columns (rows n, c) act: see `acting`."""
    return float(acting(grams(now, rest, rest.shape[1])[0]))


def acting(gram: Array) -> Array:
    """``c²/Σ_i h_i²``, h_i the leverage ``tr(G⁻¹ G_i)`` of each block, from their ``G_i = RᵀR``, (..., c, c, blocks).

    What acts in three blocks only has a score of which only three are independent, however long the log.
    """
    inside = inverse(gram.sum(axis=-1), 1e-12)
    leverage = np.sum(gram * inside[..., None], axis=(-3, -2))
    return np.asarray(np.sum(leverage, axis=-1) ** 2 / np.maximum(np.sum(leverage**2, axis=-1), 1e-300))


def chance(wald: Array | float, width: int, blocks: float) -> Array | float:
    """Hotelling's T² with `width` coefficients over `blocks` blocks: chance of as much or more."""
    freedom = max(blocks - width, 1.0)
    return np.asarray(fdtrc(width, freedom, wald * freedom / (width * max(blocks - 1, 1.0))))


def grams(now: Fit, rest: Array, c: int) -> Array:
    """``RᵀR`` of each block, of each c columns of some that stand side by side, (rows n, k c): (k, c, c, blocks)."""
    R = each(rest, c)
    return np.add.reduceat(R[:, :, None] * R[:, None, :], now.starts, axis=-1)
