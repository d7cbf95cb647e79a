"""How near what one cause could explain lies to what another could, beside all that a fit explains already."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.fit import Fit, project
from gimbal_pin.diagnosis.score import HIDDEN, Beside, batches, inverse, products
from gimbal_pin.log import Array


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


def span(now: Fit, columns: Columns) -> Array:
    """Orthonormal columns that span what a fit leaves of some others, (rows n, k); none where nothing is left."""
    whole, rest = now.weighted(columns), project(now, columns)
    seen = np.sum(rest**2, axis=0) * columns.bulk > HIDDEN * np.maximum(np.sum(whole**2, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(rest[:, seen], full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size.max(initial=0.0)])


def cosine(a: Array, b: Array) -> float:
    """Cosine of the smallest angle between two spans, in [0, 1]."""
    return float(np.linalg.svd(a.T @ b, compute_uv=False).max(initial=0.0))
