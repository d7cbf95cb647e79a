"""Laws of the random-effects model: textbook variances, planted deviations, false alarms at the stated rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, t

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import Comparison, DeviationKind, compare_units

NAMES = tuple(f"parameter {k}" for k in range(6))


def draw_fleet(
    seed: int, units: int, logs: int = 1, repeat: float = 0.0, error: float = 0.3
) -> dict[str, Any]:
    """A fleet of spread 1 in every parameter, as `compare` takes it."""
    rng = np.random.default_rng(seed)
    own = np.repeat(rng.normal(size=(units, len(NAMES))), logs, axis=0)
    values = own + rng.normal(size=own.shape) * np.hypot(error, repeat)
    labels = [f"{k:03d}" for k in range(units) for _ in range(logs)]
    times = np.tile(np.arange(logs, dtype=float), units)
    return {"values": values, "stds": np.full(own.shape, error), "units": labels, "times": times}


def compare(fleet: dict[str, Any], **options: Any) -> Comparison:
    """Compare a drawn fleet's units."""
    frames = {key: pd.DataFrame(fleet[key], columns=list(NAMES)) for key in ("values", "stds")}
    return compare_units(**{**fleet, **frames}, **options)


def list_deviations(compared: Comparison) -> set[tuple[str, str, str]]:
    return {(own.unit, own.parameter, own.kind.value) for own in compared.deviations}


def test_balanced_fleets_have_the_variances_of_an_analysis_of_variance() -> None:
    fleet = draw_fleet(0, 12, 4, repeat=0.5, error=1e-3)
    values = fleet["values"].reshape(12, 4, len(NAMES))
    within = values.var(axis=1, ddof=1).mean(axis=0)
    between = values.mean(axis=1).var(axis=0, ddof=1) - within / 4
    population = compare(fleet, false_alarms=1e-9).population
    np.testing.assert_allclose(population["repeat"] ** 2, within - 1e-6, rtol=1e-9)
    np.testing.assert_allclose(population["spread"] ** 2, between, rtol=1e-9)
    np.testing.assert_allclose(population["mean"], values.mean(axis=(0, 1)), atol=1e-12)


def test_the_mean_and_the_spread_are_covered() -> None:
    """Of unequal errors: the t interval of 95 % holds the mean, and the spread is without bias."""
    inside = 0
    spreads = []
    for seed in range(60):
        fleet = draw_fleet(seed, 20, error=1.0)
        fleet["stds"] = np.random.default_rng(1000 + seed).uniform(0.2, 1.5, fleet["stds"].shape)
        rng = np.random.default_rng(2000 + seed)
        fleet["values"] = (
            rng.normal(size=fleet["stds"].shape)
            + rng.normal(size=fleet["stds"].shape) * fleet["stds"]
        )
        population = compare(fleet, false_alarms=1e-9).population
        inside += int((population["mean"].abs() < t.ppf(0.975, 19) * population["mean_std"]).sum())
        spreads.append(population["spread"] ** 2)
    assert binom.ppf(0.001, 360, 0.95) <= inside <= binom.ppf(0.999, 360, 0.95)
    assert np.mean(spreads) == pytest.approx(1.0, abs=4 * np.std(spreads) / 360**0.5)


def test_neither_units_of_measure_nor_order_matter() -> None:
    fleet = draw_fleet(1, 30, 3)
    fleet["values"][12, 2] += 8
    scale = 10.0 ** np.arange(-3, 3)
    order = np.random.default_rng(1).permutation(90)
    other = {
        "values": (fleet["values"] * scale + 5 * scale)[order],
        "stds": (fleet["stds"] * scale)[order],
        "units": [fleet["units"][k] for k in order],
        "times": fleet["times"][order],
    }
    one = compare(fleet)
    two = compare(other)
    assert list_deviations(one) == list_deviations(two) != set()
    np.testing.assert_allclose(
        two.population["mean"] / scale - 5, one.population["mean"], atol=1e-9
    )
    np.testing.assert_allclose(
        two.population["spread"], one.population["spread"] * scale, rtol=1e-6
    )


def test_units_that_are_off_are_named_and_no_others() -> None:
    fleet = draw_fleet(2, 200)
    planted = {("017", NAMES[0]): 9, ("180", NAMES[3]): -9, ("199", NAMES[5]): 9}
    for (unit, name), shift in planted.items():
        fleet["values"][int(unit), NAMES.index(name)] += shift
    found = {(own.unit, own.parameter): own for own in compare(fleet).deviations}
    assert planted.keys() <= found.keys() and len(found) <= len(planted) + 2
    for key, shift in planted.items():
        assert found[key].kind is DeviationKind.OFFSET and found[key].shift == pytest.approx(
            shift, abs=3.5
        )
        assert found[key].score == found[key].shift / found[key].shift_std


@pytest.mark.parametrize(("units", "logs", "fleets"), [(4, 1, 40), (8, 3, 20), (60, 1, 4)])
def test_false_alarms_are_at_most_at_the_stated_rate(units: int, logs: int, fleets: int) -> None:
    found = [
        {
            own.unit
            for own in compare(
                draw_fleet(seed, units, logs, repeat=0.2), false_alarms=0.02
            ).deviations
        }
        for seed in range(fleets)
    ]
    assert sum(map(len, found)) <= binom.ppf(0.999, units * fleets, 0.02)


def test_a_change_is_dated_and_a_drift_is_no_step() -> None:
    fleet = draw_fleet(4, 20, 6, repeat=0.1, error=0.05)
    fleet["values"][6 * 3 + 4 : 6 * 4, 1] += 4
    fleet["values"][6 * 8 : 6 * 9, 2] += np.linspace(0, 5, 6)
    fleet["values"][6 * 15 : 6 * 16, 4] -= 9
    deviations = compare(fleet).deviations
    assert {(own.unit, own.parameter, own.kind, own.since) for own in deviations} == {
        ("003", NAMES[1], DeviationKind.STEP, 4.0),
        ("008", NAMES[2], DeviationKind.DRIFT, None),
        ("015", NAMES[4], DeviationKind.OFFSET, None),
    }
    sizes = {own.unit: (own.shift, own.shift_std) for own in deviations}
    for unit, size in (("003", 4), ("008", 5), ("015", -9)):
        assert sizes[unit][0] == pytest.approx(size, abs=3 * sizes[unit][1])


def test_a_batch_that_is_wrong_as_a_whole_is_shown_by_the_fleet_before_it() -> None:
    fleet = draw_fleet(6, 60)
    fleet["values"][30:, 0] += 9
    units = sorted(set(fleet["units"]))
    assert {own.unit for own in compare(fleet, reference=units[:30]).deviations} == set(units[30:])


def test_unknown_values_name_no_unit_and_hide_none() -> None:
    fleet = draw_fleet(7, 40)
    fleet["values"][7, 0] += 12
    fleet["values"][3] = np.nan
    fleet["values"][5:, 5] = np.nan
    found = compare(fleet)
    assert list_deviations(found) == {("007", NAMES[0], "offset")}
    assert np.isinf(found.errors.loc["003"]).all() and np.isfinite(found.errors.loc["004"]).all()


def test_two_odd_units_do_not_hide_each_other() -> None:
    units = [f"unit {k}" for k in range(8)] + ["changed"] * 3
    values = np.random.default_rng(10).normal(scale=1e-4, size=(11, len(NAMES)))
    values[[7, -1], 0] += [2.5e-3, 6e-3]
    stds = np.full(values.shape, 3e-6)
    found = compare({"values": values, "stds": stds, "units": units, "times": np.arange(11.0)})
    odd = {("unit 7", NAMES[0], "offset"), ("changed", NAMES[0], "step")}
    assert list_deviations(found) == odd


def test_a_single_unit_has_nothing_to_be_compared_with() -> None:
    with pytest.raises(UsageError, match="fewer than two units"):
        compare(draw_fleet(8, 1, 3))
