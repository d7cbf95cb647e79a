"""What a further cause would gain beside all that is fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.fit import Fit
from gimbal_pin.log.log import Array

OVERDONE = 2.0
"""Torque of a cause over all that its joints carry from which it is none: it only works against the model."""


BATCH = 48
"""Candidates that are computed at once: more do not stay in the processor's own memory."""
HIDDEN = 1e-3
"""Share of a column's power below which the base columns hide it: three hundredths of its size."""
NIL = 1e-24
"""Power of a column, in units of noise, under which it is none: to show, its coefficient would have to be 1e12 of its
units. Dry friction that dies away with speed leaves such columns, of which rounding and underflow are all there is."""


class Gained(NamedTuple):
    """What a candidate would gain.

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


def gained(now: Fit, columns: Columns, fixed: bool) -> Gained:
    """Fit one candidate to the residual; `fixed`: its coefficient is one, as for a drive's signal."""
    return gained_alike(now, [columns], fixed)[0]


def all_gained(now: Fit, candidates: Sequence[Columns], fixed: bool) -> list[Gained]:
    """As `gained`, of many candidates, (k,)."""
    found: dict[int, Gained] = {}
    for batch in batches(candidates):
        found |= zip(batch, gained_alike(now, [candidates[i] for i in batch], fixed))
    return [found[i] for i in range(len(candidates))]


def gained_alike(now: Fit, candidates: Sequence[Columns], fixed: bool) -> list[Gained]:
    """Fit each of some candidates of one joint and width c to the residual.

    ``R = S - B Bᵀ S`` is what the fitted columns B leave of a candidate's S. As the residual is free of B, its
    products ``RᵀR = SᵀS - (BᵀS)ᵀ(BᵀS)`` and ``Rᵀr = Sᵀr`` need only the rows where S is not zero.
    """
    joint = candidates[0].joint
    c = candidates[0].width
    S = weigh_together(now, candidates)
    rows = now.rows(joint)
    whole = products(S, c)
    along = now.along(S, joint)
    gram = whole - products(along, c)
    s = (now.residual[rows] @ S).reshape(-1, c)
    own = fitting(gram, s)
    lower, upper = (
        np.stack(bounds) for bounds in zip(*((one.lower, one.upper) for one in candidates))
    )
    visible = share(gram, whole) * np.array([one.bulk for one in candidates])
    power = quadratic(whole, own) - compute_shared_power(S, own, candidates)
    wrong = (
        np.any((own < lower) | (own > upper), axis=1)
        | (power > OVERDONE**2 * measure_target(now, candidates))
        | (visible < HIDDEN)
    )
    beta = np.ones_like(own) if fixed else own
    gain = 2 * np.sum(beta * s, axis=1) - quadratic(gram, beta)
    every = map(Gained, gain.tolist(), beta, own, visible.tolist())
    nothing = np.zeros(0)
    return [
        Gained(0.0, nothing, nothing, one.visible) if none else one
        for one, none in zip(every, wrong)
    ]


def quadratic(gram: Array, beta: Array) -> Array:
    """``βᵀ G β``, (k,), of each G, (k, c, c), and β, (k, c)."""
    return np.asarray(np.sum(beta * (gram @ beta[..., None])[..., 0], axis=1))


def weigh_together(now: Fit, candidates: Sequence[Columns]) -> Array:
    """Weight columns of candidates of one joint, side by side, (rows, k c); rows next in memory."""
    return now.weighted(np.concatenate([one.own.T for one in candidates]).T, candidates[0].joint)


def batches(candidates: Sequence[Columns]) -> Iterator[list[int]]:
    """Yield places of candidates of one joint and width, as many as are computed at once."""
    groups: dict[tuple[int | None, int], list[int]] = {}
    for i, one in enumerate(candidates):
        groups.setdefault((one.joint, one.width), []).append(i)
    for group in groups.values():
        yield from (group[first : first + BATCH] for first in range(0, len(group), BATCH))


def each(columns: Array, c: int) -> Array:
    """Each c columns of some that stand side by side, (rows, k c), as rows: (k, c, rows)."""
    return columns.T.reshape(columns.shape[1] // c, c, len(columns))


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
    return np.asarray(
        (axes * np.divide(1.0, size, out=np.zeros_like(size), where=there)[..., None, :]) @ axes.mT
    )


def visibility(now: Fit, candidates: Sequence[Columns]) -> Array:
    """Share of each candidate's power that the fitted columns leave, (k,): of what sets it apart from friction."""
    visible = np.zeros(len(candidates))
    for batch in batches(candidates):
        S = weigh_together(now, [candidates[i] for i in batch])
        joint = candidates[batch[0]].joint
        c = candidates[batch[0]].width
        whole = products(S, c)
        visible[batch] = share(whole - products(now.along(S, joint), c), whole)
    return visible * np.array([one.bulk for one in candidates])


def share(left: Array, whole: Array) -> Array:
    """Traces of some matrices, (k, c, c), over those of others, (k,); 0 where that is `NIL`."""
    size = np.trace(whole, axis1=1, axis2=2)
    return np.divide(
        np.trace(left, axis1=1, axis2=2), size, out=np.zeros(len(size)), where=size > NIL
    )


def compute_shared_power(S: Array, own: Array, candidates: Sequence[Columns]) -> Array:
    """Power of what the friction that candidates share with the model takes back of their torques, (k,).

    Over part of a turn the cosine of an angle is nearly one: friction that varies there by a little is the difference
    of two that are large, and how large is the formula's choice.
    """
    power = np.zeros(len(candidates))
    for k, (columns, one) in enumerate(zip(each(S, own.shape[1]), candidates)):
        if (y := one.shared) is not None:
            power[k] = (own[k] @ (columns @ y)) ** 2 / max(float(y @ y), NIL)
    return power


def measure_target(now: Fit, candidates: Sequence[Columns]) -> Array:
    """``Σ target²`` over the joints at which each of some candidates acts, (k,)."""
    if (joint := candidates[0].joint) is not None:
        return np.full(len(candidates), now.power[joint])
    return np.array([np.any(one.own != 0, axis=(0, 2)) @ now.power for one in candidates])
