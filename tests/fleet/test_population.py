"""The random-effects model: textbook variances, planted deviations, false alarms at their rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, t

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import Comparison, DeviationKind, compare_units
from gimbal_pin.log import Array

COUNT = 6
"""Number of parameters."""


def draw(seed: int, units: int, logs: int = 1, scatter: Any = 0.3) -> Array:
    """Draw a fleet of spread 1 in every parameter, units by logs by parameters."""
    rng = np.random.default_rng(seed)
    own = rng.normal(size=(units, 1, COUNT))
    return own + scatter * rng.normal(size=(units, logs, COUNT))


def compare(
    values: Array, stds: Array | float = 0.3, order: Any = slice(None), **options: Any
) -> Comparison:
    """Compare the units of a fleet, whose logs come in some order; unit 7 is called "007"."""
    units, logs, _ = values.shape
    labels = np.repeat([f"{k:03d}" for k in range(units)], logs)[order].tolist()
    times = np.tile(np.arange(float(logs)), units)[order].tolist()
    rows, errors = (
        pd.DataFrame(np.broadcast_to(x, values.shape).reshape(-1, COUNT)[order])
        for x in (values, stds)
    )
    return compare_units(rows, errors, labels, times, **options)


def list_deviations(compared: Comparison) -> set[tuple[Any, ...]]:
    return {(own.unit, own.parameter, own.kind, own.since) for own in compared.deviations}


def test_balanced_fleets_have_the_variances_of_an_analysis_of_variance() -> None:
    values = draw(0, 12, 4, scatter=0.5)
    within = values.var(axis=1, ddof=1).mean(axis=0)
    between = values.mean(axis=1).var(axis=0, ddof=1) - within / 4
    population = compare(values, 1e-3, false_alarms=1e-9).population
    np.testing.assert_allclose(population["repeat"] ** 2, within - 1e-6, rtol=1e-9)
    np.testing.assert_allclose(population["spread"] ** 2, between, rtol=1e-9)
    np.testing.assert_allclose(population["mean"], values.mean(axis=(0, 1)), atol=1e-12)


def test_the_mean_and_the_spread_are_covered() -> None:
    """Of unequal errors: the t interval of 95 % holds the mean, and the spread is without bias."""
    found = []
    for seed in range(60):
        stds = np.random.default_rng(1000 + seed).uniform(0.2, 1.5, (20, 1, COUNT))
        found.append(compare(draw(seed, 20, scatter=stds), stds, false_alarms=1e-9).population)
    population = pd.concat(found)
    inside = (population["mean"].abs() < t.ppf(0.975, 19) * population["mean_std"]).sum()
    assert binom.ppf(0.001, 360, 0.95) <= inside <= binom.ppf(0.999, 360, 0.95)
    spreads = population["spread"] ** 2
    assert spreads.mean() == pytest.approx(1.0, abs=4 * spreads.std() / 360**0.5)


def test_neither_units_of_measure_nor_order_matter() -> None:
    values = draw(1, 30, 3)
    values[4, 0, 2] += 8
    scale = 10.0 ** np.arange(-3, 3)
    one = compare(values)
    order = np.random.default_rng(1).permutation(90)
    two = compare(scale * (values + 5), 0.3 * scale, order)
    assert list_deviations(one) == list_deviations(two) != set()
    mean = two.population["mean"] / scale - 5
    np.testing.assert_allclose(mean, one.population["mean"], atol=1e-9)
    spread = two.population["spread"] / scale
    np.testing.assert_allclose(spread, one.population["spread"], rtol=1e-6)


@pytest.mark.parametrize(("units", "logs", "fleets"), [(4, 1, 40), (8, 3, 20), (60, 1, 4)])
def test_false_alarms_are_at_most_at_the_stated_rate(units: int, logs: int, fleets: int) -> None:
    drawn = [draw(seed, units, logs, np.hypot(0.3, 0.2)) for seed in range(fleets)]
    compared = [compare(values, false_alarms=0.02) for values in drawn]
    alarms = sum(len({own.unit for own in one.deviations}) for one in compared)
    assert alarms <= binom.ppf(0.999, units * fleets, 0.02)


def test_a_change_is_dated_and_a_drift_is_no_step() -> None:
    """Unknown values name no unit and hide none."""
    values = draw(4, 20, 6, scatter=0.1)
    values[3, 4:, 1] += 4
    values[8, :, 2] += np.linspace(0, 5, 6)
    values[15, :, 4] -= 9
    values[2] = np.nan
    values[5:, :, 5] = np.nan
    compared = compare(values, 0.05)
    assert list_deviations(compared) == {
        ("003", 1, DeviationKind.STEP, 4.0),
        ("008", 2, DeviationKind.DRIFT, None),
        ("015", 4, DeviationKind.OFFSET, None),
    }
    sizes = {"003": 4, "008": 5, "015": -9}
    for own in compared.deviations:
        assert own.shift == pytest.approx(sizes[own.unit], abs=3 * own.shift_std)
        assert own.score == own.shift / own.shift_std
    assert np.isinf(compared.errors.loc["002"]).all()
    assert np.isfinite(compared.errors.loc["004"]).all()


def test_a_batch_that_is_wrong_as_a_whole_is_shown_by_the_fleet_before_it() -> None:
    values = draw(6, 60)
    values[30:, 0, 0] += 9
    before = [f"{k:03d}" for k in range(30)]
    found = compare(values, reference=before).deviations
    assert {own.unit for own in found} == {f"{k:03d}" for k in range(30, 60)}
    with pytest.raises(UsageError, match="fewer than two units"):
        compare(values, reference=before[:1])


def test_two_odd_units_do_not_hide_each_other() -> None:
    """One among eight of one log each, and one whose last of three logs differs."""
    values = np.random.default_rng(10).normal(scale=1e-4, size=(9, 3, COUNT))
    values[:8, 1:] = np.nan
    values[7, 0, 0] += 2.5e-3
    values[8, 2, 0] += 6e-3
    expected = {("007", 0, DeviationKind.OFFSET, None), ("008", 0, DeviationKind.STEP, 2.0)}
    assert list_deviations(compare(values, 3e-6)) == expected
