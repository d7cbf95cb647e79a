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


def project_rows(rows: Array, free: Array, background: Array, size: float) -> Array:
    """``V^{-1/2} P rows``: rows without what free columns and a background explain, such that their noise is white.

    V is ``I + τ² Z Zᵀ`` and P the projection off the free columns in its metric: inner products of the result are
    ``rowsᵀ (V⁻¹ - V⁻¹ X_f (X_fᵀ V⁻¹ X_f)⁻¹ X_fᵀ V⁻¹) rows``, all that marginal likelihoods need of them.

    Args:
        rows: Columns and the torque, (N, k).
        free: X_f, (N, f).
        background: Z, (N, z).
        size: τ.

    Returns:
        (N + z, k): the last rows are those of the background's prior.
    """
    z = background.shape[1]
    known = np.zeros((len(rows) + z, free.shape[1] + z))
    known[: len(rows), : free.shape[1]], known[: len(rows), free.shape[1] :] = free, size * background
    known[len(rows) :, free.shape[1] :] = np.eye(z)
    scale = np.linalg.norm(known, axis=0)
    left, values, _ = np.linalg.svd(known / np.where(scale > 0, scale, 1.0), full_matrices=False)
    Q = left[:, values > 1e-10 * values.max(initial=0.0)]
    padded = np.concatenate([rows, np.zeros((z, rows.shape[1]))])
    return np.asarray(padded - Q @ (Q.T @ padded))


class _Batch(NamedTuple):
    """Groups of one width, side by side: their Gram matrices are taken apart together.

    Attributes:
        groups: Their places in the sequence of groups, (g,).
        places: Places of their columns in X, (g, w).
        grams: ``X_gᵀ X_g``, (g, w, w).
        mean: Prior means, (g, w).
        variances: Prior variances, (g, v); nan where a group has fewer than another.
    """

    groups: NDArray[np.intp]
    places: NDArray[np.intp]
    grams: Array
    mean: Array
    variances: Array


def _batch_groups(X: Array, groups: Sequence[Group]) -> list[_Batch]:
    """Return the groups by their width."""
    widths = np.array([group.columns.stop - group.columns.start for group in groups])
    most = max((len(group.variances) for group in groups), default=0)
    out = []
    for width in np.unique(widths):
        members = np.flatnonzero(widths == width)
        same = [groups[g] for g in members.tolist()]
        places = np.array([range(group.columns.start, group.columns.stop) for group in same])
        own = X[:, places]
        variances = np.full((len(same), most), np.nan)
        for row, group in zip(variances, same):
            row[: len(group.variances)] = group.variances
        mean = np.repeat([[group.mean] for group in same], width, axis=1)
        out.append(_Batch(members, places, np.einsum("rgi,rgj->gij", own, own), mean, variances))
    return out


def _score_extensions(
    X: Array, y: Array, groups: Sequence[Group], batches: Sequence[_Batch], chosen: ChosenSet
) -> tuple[float, Array, Array, Array]:
    """Evidence of a set, and what every group would add to it; all relative to the empty set.

    The set's own columns are swept, ``K ← K - K_s (K_ss + D⁻¹)⁻¹ K_sᵀ``, of which only the groups' blocks are made;
    then a group with mean m and variance v adds
    ``½ c'ᵀ(K + I/v)⁻¹c' + mᵀc - ½ mᵀKm - ½ log det(I + vK)``, ``c' = c - K m``.

    Returns:
        Log evidence; what each group adds to it, averaged over its variances, (g,); the variance that adds most, (g,);
        the logarithm of the average over the most, (g,).
    """
    own = np.concatenate([X[:, :0], *(X[:, groups[g].columns] for g in chosen.groups)], axis=1)
    widths = [groups[g].columns.stop - groups[g].columns.start for g in chosen.groups]
    means, variance = (np.repeat(x, widths) for x in ([groups[g].mean for g in chosen.groups], chosen.variances))
    left = y - own @ means
    factor = np.linalg.cholesky(own.T @ own + np.diag(1.0 / variance))
    swept = solve_triangular(factor, own.T @ X, lower=True)
    b = solve_triangular(factor, own.T @ left, lower=True)
    half_log_det = float(np.sum(np.log(np.diag(factor))) + 0.5 * np.sum(np.log(variance)))
    evidence, c = 0.5 * float(y @ y - left @ left + b @ b) - half_log_det, X.T @ left - swept.T @ b
    gains, best, share = np.empty((3, len(groups)))
    for members, places, grams, mean, variances in batches:
        K = grams - np.einsum("sgi,sgj->gij", swept[:, places], swept[:, places])
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
    X: Array,
    y: Array,
    groups: Sequence[Group],
    *,
    beam: int = BEAM,
    largest: int = LARGEST_SET,
    negligible: float = NEGLIGIBLE,
) -> Selection:
    """Find the sets of groups that explain y, and how probable each is.

    Of each size the most probable `beam` sets are extended by every group; every set that was looked at counts in the
    probabilities.

    Args:
        X: Columns with what every model holds projected off, see `project_rows`, (N, k).
        y: The same of the torque, (N,).
        groups: What may be in.
        beam: Sets of each size that are extended.
        largest: Groups in the largest set.
        negligible: Log odds under the best set's at which a set is not extended, and no further one looked at.
    """
    batches, odds = _batch_groups(X, groups), np.array([group.log_odds for group in groups])
    beside = np.array([g.log_odds if g.log_odds_beside is None else g.log_odds_beside for g in groups])
    families = list(dict.fromkeys(g.family for g in groups if g.family is not None))
    kinds = np.array([-1 - k if g.family is None else families.index(g.family) for k, g in enumerate(groups)])
    visited: dict[tuple[int, ...], ChosenSet] = {(): ChosenSet((), (), 0.0, 0.0, 0.0)}
    front = list(visited.values())
    for _ in range(largest):
        found: dict[tuple[int, ...], ChosenSet] = {}
        for chosen in front:
            evidence, gains, variances, share = _score_extensions(X, y, groups, batches, chosen)
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
