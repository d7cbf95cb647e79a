"""What each input of a design does to a value: Sobol indices of Saltelli's design, rank correlations of any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
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

    @property
    def size(self) -> float:
        """What inputs are ordered by."""
        return abs((self.rank_correlation if self.total is None else self.total) or 0.0)


def rank_influences(design: RigDesign, used: Array) -> tuple[Influence, ...]:
    """Return what each input does to the values of a design's rigs, (N,), largest first; infinite: it failed.

    A base point of which a rig failed has no indices and is left out whole; a rank it has.
    """
    if not design.sobol:
        shares = np.array([unit.shares for unit in design])
        found = [
            Influence(name, rank_correlation=correlate_ranks(own, used)) for name, own in zip(design.inputs, shares.T)
        ]
    else:
        whole = np.isfinite(used).reshape(-1, design.group).all(axis=1)
        found = compute_sobol_indices(design, used.reshape(-1, design.group)[whole].ravel())
    return tuple(sorted(found, key=lambda own: -own.size))


def correlate_ranks(share: Array, used: Array) -> float | None:
    """Return Spearman's rank correlation; None where there is nothing to rank."""
    if len(used) < 3 or (used == used[0]).all():
        return None
    return float(spearmanr(share, used).statistic)


def compute_sobol_indices(design: RigDesign, used: Array) -> list[Influence]:
    """Return each input's Sobol indices (SALib) from the values of whole base points; none where nothing differs."""
    if len(used) < 2 * design.group or np.ptp(used) == 0:
        return [Influence(name) for name in design.inputs]
    from SALib.analyze import sobol

    found = sobol.analyze(
        design.problem,
        (used - used.mean()) / used.std(),
        calc_second_order=False,
        num_resamples=RESAMPLED,
        conf_level=CONFIDENCE,
        seed=design.seed,
    )
    columns = (np.asarray(found[key]).tolist() for key in ("S1", "S1_conf", "ST", "ST_conf"))
    return [Influence(name, *row) for name, *row in zip(design.inputs, *columns)]
