"""The hierarchical model of a fleet: its variances are the textbook's, and what was planted in a unit is found."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import Comparison, DeviationKind, compare_units

NAMES = tuple(f"parameter {k}" for k in range(6))
ERROR = 0.3


def draw_fleet(
    rng: np.random.Generator, units: int, logs: int = 1, repeat: float = 0.0, error: float = ERROR
) -> dict[str, object]:
    """A fleet of spread 1 in every parameter, as `compare_units` takes it."""
    own = np.repeat(rng.normal(size=(units, len(NAMES))), logs, axis=0)
    noise = rng.normal(size=own.shape) * np.hypot(error, repeat)
    labels = [f"unit {k:04d}" for k in range(units) for _ in range(logs)]
    times = np.tile(np.arange(logs, dtype=float), units)
    return {"values": own + noise, "stds": np.full(own.shape, error), "units": labels, "times": times}


def compare(fleet: dict[str, object], **options: object) -> Comparison:
    """Compare a drawn fleet's units."""
    values, stds = (pd.DataFrame(fleet[key], columns=list(NAMES)) for key in ("values", "stds"))
    return compare_units(**{**fleet, "values": values, "stds": stds, **options})  # type: ignore[arg-type]


def test_balanced_fleets_have_the_variances_of_an_analysis_of_variance() -> None:
    fleet = draw_fleet(np.random.default_rng(0), 12, logs=4, repeat=0.5)
    fleet["stds"] = np.zeros((48, len(NAMES)))
    values = np.asarray(fleet["values"]).reshape(12, 4, len(NAMES))
    within = values.var(axis=1, ddof=1).mean(axis=0)
    between = values.mean(axis=1).var(axis=0, ddof=1) - within / 4
    population = compare(fleet, false_alarms=1e-9).population
    np.testing.assert_allclose(population["repeat"] ** 2, within, rtol=1e-4)
    np.testing.assert_allclose(population["spread"] ** 2, between, rtol=1e-4)
    np.testing.assert_allclose(population["mean"], values.mean(axis=(0, 1)), atol=1e-6)


def test_neither_units_of_measure_nor_order_matter() -> None:
    rng = np.random.default_rng(1)
    fleet = draw_fleet(rng, 30, logs=3)
    np.asarray(fleet["values"])[4, 2] += 8
    scale = 10.0 ** np.arange(-3, 3)
    order = rng.permutation(90)
    other = {
        "values": (np.asarray(fleet["values"]) * scale + 5 * scale)[order],
        "stds": (np.asarray(fleet["stds"]) * scale)[order],
        "units": [str(np.asarray(fleet["units"])[k]) for k in order],
        "times": np.asarray(fleet["times"])[order],
    }
    one, two = compare(fleet), compare(other)
    assert [(d.unit, d.parameter, d.kind) for d in one.deviations] == [
        (d.unit, d.parameter, d.kind) for d in two.deviations
    ]
    np.testing.assert_allclose(two.values / scale - 5, one.values, atol=1e-4)
    np.testing.assert_allclose(two.stds, one.stds * scale, rtol=1e-3)


def test_units_that_are_off_are_found_and_no_others() -> None:
    rng = np.random.default_rng(2)
    fleet = draw_fleet(rng, 400)
    planted = {(f"unit {u:04d}", NAMES[p]): sign for u, p, sign in ((17, 0, 1), (180, 3, -1), (399, 5, 1))}
    for (unit, name), sign in planted.items():
        np.asarray(fleet["values"])[int(unit[5:]), NAMES.index(name)] += 9 * sign
    found = {(own.unit, own.parameter): own for own in compare(fleet).deviations}
    assert planted.keys() <= found.keys()
    assert len(found) <= len(planted) + 2, "one false alarm in a thousand was asked for"
    for key, sign in planted.items():
        assert found[key].kind is DeviationKind.OFFSET
        assert found[key].shift == pytest.approx(9 * sign, abs=3.5)


def test_few_units_are_called_deviating_among_units_that_are_alike() -> None:
    rng = np.random.default_rng(3)
    for units, fleets in ((3, 20), (8, 12), (60, 2)):
        found = [
            {own.unit for own in compare(draw_fleet(rng, units), false_alarms=0.02).deviations} for _ in range(fleets)
        ]
        assert sum(map(len, found)) <= binom.ppf(0.999, units * fleets, 0.02)


def test_a_change_is_dated_and_a_drift_is_no_step() -> None:
    fleet = draw_fleet(np.random.default_rng(4), 20, logs=6, repeat=0.1, error=0.05)
    values = np.asarray(fleet["values"])
    values[6 * 3 + 4 : 6 * 4, 1] += 4
    values[6 * 8 : 6 * 9, 2] += np.linspace(0, 5, 6)
    values[6 * 15 : 6 * 16, 4] -= 9
    found = {(own.unit, own.parameter): own for own in compare(fleet).deviations}
    step, drift, offset = (found[f"unit {unit:04d}", NAMES[p]] for unit, p in ((3, 1), (8, 2), (15, 4)))
    assert (step.kind, step.since) == (DeviationKind.STEP, 4.0)
    assert step.shift == pytest.approx(4, abs=3 * step.shift_std)
    assert (drift.kind, drift.since) == (DeviationKind.DRIFT, 0.0)
    assert drift.shift == pytest.approx(5, abs=3 * drift.shift_std)
    assert (offset.kind, offset.since) == (DeviationKind.OFFSET, 0.0)
    assert len(found) == 3


def test_pooled_estimates_are_nearer_than_a_unit_s_log_and_than_the_fleet_s_mean() -> None:
    rng = np.random.default_rng(5)
    truth = rng.normal(size=(200, len(NAMES)))
    values = truth + rng.normal(size=truth.shape)
    units = [f"unit {k:04d}" for k in range(200)]
    found = compare({"values": values, "stds": np.ones(truth.shape), "units": units, "times": np.zeros(200)})
    error = found.values.loc[units].to_numpy() - truth
    assert np.std(error) == pytest.approx(0.5**0.5, rel=0.1), "half of each variance is left"
    assert np.std(error / found.stds.loc[units].to_numpy()) == pytest.approx(1.0, rel=0.1)


def test_a_batch_that_is_wrong_as_a_whole_is_shown_by_the_fleet_before_it() -> None:
    rng = np.random.default_rng(6)
    fleet = draw_fleet(rng, 60)
    np.asarray(fleet["values"])[30:, 0] += 9
    units = sorted(set(fleet["units"]))  # type: ignore[call-overload]
    found = {own.unit for own in compare(fleet, reference=units[:30]).deviations}
    assert found == set(units[30:])


def test_unknown_values_accuse_nobody_and_hide_nothing() -> None:
    fleet = draw_fleet(np.random.default_rng(7), 40)
    values = np.asarray(fleet["values"])
    values[7, 0] += 12
    values[3], values[5:, 5] = np.nan, np.nan
    found = compare(fleet)
    assert [(own.unit, own.parameter) for own in found.deviations] == [("unit 0007", NAMES[0])]
    np.testing.assert_allclose(found.values.loc["unit 0003"][:5], found.population["mean"][:5], atol=0.3)
    assert (found.stds.loc["unit 0003"][:5] > 0.5).all()


def test_a_single_unit_has_nothing_to_be_compared_with() -> None:
    with pytest.raises(UsageError, match="fewer than two units"):
        compare(draw_fleet(np.random.default_rng(8), 1, logs=3))


def test_what_exceeds_any_spread_is_found_though_the_spread_is_within_the_errors() -> None:
    rng = np.random.default_rng(9)
    units = [f"unit {k:02d}" for k in range(11)] + ["worn"] * 4
    values, times = rng.normal(size=(15, len(NAMES))), np.concatenate([np.zeros(11), np.arange(4.0)])
    values[11:, 0] += np.array([0.0, 40.0, 80.0, 120.0])
    found = compare({"values": values, "stds": np.ones(values.shape), "units": units, "times": times})
    assert [(own.unit, own.parameter, own.kind) for own in found.deviations] == [
        ("worn", NAMES[0], DeviationKind.DRIFT)
    ]
    values[11:, 0] = 100.0
    found = compare({"values": values, "stds": np.ones(values.shape), "units": units, "times": times})
    assert [(own.unit, own.parameter, own.kind) for own in found.deviations] == [
        ("worn", NAMES[0], DeviationKind.OFFSET)
    ]


@pytest.mark.parametrize("repeats", [1, 2])
def test_two_odd_units_do_not_hide_each_other(repeats: int) -> None:
    units = [f"unit {k}" for k in range(8) for _ in range(1 + (k < repeats - 1))] + ["changed"] * 3
    values = np.random.default_rng(10).normal(scale=1e-4, size=(len(units), len(NAMES)))
    values[units.index("unit 7"), 0] += 2.5e-3
    values[-1, 0] += 6e-3
    times = np.arange(float(len(units)))
    found = compare({"values": values, "stds": np.full(values.shape, 3e-6), "units": units, "times": times})
    assert {(own.unit, own.kind) for own in found.deviations} == {
        ("unit 7", DeviationKind.OFFSET),
        ("changed", DeviationKind.STEP),
    }
    assert {own.parameter for own in found.deviations} == {NAMES[0]}
