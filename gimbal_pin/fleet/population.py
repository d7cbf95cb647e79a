"""Random-effects model of a fleet: mean and spread of each parameter, and units that deviate from the others.

For each parameter by itself

    y_l = μ + a_u + r_l + e_l,    var(a_u) = τ²,  var(r_l) = ρ²,  var(e_l) = s_l²

where y_l is the estimate of log l of unit u and s_l its stated standard deviation; τ is the spread between units and ρ
the spread between logs of one unit beyond their stated errors. Both are moment estimators without iteration:

- ρ² by the estimator of DerSimonian and Laird (Controlled Clinical Trials 7, 1986), within units;
- τ² by the two-step estimator CA2 of DerSimonian and Kacker (Contemporary Clinical Trials 28, 2007, eq. 6 and 11),
  which approximates that of Paule and Mandel. With equal errors both are those of an analysis of variance.

A unit deviates if its logs lie outside the predictive interval of the other units (Higgins, Thompson and Spiegelhalter,
J. R. Statist. Soc. A 172, 2009), or if they change by more than logs of one unit differ. The bounds are quantiles of t
distributions at a stated rate of false alarms per unit, shared among all tests of the unit (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array

if TYPE_CHECKING:
    from pandas import DataFrame

FOLDS = 10
"""Number of parts of a fleet; a unit is compared with the units of the other parts. In fleets of up to ten units each
part is one unit. Double: a tenth more units to compare with, twice the time."""
OUTLIER_SCORE = 3.5
"""Robust score |y - median| / (1.4826 MAD) beyond which a unit is left out of the first fit: Iglewicz and Hoaglin, How
to Detect and Handle Outliers, 1993. Later fits leave out the units that deviate; double: large outliers hide others."""
NORMAL_MAD = 1.4826
"""Standard deviation of a normal variable in median absolute deviations."""
SMALLEST_STD = 1e-30
"""Stand-in for a stated standard deviation of 0, in a parameter's unit: far below rounding."""
MOST_ROUNDS = 20
"""Most fits without the units that deviated from the fit before; two or three are usual."""


class DeviationKind(str, Enum):
    """Course of a deviation over a unit's logs."""

    __str__ = str.__str__

    OFFSET = "offset"
    """All logs."""
    STEP = "step"
    """From a later log on."""
    DRIFT = "drift"
    """In proportion to time, from the first log to the last."""


@dataclass(frozen=True)
class Deviation:
    """Parameter in which a unit deviates.

    Attributes:
        unit: The unit.
        parameter: The parameter.
        kind: Offset from the fleet's mean, or step or drift between the unit's own logs; the least probable of them.
        shift: Size: from the fleet's mean, from the earlier logs, or from the first log to the last.
        shift_std: Standard deviation of `shift` among units that do not deviate.
        score: Shift in standard deviations.
        p_value: Chance that such a unit shows as much in any parameter, in any way.
        since: Of a step the time of the first log after it; else None.
    """

    unit: str
    parameter: str
    kind: DeviationKind
    shift: float
    shift_std: float
    score: float
    p_value: float
    since: Any = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Units of a fleet compared.

    Attributes:
        population: A row per parameter: `mean` μ, its standard deviation `mean_std`; `spread` τ; `repeat` ρ, 0 where
            no unit has two logs, as it then is part of τ; `p_value` of Cochran's Q test that τ is 0.
        errors: Standard deviation of each unit's mean, units by parameters; infinite without a value.
        detectable: Offset that a unit shows in one of two cases, units by parameters.
        deviations: The least probable first.
    """

    population: DataFrame
    errors: DataFrame
    detectable: DataFrame
    deviations: tuple[Deviation, ...]


class _Fit(NamedTuple):
    """Parameters of a fleet, (P,) each.

    Attributes:
        mean: μ.
        mean_variance: Its variance.
        spread: τ².
        repeat: ρ².
        freedom: Degrees of freedom between units.
        repeat_freedom: Degrees of freedom between logs of one unit.
        error: Median variance of a unit's mean about its μ + a_u.
        q: Cochran's Q of the units' means.
    """

    mean: Array
    mean_variance: Array
    spread: Array
    repeat: Array
    freedom: Array
    repeat_freedom: Array
    error: Array
    q: Array


def compare_units(
    values: DataFrame,
    stds: DataFrame,
    units: Sequence[str],
    times: Sequence[float],
    *,
    false_alarms: float = 1e-3,
    reference: Sequence[str] | None = None,
) -> Comparison:
    """Fit a fleet's random-effects model, and compare every unit with the others.

    Args:
        values: Parameters of each log, logs by parameters (L, P); NaN where the log does not show one.
        stds: Standard deviations of these.
        units: Unit of each log, (L,).
        times: Time of each log, (L,), in any unit of measure.
        false_alarms: Share of units like the others that are reported to deviate.
        reference: Units that make up the fleet; None: all. The other units are only compared with them.

    Raises:
        UsageError: The fleet has fewer than two units.
    """
    import pandas as pd
    from scipy.stats import chi2

    order = np.lexsort((times, units))
    labels, starts, group = np.unique(
        np.asarray(units)[order], return_index=True, return_inverse=True
    )
    is_fleet = np.isin(labels, units if reference is None else list(reference))
    if is_fleet.sum() < 2:
        raise UsageError(
            "fleet", "has fewer than two units to compare with", "give more units, or a reference"
        )
    fold = np.where(is_fleet, np.cumsum(is_fleet) % min(FOLDS, is_fleet.sum()), -1)
    y, error = (frame.to_numpy(float)[order] for frame in (values, stds))
    is_known = np.isfinite(y + error)
    y = np.where(is_known, y, 0.0)
    variance = np.where(is_known, np.maximum(error, SMALLEST_STD) ** 2, np.inf)
    of_unit = np.split(np.arange(len(y)), starts[1:])
    when = np.asarray(times, float)[order]

    def fit(left_out: NDArray[np.bool_]) -> _Fit:
        return _fit_fleet(
            y, np.where((left_out | ~is_fleet[:, None])[group], np.inf, variance), starts, group
        )

    # Parameters and folds of which too little is known give NaN, which is no deviation.
    with np.errstate(divide="ignore", invalid="ignore"):
        deviates = _find_outliers(np.where(is_known & is_fleet[group, None], y, np.nan), group)
        for _ in range(MOST_ROUNDS):
            fits = {k: fit(deviates | (fold == k)[:, None]) for k in set(fold.tolist())}
            tests = [
                _test_unit(y[own], variance[own], when[own], fits[k], false_alarms)
                for own, k in zip(of_unit, fold.tolist())
            ]
            before = deviates
            deviates = np.array([(p < false_alarms).any(axis=0) for _, _, p, _ in tests])
            if (deviates == before).all():
                break
        whole = fit(deviates)
        errors = np.add.reduceat(1 / (variance + whole.repeat), starts, axis=0) ** -0.5
        detectable = [limit[0] * std[0] for _, std, _, limit in tests]
    population = {
        "mean": whole.mean,
        "mean_std": np.sqrt(whole.mean_variance),
        "spread": np.sqrt(whole.spread),
        "repeat": np.sqrt(whole.repeat),
        "p_value": chi2.sf(whole.q, whole.freedom),
    }
    names = list(values)
    found = [
        _describe_deviation(str(labels[u]), names[p], tests[u][:3, :, p], when[of_unit[u]])
        for u, p in np.argwhere(deviates).tolist()
    ]
    return Comparison(
        population=pd.DataFrame(population, names),
        errors=pd.DataFrame(errors, labels, names),
        detectable=pd.DataFrame(detectable, labels, names),
        deviations=tuple(sorted(found, key=lambda own: (own.p_value, -abs(own.score)))),
    )


def _find_outliers(y: Array, group: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which units' means are far from the median unit's, (U, P); NaN is unknown."""
    import pandas as pd

    means = pd.DataFrame(y).groupby(group).mean()
    distance = (means - means.median()).abs()
    return np.asarray(distance > OUTLIER_SCORE * NORMAL_MAD * distance.median())


def _fit_fleet(
    y: Array, variance: Array, starts: NDArray[np.intp], group: NDArray[np.intp]
) -> _Fit:
    """Fit the model to the logs whose variance is finite, (L, P)."""
    import pandas as pd

    def average_logs(repeat: Array | float) -> tuple[Array, Array, Array]:
        """Return the logs' weights, the units' means and the variances of these."""
        w = 1 / (variance + repeat)
        total = np.add.reduceat(w, starts, axis=0)
        return w, np.add.reduceat(w * y, starts, axis=0) / total, 1 / total

    w, means, error = average_logs(0.0)
    logs = np.isfinite(variance).sum(axis=0)
    units = np.isfinite(error).sum(axis=0)
    q = np.nansum(w * (y - means[group]) ** 2, axis=0)
    scale = w.sum(axis=0) - np.nansum(np.add.reduceat(w**2, starts, axis=0) * error, axis=0)
    repeat = np.where(logs > units, np.maximum((q - logs + units) / scale, 0.0), 0.0)
    _, means, error = average_logs(repeat)
    spread = _estimate_spread(means, error, np.isfinite(error).astype(float))
    spread = _estimate_spread(means, error, 1 / (spread + error))
    mean, precision, _ = _average(means, 1 / (spread + error))
    *_, q = _average(means, 1 / error)
    typical = pd.DataFrame(error).where(np.isfinite(error)).median().to_numpy()
    return _Fit(mean, 1 / precision, spread, repeat, units - 1.0, logs - 1.0 * units, typical, q)


def _average(means: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return means weighted by a, the sum of a, and the weighted sum of squared residuals; NaN is unknown."""
    total = a.sum(axis=0)
    mean = np.nansum(a * means, axis=0) / total
    return mean, total, np.nansum(a * (means - mean) ** 2, axis=0)


def _estimate_spread(means: Array, error: Array, a: Array) -> Array:
    """``τ² = (Q - Σ a V + Σ a² V / Σ a) / (Σ a - Σ a² / Σ a)``, Q = Σ a (y - ȳ)², of means y with variances V.

    DerSimonian and Kacker, eq. 6, with weights a; not below 0.
    """
    _, total, q = _average(means, a)
    excess = q - np.nansum(a * error, axis=0) + np.nansum(a**2 * error, axis=0) / total
    return np.maximum(excess / (total - (a**2).sum(axis=0) / total), 0.0)


def _test_unit(y: Array, variance: Array, when: Array, fit: _Fit, false_alarms: float) -> Array:
    """Test m logs of one unit, (m, P), for an offset, for a step at each log but the first, and for a drift.

    A change is the slope of a regression on its course, 0 and 1 or time, beside a constant. Where no other unit has two
    logs, those of one unit are assumed to differ as much as units do.

    Returns:
        Size, its standard deviation, the p-value, and the smallest |t| that counts, (4, K, P) of K tests.
    """
    w = 1 / (variance + fit.repeat)
    error = 1 / w.sum(axis=0)
    sizes = [(w * y).sum(axis=0) * error - fit.mean]
    # A unit with many logs is not compared more precisely than τ² is known from the others: by one mean of theirs.
    variances = [fit.spread + np.maximum(error, fit.error) + fit.mean_variance]
    courses = list(np.tri(len(y)).T[1:])
    if len(y) > 2 and when[-1] > when[0]:
        courses.append((when - when[0]) / (when[-1] - when[0]))
    has_repeats = fit.repeat_freedom > 0
    w = 1 / (variance + np.where(has_repeats, fit.repeat, fit.spread))
    for course in courses:
        x = course[:, None] - (w * course[:, None]).sum(axis=0) / w.sum(axis=0)
        variances.append(1 / (w * x**2).sum(axis=0))
        sizes.append((w * x * y).sum(axis=0) * variances[-1])
    size = np.array(sizes)
    std = np.sqrt(variances)
    freedom = np.array(
        [fit.freedom, *[np.where(has_repeats, fit.repeat_freedom, fit.freedom)] * len(courses)]
    )
    p_value = 2 * size.size * stdtr(freedom, -np.abs(size) / std)
    return np.array(
        [size, std, np.fmin(p_value, 1.0), -stdtrit(freedom, false_alarms / (2 * size.size))]
    )


def _describe_deviation(unit: str, name: str, tests: Array, when: Array) -> Deviation:
    """Return a unit's deviation in one parameter: the least probable of sizes, deviations and p-values, (3, K)."""
    score = tests[0] / tests[1]
    k = np.lexsort((-np.abs(score), tests[2]))[0]
    size, std, p_value = tests[:, k].tolist()
    kind = (
        DeviationKind.OFFSET
        if k == 0
        else DeviationKind.STEP
        if k < len(when)
        else DeviationKind.DRIFT
    )
    since = float(when[k]) if kind is DeviationKind.STEP else None
    return Deviation(unit, name, kind, size, std, float(score[k]), p_value, since)
