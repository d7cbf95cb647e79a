"""The hierarchical model of a fleet: what units have in common, how they differ, and which of them are not like it.

For each parameter by itself

    y_l = μ + a_u + r_l + e_l,    a_u ~ N(0, τ²),  r_l ~ N(0, ρ²),  e_l ~ N(0, s_l²)

where y_l is what log l of unit u says, ± s_l; τ is the spread between units and ρ what one unit's logs differ by beyond
their stated errors. μ, τ and ρ are estimated by restricted maximum likelihood (Patterson and Thompson 1971) without the
units that are judged by them, nor those that were found to deviate. A unit's residual is tested against an offset, a
step at any of its logs and a drift, by generalised least squares under that model; the t distribution's degrees of
freedom are Satterthwaite's (as in lmerTest, Kuznetsova et al. 2017), so that a small fleet accuses nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, stdtr, stdtrit

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array

if TYPE_CHECKING:
    from pandas import DataFrame

FOLDS = 10
"""Units are judged by a fit without a tenth of the fleet that they are in; in fleets of ten or fewer, without them."""
NORMAL_MAD = 0.6745
"""Median of the absolute value of a normal variable, in standard deviations."""
SMALLEST_VARIANCE, LARGEST_VARIANCE = 1e-12, 1e12
"""Bounds of variances, in the square of a parameter's scatter."""
ROUNDS = 20
"""Most times that the deviating units are left out and looked for again; two or three are usual."""


class DeviationKind(str, Enum):
    """How a unit deviates."""

    __str__ = str.__str__

    OFFSET = "offset"
    """From its first log on."""
    STEP = "step"
    """From a later log on."""
    DRIFT = "drift"
    """In proportion to time, from its first log to its last."""


@dataclass(frozen=True)
class Deviation:
    """A unit that is not like its siblings in a parameter.

    Attributes:
        unit: The unit.
        parameter: The parameter.
        kind: Offset, step or drift, whichever the unit's logs show best.
        shift: By how much, and `shift_std` its standard deviation with the fleet's spread in it; of a drift from the
            first log to the last.
        shift_std: See there.
        p_value: Chance that a unit like its siblings shows as much in any parameter, at any of its logs.
        since: Time of the first log that shows it; of a drift, of the unit's first log.
    """

    unit: str
    parameter: str
    kind: DeviationKind
    shift: float
    shift_std: float
    p_value: float
    since: float

    @property
    def score(self) -> float:
        """Number of standard deviations, with sign."""
        return self.shift / self.shift_std


@dataclass(frozen=True, eq=False)
class Comparison:
    """Units of a fleet beside each other.

    Attributes:
        population: A row per parameter: `mean` μ and its deviation `mean_std`; `spread` τ, standard deviation between
            units; `repeat` ρ, between one unit's logs beyond their errors, 0 where no unit has two logs, as it then is
            part of the spread; `p_value`, chance of such a likelihood ratio if all units were alike (τ = 0).
        values: A row per unit, its parameters partially pooled: the posterior mean with the fleet as the prior. Where
            it deviates, its own logs' mean since then.
        stds: Standard deviations of these.
        detectable: Offsets that the unit's logs show in one of two cases.
        deviations: The least probable first.
    """

    population: DataFrame
    values: DataFrame
    stds: DataFrame
    detectable: DataFrame
    deviations: tuple[Deviation, ...]


class _Fit(NamedTuple):
    """Estimates of every parameter, (P,).

    Attributes:
        mean: μ.
        mean_var: Its variance.
        spread: τ²; where no unit has two logs with ρ² in it.
        repeat: ρ²; 0 there.
        covariance: Of τ² and ρ², (P, 2, 2).
        ratio: Likelihood ratio to τ = 0.
        freedom: Degrees of freedom between units, and within them, (P, 2).
    """

    mean: Array
    mean_var: Array
    spread: Array
    repeat: Array
    covariance: Array
    ratio: Array
    freedom: Array


class _Tests(NamedTuple):
    """Of each direction in a unit's residual, (P, K): size, deviation, twice the likelihood gained, p and t's limit."""

    size: Array
    std: Array
    gain: Array
    p_value: Array
    limit: Array

    @property
    def best(self) -> NDArray[np.intp]:
        """Place of the direction that fits best, of those that are significant where one is, (P,)."""
        is_significant = np.abs(self.size) > self.limit * self.std
        gain = np.where(is_significant | ~is_significant.any(axis=1, keepdims=True), np.nan_to_num(self.gain), -1.0)
        return np.asarray(gain.argmax(axis=1))


class _Logs(NamedTuple):
    """Logs in the order of units and times, every parameter about its median and in units of its scatter.

    Attributes:
        y: Values, (L, P); 0 where unknown.
        variance: Their variances, (L, P); infinite where unknown.
        when: Times, (L,).
        labels: Units, (U,).
        rows: Each unit's logs.
        group: Each log's place in `labels`, (L,).
        fold: Each unit's fold, (U,); -1: is judged, and makes up no fleet.
        middle: What was subtracted, (P,).
        scale: What it was divided by, (P,).
    """

    y: Array
    variance: Array
    when: Array
    labels: tuple[str, ...]
    rows: tuple[slice, ...]
    group: NDArray[np.intp]
    fold: NDArray[np.intp]
    middle: Array
    scale: Array

    def select_rows(self, left_out: NDArray[np.bool_], fold: int) -> NDArray[np.bool_]:
        """Values (L, P) that a fold is judged by: those known of the fleet's other folds, but for units left out."""
        return np.isfinite(self.variance) & ~(left_out | ((self.fold < 0) | (self.fold == fold))[:, None])[self.group]


def compare_units(
    values: DataFrame,
    stds: DataFrame,
    units: Sequence[str],
    times: Array,
    *,
    false_alarms: float = 1e-3,
    reference: Sequence[str] | None = None,
) -> Comparison:
    """Fit the fleet's hierarchical model, and test every unit against the others.

    Args:
        values: What each log says of each parameter, logs by parameters (L, P); NaN where it says nothing.
        stds: Standard deviations of these.
        units: Which unit each log is of, (L,).
        times: When each log was taken, (L,), in any unit.
        false_alarms: Share of units like the others that may be called deviating.
        reference: Units that make up the fleet; None: all. The others are judged only.

    Raises:
        UsageError: The fleet has fewer than two units.
    """
    import pandas as pd

    logs = _arrange_logs(values.to_numpy(float), stds.to_numpy(float), units, np.asarray(times, float), reference)
    names, directions = list(values), [_list_directions(logs.when[rows]) for rows in logs.rows]
    deviates = np.zeros((len(logs.labels), len(names)), bool)
    fits = dict.fromkeys(logs.fold.tolist(), _start_fit(logs, logs.select_rows(deviates, -1)))
    for turn in range(ROUNDS):
        tests = [
            _test_directions(logs.y[rows], logs.variance[rows], own, fits[fold], false_alarms)
            for rows, own, fold in zip(logs.rows, directions, logs.fold.tolist())
        ]
        before, deviates = deviates, np.array([(own.p_value < false_alarms).any(axis=1) for own in tests])
        if turn and (deviates == before).all():
            break
        fits = {fold: _fit_variances(logs, logs.select_rows(deviates, fold)) for fold in fits}
    whole = _fit_variances(logs, logs.select_rows(deviates, -1))
    mean_std, spread, repeat = (logs.scale * np.sqrt(own) for own in (whole.mean_var, whole.spread, whole.repeat))
    # A variance at its bound under the hypothesis: half of the time the ratio is 0 (Self and Liang 1987).
    p_value = np.where(whole.ratio > 0, 0.5 * chdtrc(1, whole.ratio), 1.0)
    columns = {"mean": logs.middle + logs.scale * whole.mean, "mean_std": mean_std, "spread": spread, "repeat": repeat}
    each_unit = zip(logs.rows, tests, logs.fold.tolist(), deviates)
    pooled = [_pool_unit(logs, rows, own, fits[fold], off) for rows, own, fold, off in each_unit]
    estimates, errors, shown = (pd.DataFrame(np.array(own), logs.labels, names) for own in zip(*pooled))
    found = [_describe_deviation(logs, u, p, names[p], tests[u]) for u, p in np.argwhere(deviates).tolist()]
    deviations = tuple(sorted(found, key=lambda own: (own.p_value, -abs(own.score))))
    return Comparison(pd.DataFrame({**columns, "p_value": p_value}, names), estimates, errors, shown, deviations)


def _arrange_logs(y: Array, stds: Array, units: Sequence[str], times: Array, reference: Sequence[str] | None) -> _Logs:
    """Sort logs by unit and time, give the units their folds, and scale the values."""
    order = np.lexsort((times, np.asarray(units)))
    labels, group = np.unique(np.asarray(units)[order], return_inverse=True)
    ends = np.searchsorted(group, np.arange(len(labels) + 1)).tolist()
    is_fleet = np.ones(len(labels), bool) if reference is None else np.isin(labels, list(reference))
    count = int(is_fleet.sum())
    if count < 2:
        raise UsageError("fleet", "has fewer than two units to compare with", "give more units, or a reference")
    fold = np.where(is_fleet, np.cumsum(is_fleet) % min(FOLDS, count), -1)
    y, variance = y[order], np.square(stds[order])
    variance[~np.isfinite(y + variance)] = np.inf
    shown = np.where(np.isfinite(variance) & is_fleet[group, None], y, np.nan)
    middle = _find_median(shown)
    error = _find_median(np.where(np.isfinite(shown), variance, np.nan))
    scale = np.hypot(_find_median(np.abs(shown - middle)), np.sqrt(error))
    scale = np.where(scale > 0, scale, np.maximum(np.abs(middle), 1.0) * np.finfo(float).eps ** 0.5)
    y = np.where(np.isfinite(variance), (y - middle) / scale, 0.0)
    rows = tuple(slice(*own) for own in pairwise(ends))
    return _Logs(y, variance / scale**2, times[order], tuple(labels.tolist()), rows, group, fold, middle, scale)


def _list_directions(when: Array) -> Array:
    """What may be added to m logs, (K, m): steps from each log on, then a drift where it differs from these."""
    steps = np.triu(np.ones((len(when), len(when))))
    if len(when) < 3 or when[0] == when[-1]:
        return steps
    return np.vstack([steps, (when - when[0]) / (when[-1] - when[0])])


def _describe_deviation(logs: _Logs, u: int, p: int, name: str, tests: _Tests) -> Deviation:
    """Return a unit's deviation in one parameter."""
    k, when = int(tests.best[p]), logs.when[logs.rows[u]]
    kind = DeviationKind.DRIFT if k == len(when) else DeviationKind.STEP if k else DeviationKind.OFFSET
    size, std = (float(logs.scale[p] * own[p, k]) for own in (tests.size, tests.std))
    since = float(when[k if kind is DeviationKind.STEP else 0])
    return Deviation(logs.labels[u], name, kind, size, std, float(tests.p_value[p, k]), since)


def _pool_unit(logs: _Logs, rows: slice, tests: _Tests, fit: _Fit, deviates: NDArray[np.bool_]) -> tuple[Array, ...]:
    """Return a unit's parameters, their deviations and detectable offsets, see `Comparison`, (P,) each."""
    y, variance, step = logs.y[rows], logs.variance[rows], tests.best
    begin = np.where(deviates & (step < len(y)), step, 0)
    w = np.where(np.arange(len(y))[:, None] >= begin, _weigh_logs(variance, fit), 0.0)
    prior = np.where(deviates, 0.0, 1.0 / np.maximum(fit.spread + fit.mean_var, SMALLEST_VARIANCE))
    with np.errstate(all="ignore"):
        precision = w.sum(axis=0) + prior
        mean = ((w * y).sum(axis=0) + np.where(deviates, 0.0, prior * fit.mean)) / precision
    offset = tests.limit[:, 0] * tests.std[:, 0]
    return logs.middle + logs.scale * mean, logs.scale * precision**-0.5, logs.scale * offset


def _weigh_logs(variance: Array, fit: _Fit) -> Array:
    """Precision of each log's values as those of its unit, (m, P)."""
    return np.asarray(1.0 / (fit.repeat + np.maximum(variance, SMALLEST_VARIANCE)))


def _start_fit(logs: _Logs, is_in: NDArray[np.bool_]) -> _Fit:
    """Fit by medians, which up to half of the units may spoil; a median's variance is π/2, a MAD's 1/.37 times more.

    Of fewer than three units with several logs no median says what logs differ by: that is left to the spread.
    """
    import pandas as pd

    shown = pd.DataFrame(np.where(is_in, logs.y, np.nan)).groupby(logs.group)
    means, scatter = (own.to_numpy() for own in (shown.mean(), shown.diff().abs().groupby(logs.group).mean()))
    error = _find_median(np.where(is_in, logs.variance, np.nan))
    total = np.square(_find_median(np.abs(means - _find_median(means))) / NORMAL_MAD)
    repeated = np.isfinite(scatter).sum(axis=0)
    repeated = np.where(repeated < 3, 0, repeated)
    between = np.maximum(total - error, 0.0)
    # The mean distance of two draws is 2 / √π standard deviations.
    within = np.where(repeated > 0, np.maximum(np.pi / 4 * np.square(_find_median(scatter)) - error, 0.0), 0.0)
    count = np.maximum(np.isfinite(means).sum(axis=0), 2)
    covariance = np.zeros((len(error), 2, 2))
    covariance[:, 0, 0] = 2 / 0.37 * np.square(between + error) / (count - 1)
    covariance[:, 1, 1] = 2 / 0.37 * np.square(within + error) / np.maximum(repeated, 1)
    mean_var, freedom = np.pi / 2 * (between + error) / count, 0.37 * np.stack([count - 1.0, repeated], axis=1)
    return _Fit(_find_median(means), mean_var, between, within, covariance, between, freedom)


def _find_median(x: Array) -> Array:
    """Median of each column without NaN, 0 of none."""
    import pandas as pd

    return np.asarray(pd.DataFrame(x).median().fillna(0.0))


def _fit_variances(logs: _Logs, is_in: NDArray[np.bool_]) -> _Fit:
    """Estimate every parameter's mean and variances by restricted maximum likelihood from the values that are in."""
    rows = [
        _fit_one(logs.y[own, p], logs.variance[own, p], np.unique(logs.group[own], return_inverse=True)[1])
        for p, own in enumerate(is_in.T)
    ]
    return _Fit(*map(np.array, zip(*rows)))


def _fit_one(y: Array, variance: Array, unit: NDArray[np.intp]) -> tuple[Any, ...]:
    """Return what `_Fit` holds of one parameter; nothing is known from fewer than two units."""
    from scipy.optimize import minimize

    count = unit.max(initial=-1) + 1
    if count < 2:
        return np.nan, np.nan, np.nan, np.nan, np.full((2, 2), np.nan), 0.0, np.zeros(2)
    has_repeats = len(y) > count

    def sum_units(x: Array) -> Array:
        return np.asarray(np.bincount(unit, x, count), dtype=float)

    def deviance(x: Array) -> tuple[float, Array]:
        """-2 log of the restricted likelihood, and its gradient tr(P K) - yᵀP K P y for K = 11ᵀ and 1."""
        w, grown, gain, precision, r = parts(x)
        pull, squares = sum_units(w * r), sum_units(w**2)
        value = (w * r**2).sum() - (x[0] * pull**2 / grown).sum()
        value += np.log(precision) + np.log(grown).sum() - np.log(w).sum()
        between = gain.sum() - (gain**2).sum() / precision - ((pull / grown) ** 2).sum()
        within = w.sum() - (x[0] * squares / grown).sum() - (squares / grown**2).sum() / precision
        within -= ((w * (r - (x[0] * pull / grown)[unit])) ** 2).sum()
        return float(value), np.array([between, within if has_repeats else 0.0])

    def parts(x: Array) -> tuple[Array, Array, Array, float, Array]:
        w = 1.0 / (x[1] + np.maximum(variance, SMALLEST_VARIANCE))
        total = sum_units(w)
        grown = 1 + x[0] * total
        precision = (total / grown).sum()
        return w, grown, total / grown, precision, y - (sum_units(w * y) / grown).sum() / precision

    bounds = [(0.0, LARGEST_VARIANCE), (0.0, LARGEST_VARIANCE if has_repeats else 0.0)]
    found = minimize(deviance, [0.5, 0.1 * has_repeats], jac=True, method="L-BFGS-B", bounds=bounds)
    alike = minimize(deviance, [0.0, 0.1 * has_repeats], jac=True, method="L-BFGS-B", bounds=[(0.0, 0.0), bounds[1]])
    w, grown, gain, precision, residual = parts(found.x)
    squares, shrink = sum_units(w**2), found.x[0] / grown
    trace = squares - 2 * shrink * sum_units(w**3) + (shrink * squares) ** 2
    cross = (squares / grown**2).sum()
    information = 0.5 * (1 - 1 / count) * np.array([[(gain**2).sum(), cross], [cross, trace.sum()]])
    covariance = np.zeros((2, 2))
    rows = slice(0, 1 + has_repeats)
    covariance[rows, rows] = np.linalg.pinv(information[rows, rows])
    return (
        float(y[0] - residual[0]),
        1 / precision,
        *found.x.tolist(),
        covariance,
        max(float(alike.fun - found.fun), 0.0),
        np.array([count - 1.0, len(y) - count]),
    )


def _test_directions(y: Array, variance: Array, directions: Array, fit: _Fit, false_alarms: float) -> _Tests:
    """Test one unit's logs (m, P) for an offset, and for each other direction (K - 1, m), by the fleet's variances.

    Where no other unit has two logs, those of one may differ as much as units do: changes are tested as if they did.
    The p-values count all K directions of all P parameters (Bonferroni).
    """
    has_repeats = fit.freedom[:, 1] > 0
    between_logs = fit._replace(
        repeat=np.where(has_repeats, fit.repeat, fit.spread),
        covariance=np.where(has_repeats[:, None, None], fit.covariance, fit.covariance[:, :1, :1]),
    )
    fewest = np.where(has_repeats, fit.freedom[:, 1], fit.freedom[:, 0])[:, None]
    offset = _fit_directions(y, variance, directions[:1], fit, fit.freedom[:, :1])
    size, std, freedom, gain = _fit_directions(y, variance, directions, between_logs, fewest)
    for own, first in zip((size, std, freedom), offset):
        own[:, :1] = first
    with np.errstate(all="ignore"):
        p_value = np.minimum(1.0, 2 * size.size * stdtr(freedom, -np.abs(size) / std))
        limit = -stdtrit(freedom, false_alarms / (2 * size.size))
    return _Tests(size, std, gain, np.where(np.isfinite(p_value), p_value, 1.0), limit)


def _fit_directions(
    y: Array, variance: Array, directions: Array, fit: _Fit, fewest: Array
) -> tuple[Array, Array, Array, Array]:
    """Return each direction's size, its standard deviation, that one's degrees of freedom, and the fit's gain, (P, K).

    Satterthwaite's ν = 2 V² / var(V) of the variance V falls without bound where the spread is small beside the errors
    that it was estimated from. No variance that counts has fewer than its own sum of squares, `fewest`: V is raised to
    what has that many, which of one log is the variance of logs like those of the fleet.
    """
    w = _weigh_logs(variance, fit).T[:, None]
    shrink = (fit.spread / (1 + fit.spread * w[:, 0].sum(axis=1)))[:, None, None]
    weighted = w * directions
    weighted = weighted - shrink * w * weighted.sum(axis=2, keepdims=True)
    precision = (weighted * directions).sum(axis=2)
    with np.errstate(all="ignore"):
        weighted = weighted / precision[:, :, None]
        size = (weighted * (y - fit.mean).T[:, None]).sum(axis=2)
        gradient = np.stack([weighted.sum(axis=2) ** 2, (weighted**2).sum(axis=2)], axis=2)
        gain = size**2 * precision
        square = 1 / precision + gradient[:, :, 0] * fit.mean_var[:, None]
        uncertainty = np.einsum("pki,pij,pkj->pk", gradient, fit.covariance, gradient)
        square = np.maximum(square, np.sqrt(fewest * uncertainty / 2))
        return size, np.sqrt(square), 2 * square**2 / uncertainty, gain
