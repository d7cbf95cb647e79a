"""Which groups of columns explain some rows: every set of groups by its marginal likelihood, and probabilities of each.

    y = X_f β + Σ_g (X_g b_g) + Z u + e,    b_g ~ N(m_g, v_g I),  u ~ N(0, τ² I),  e ~ N(0, I),  β flat

Bayesian variable selection with grouped spike and slab (George and McCulloch, Statistica Sinica 7, 1997); the dense
background u beside sparse effects as in SuSiE-inf (Cui et al., Nature Genetics 56, 2024).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from gimbal_pin.log.log import Array
from gimbal_pin.regression.gram import Gram, factor_posterior
from gimbal_pin.rig.brief import brief

BEAM = 6
"""Sets of each size that are extended. One is greedy; at six the laws' planted triples are found as by enumeration."""
LARGEST_SET = 10
"""Groups in the largest set."""
NEGLIGIBLE = 20.0
"""Log odds under the best set's at which a set is not extended: e⁻²⁰ of its probability."""


@dataclass(frozen=True)
class Group:
    """Columns that are in a model together or not at all.

    Attributes:
        key: What they stand for; of groups with one key, such as one cause with other shapes, a set holds one at most.
        columns: Their places in X.
        log_odds: Logarithm of the prior odds that the group is in.
        variances: Prior variances v of its coefficients, equally likely each.
        mean: Prior mean m of its coefficients.
        family: Of which kind it is one of several, such as one harmonic of a motor's cogging; None: it stands alone.
        log_odds_beside: The odds where a group of its family is in already; None: the same.
    """

    key: Hashable
    columns: slice
    log_odds: float
    variances: tuple[float, ...]
    mean: float = 0.0
    family: Hashable = None
    log_odds_beside: float | None = None


class ChosenSet(NamedTuple):
    """A set of groups.

    Attributes:
        groups: Their places in the sequence of groups, ascending.
        variances: The prior variance of each that explains most.
        log_posterior: Logarithm of evidence times prior, less that of the empty set.
        log_prior: Logarithm of its prior, less that of the empty set.
        log_share: Logarithm of how much of the evidence, averaged over a group's variances beside the groups that were
            in before it, is that of its best variance; the sum over the groups.
    """

    groups: tuple[int, ...]
    variances: tuple[float, ...]
    log_posterior: float
    log_prior: float
    log_share: float


@dataclass(frozen=True, eq=False)
class Selection:
    """Sets that explain some rows, the most probable first.

    Attributes:
        groups: The groups that were compared.
        sets: Every set that was visited.
        probabilities: Of each of the sets, (sets,); they sum to one.
    """

    groups: tuple[Group, ...]
    sets: tuple[ChosenSet, ...]
    probabilities: Array

    __repr__ = brief

    def keys(self, chosen: ChosenSet) -> frozenset[Hashable]:
        """Return what a set stands for."""
        return frozenset(self.groups[g].key for g in chosen.groups)

    def compute_inclusion(self) -> dict[Hashable, float]:
        """``P(key | y)``: the probability of all sets that hold a group of the key, the largest first."""
        found: dict[Hashable, float] = {}
        for chosen, probability in zip(self.sets, self.probabilities.tolist()):
            for key in self.keys(chosen):
                found[key] = found.get(key, 0.0) + probability
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def _list_places(groups: Sequence[Group], chosen: Sequence[int]) -> list[int]:
    """Places of the columns of some groups, one after the other."""
    return [place for g in chosen for place in range(groups[g].columns.start, groups[g].columns.stop)]


class _Batch(NamedTuple):
    """Groups of one width, side by side: their Gram matrices are taken apart together.

    Attributes:
        groups: Their places in the sequence of groups, (g,).
        places: Places of their columns, (g, w).
        grams: K's blocks of them, (g, w, w).
        mean: Prior means, (g, w).
        variances: Prior variances, (g, v); nan where a group has fewer than another.
    """

    groups: NDArray[np.intp]
    places: NDArray[np.intp]
    grams: Array
    mean: Array
    variances: Array


def _batch_groups(gram: Gram, groups: Sequence[Group]) -> list[_Batch]:
    """Return the groups by their width."""
    widths = np.array([group.columns.stop - group.columns.start for group in groups])
    most = max((len(group.variances) for group in groups), default=0)
    out = []
    for width in np.unique(widths):
        members = np.flatnonzero(widths == width)
        same = [groups[g] for g in members.tolist()]
        places = np.array([range(group.columns.start, group.columns.stop) for group in same])
        variances = np.full((len(same), most), np.nan)
        for row, group in zip(variances, same):
            row[: len(group.variances)] = group.variances
        mean = np.repeat([[group.mean] for group in same], width, axis=1)
        out.append(_Batch(members, places, gram.compute_blocks(places), mean, variances))
    return out


def _score_extensions(
    gram: Gram, rows: Array, groups: Sequence[Group], batches: Sequence[_Batch], chosen: ChosenSet
) -> tuple[float, Array, Array, Array]:
    """Evidence of a set, and what every group would add to it; all relative to the empty set.

    The set's own columns are swept, ``K ← K - K_s (K_ss + D⁻¹)⁻¹ K_sᵀ``, of which only the groups' blocks are made;
    then a group with mean m and variance v adds
    ``½ c'ᵀ(K + I/v)⁻¹c' + mᵀc - ½ mᵀKm - ½ log det(I + vK)``, ``c' = c - K m``.

    Args:
        gram: Inner products.
        rows: K's rows of the set's columns, (s, k).
        groups: What may be in.
        batches: The groups by their width.
        chosen: The set.

    Returns:
        Log evidence; what each group adds to it, averaged over its variances, (g,); the variance that adds most, (g,);
        the logarithm of the average over the most, (g,).
    """
    own = _list_places(groups, chosen.groups)
    widths = [groups[g].columns.stop - groups[g].columns.start for g in chosen.groups]
    means, variance = (np.repeat(x, widths) for x in ([groups[g].mean for g in chosen.groups], chosen.variances))
    factor, root = factor_posterior(rows[:, own], variance), np.sqrt(variance)[:, None]
    swept = solve_triangular(factor, root * rows, lower=True)
    c = gram.correlations - means @ rows
    b = solve_triangular(factor, root[:, 0] * c[own], lower=True)
    evidence = 0.5 * float(means @ (gram.correlations[own] + c[own]) + b @ b) - float(np.sum(np.log(np.diag(factor))))
    c = c - b @ swept
    gains, best, share = np.empty((3, len(groups)))
    for members, places, grams, mean, variances in batches:
        swept_of = swept.T[places]
        K = grams - swept_of @ swept_of.swapaxes(1, 2)
        power, axes = np.linalg.eigh(K)
        power, drawn = np.maximum(power, 0.0), np.einsum("gij,gj->gi", K, mean)
        along = np.einsum("gij,gi->gj", axes, c[places] - drawn)
        v = variances[:, :, None]
        found = 0.5 * np.sum(along[:, None] ** 2 / (power[:, None] + 1 / v) - np.log1p(v * power[:, None]), axis=2)
        found += np.sum(mean * (c[places] - 0.5 * drawn), axis=1)[:, None]
        found = np.where(np.isnan(variances), -np.inf, found)
        gains[members] = logsumexp(found, axis=1) - np.log(np.sum(np.isfinite(variances), axis=1))
        best[members] = variances[np.arange(len(members)), np.argmax(found, axis=1)]
        share[members] = gains[members] - np.max(found, axis=1)
    return evidence, gains, best, share


def select_groups(
    gram: Gram,
    groups: Sequence[Group],
    *,
    beam: int = BEAM,
    largest: int = LARGEST_SET,
    negligible: float = NEGLIGIBLE,
) -> Selection:
    """Find the sets of groups that explain the torque, and how probable each is.

    Of each size the most probable `beam` sets are extended by every group; every set that was looked at counts in the
    probabilities.

    Args:
        gram: Inner products of all groups' columns and the torque.
        groups: What may be in.
        beam: Sets of each size that are extended.
        largest: Groups in the largest set.
        negligible: Log odds under the best set's at which a set is not extended, and no further one looked at.
    """
    batches, odds = _batch_groups(gram, groups), np.array([group.log_odds for group in groups])
    beside = np.array([g.log_odds if g.log_odds_beside is None else g.log_odds_beside for g in groups])
    families = list(dict.fromkeys(g.family for g in groups if g.family is not None))
    kinds = np.array([-1 - k if g.family is None else families.index(g.family) for k, g in enumerate(groups)])
    visited: dict[tuple[int, ...], ChosenSet] = {(): ChosenSet((), (), 0.0, 0.0, 0.0)}
    front = list(visited.values())
    rows: dict[int, Array] = {}
    for _ in range(largest):
        found: dict[tuple[int, ...], ChosenSet] = {}
        for chosen in front:
            for g in set(chosen.groups) - set(rows):
                rows[g] = gram.compute_rows(_list_places(groups, [g]))
            own = np.concatenate([np.zeros((0, gram.width)), *(rows[g] for g in chosen.groups)])
            evidence, gains, variances, share = _score_extensions(gram, own, groups, batches, chosen)
            taken = {groups[g].key for g in chosen.groups}
            prior = chosen.log_prior + np.where(np.isin(kinds, kinds[list(chosen.groups)]), beside, odds)
            posterior = evidence + chosen.log_share + prior + gains
            for g in np.flatnonzero(posterior > posterior.max() - negligible).tolist():
                if groups[g].key in taken:
                    continue
                pairs = sorted(zip((*chosen.groups, g), (*chosen.variances, float(variances[g]))))
                members, used = (tuple(x) for x in zip(*pairs))
                if members not in found or posterior[g] > found[members].log_posterior:
                    share_of = chosen.log_share + float(share[g])
                    found[members] = ChosenSet(members, used, float(posterior[g]), float(prior[g]), share_of)
        visited |= found
        most = max(one.log_posterior for one in visited.values())
        front = sorted(found.values(), key=lambda one: -one.log_posterior)[:beam]
        front = [one for one in front if one.log_posterior > most - negligible]
    sets = sorted(visited.values(), key=lambda one: -one.log_posterior)
    logs = np.array([one.log_posterior for one in sets])
    return Selection(tuple(groups), tuple(sets), np.exp(logs - logsumexp(logs)))
