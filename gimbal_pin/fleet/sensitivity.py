"""What each input of a design does to a value: Sobol indices of Saltelli's design, rank correlations of any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import spearmanr

from gimbal_pin.fleet.variation import RigDesign
from gimbal_pin.log.log import Array

CONFIDENCE = 0.95
"""Of every interval that is stated."""
RESAMPLED = 200
"""Bootstrap samples behind the confidence of a Sobol index."""


@dataclass(frozen=True)
class Influence:
    """What an input does to how much of the specification a rig uses.

    Attributes:
        input: The input.
        first: First-order Sobol index: the share of the variance that it explains alone; None: no such design.
        first_confidence: Half of its interval of 95 % confidence.
        total: Total index: the share that would be left if all others were known.
        total_confidence: The same of it.
        rank_correlation: Spearman's; None in a Sobol design.
    """

    input: str
    first: float | None = None
    first_confidence: float | None = None
    total: float | None = None
    total_confidence: float | None = None
    rank_correlation: float | None = None


def rank_influences(design: RigDesign, used: Array) -> tuple[Influence, ...]:
    """Return what each input does to the values of a design's rigs, (N,), largest first; infinite: it failed.

    A base point of which a rig failed has no indices and is left out whole; a rank it has.
    """
    if design.sobol:
        points = used.reshape(-1, design.group)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2 or np.ptp(points) == 0:
            return tuple(map(Influence, design.inputs))
        rows = zip(design.inputs, estimate_sobol_indices(points, design.seed).T.tolist())
        return tuple(sorted((Influence(name, *row) for name, row in rows), key=lambda own: -abs(own.total or 0.0)))
    if len(used) < 3 or np.all(used == used[0]):
        return tuple(map(Influence, design.inputs))
    shares = np.array([unit.shares for unit in design]).T
    ranks = ((name, float(spearmanr(own, used).statistic)) for name, own in zip(design.inputs, shares))
    found = (Influence(name, rank_correlation=rank) for name, rank in ranks)
    return tuple(sorted(found, key=lambda own: -abs(own.rank_correlation or 0.0)))


def estimate_sobol_indices(points: Array, seed: int) -> Array:
    """Return first-order indices, half of their intervals, total indices, half of theirs, (4, d).

    Args:
        points: Values of A, of A with each input from B, and of B, (N, d + 2).
        seed: Seed of the bootstrap.
    """
    resampled = np.random.default_rng(seed).integers(len(points), size=(len(points), RESAMPLED))
    centred = points - points.mean()
    std = np.std([compute_sobol_indices(centred[own]) for own in resampled.T], axis=0, ddof=1)
    return np.stack([compute_sobol_indices(centred), ndtri(0.5 + CONFIDENCE / 2) * std], axis=1).reshape(4, -1)


def compute_sobol_indices(centred: Array) -> Array:
    """``S = mean(f_B (f_AB - f_A)) / V,  T = mean((f_A - f_AB)²) / 2 V``, (2, d), from centred values (N, d + 2).

    Saltelli et al., Computer Physics Communications 181 (2010), table 2 (b) and (f).
    """
    a, mixed, b = centred[:, :1], centred[:, 1:-1], centred[:, -1:]
    return np.array([(b * (mixed - a)).mean(axis=0), ((a - mixed) ** 2).mean(axis=0) / 2]) / np.var([a, b])
