"""Which causes look alike on this log: how near what one could explain lies to what another could."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.fit import Fit, project
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.score import HIDDEN, Beside, batches, inverse, products
from gimbal_pin.diagnosis.search import spot
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause
from gimbal_pin.log import Array

SHOWN = 8
"""Most causes beside a finding."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """Candidates in a finding's place.

    Attributes:
        joint: Where the finding sits, or None.
        causes: Names: the finding first, then the likest (k).
        correlation: Largest cosine between what two of them can explain beside the model, in [0, 1], (k, k).
    """

    joint: str | None
    causes: tuple[str, ...]
    correlation: Array

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        rows = [[round(value, 4) for value in row] for row in self.correlation.tolist()]
        return {"joint": self.joint, "causes": list(self.causes), "correlation": rows}


def likeness(state: State, cause: Cause, shelf: Library) -> Likeness:
    """Compare a chosen cause with every other at its place, and these with each other.

    Columns are whitened, and freed of all that the rigid model, friction and the other findings explain: what is left
    of two of them is parted by this log only as far as the angle between them is wide.
    """
    base = without(state, cause)
    own = span(base, base.columns(cause))
    others = [columns for columns in shelf.columns(base, spot(cause)) if columns.cause.name != cause.name]
    best: dict[str, tuple[float, Columns]] = {}
    for columns, near in zip(others, nearness(base.fit, own, others).tolist()):
        if near > best.get(columns.cause.name, (0.0, columns))[0]:
            best[columns.cause.name] = near, columns
    ranked = sorted(best.items(), key=lambda entry: -entry[1][0])[:SHOWN]
    spans = [own, *(span(base, columns) for _, (_, columns) in ranked)]
    between = np.array([[cosine(a, b) for b in spans] for a in spans])
    return Likeness(cause.place if cause.of_joint else None, (cause.name, *(name for name, _ in ranked)), between)


def nearness(now: Fit, own: Array, others: Sequence[Columns]) -> Array:
    """Cosine of the smallest angle between a span, (rows n, k), and what the fit leaves of each of others, (m,).

    ``R = S - B Bᵀ S`` is left of one's columns S. Of the span Q, which is free of B, ``QᵀR = QᵀS``: the cosine is the
    largest singular value of ``QᵀS (RᵀR)^-½``.
    """
    found = np.zeros(len(others))
    for batch in batches(others):
        beside, c = Beside.of([others[i] for i in batch]), others[batch[0]].width
        S, rows = now.weighted(beside), now.rows(beside.joint)
        whole = products(S, c)
        gram = whole - products(now.along(S, beside.joint), c)
        across = np.swapaxes((own[rows].T @ S).reshape(own.shape[1], -1, c), 0, 1)
        power, all_ = (np.diagonal(x, axis1=1, axis2=2) for x in (gram, whole))
        bulk = np.array([[others[i].bulk] for i in batch])
        unit = np.where(power * bulk > HIDDEN * all_, 1 / np.sqrt(np.maximum(power, 1e-300)), 0.0)
        shown = gram * unit[:, :, None] * unit[:, None]
        across = across * unit[:, None]
        inside = across @ inverse(shown, 1e-12) @ across.mT
        found[batch] = np.sqrt(np.maximum(np.linalg.eigvalsh(inside)[:, -1], 0.0))
    return found


def span(state: State, columns: Columns) -> Array:
    """Orthonormal columns that span what the state leaves of some others, (rows n, k); none where nothing is left."""
    whole, rest = state.fit.weighted(columns), project(state.fit, columns)
    seen = np.sum(rest**2, axis=0) * columns.bulk > HIDDEN * np.maximum(np.sum(whole**2, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(rest[:, seen], full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size.max(initial=0.0)])


def cosine(a: Array, b: Array) -> float:
    """Cosine of the smallest angle between two spans, in [0, 1]."""
    return float(np.linalg.svd(a.T @ b, compute_uv=False).max(initial=0.0))
