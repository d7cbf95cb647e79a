"""Laws of the predictive score: gains of groups in closed form, units, deviations, and probabilities."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis import score
from gimbal_pin.diagnosis.rivals import weigh
from gimbal_pin.diagnosis.score import (
    compare_fits,
    compute_gain,
    compute_standard_error,
    fit_blocks,
    pack_columns,
)
from gimbal_pin.log import Array

FOLDS = tuple(slice(30 * k, 30 * (k + 1)) for k in range(5))
ROWS = np.full((5, 2), 30.0)
PRECISION = np.array([1.0, 0.0, 0.0, 0.0, 2.0])
WEIGHT = np.array([1.0, 0.3])


def draw_problem() -> tuple[list[Array], Array, Array]:
    """Return columns of a model at two joints, further columns at the second, and the torque."""
    rng = np.random.default_rng(0)
    base: list[Array] = [rng.standard_normal((150, 5)) for _ in range(2)]
    further = rng.standard_normal((150, 3))
    target = rng.standard_normal((150, 2))
    target[:, 1] += further[:, 0]
    return base, further, target


def test_the_gain_of_a_group_is_that_of_refitting_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The joints' weights stay those of the model, so the refit makes no new ones."""
    monkeypatch.setattr(score, "REWEIGHTINGS", 1)
    base, further, target = draw_problem()
    fit = fit_blocks(base, target, FOLDS, ROWS, PRECISION, WEIGHT)
    for width in (1, 3):
        gains = fit.measure(pack_columns({1: further}, FOLDS, width), ridge=0.0)
        for group, columns in enumerate(np.hsplit(further, 3 // width)):
            joined = [np.hstack([base[0], 0 * columns]), np.hstack([base[1], columns])]
            precision = np.r_[PRECISION, np.zeros(width)]
            refitted = fit_blocks(joined, target, FOLDS, ROWS, precision, WEIGHT)
            by_fold = compare_fits(fit, refitted)
            np.testing.assert_allclose(gains.errors[group], refitted.squared_errors, rtol=1e-6)
            np.testing.assert_allclose(gains.by_fold[group], by_fold, atol=1e-6)
            np.testing.assert_allclose(gains.coefficients[group], refitted.theta[5:], rtol=1e-6)
        assert gains.total[0] > 20


def test_gains_do_not_know_the_units_of_columns() -> None:
    base, further, target = draw_problem()
    units = np.array([1e-4, 1.0, 1e3, 7.0, 0.01])
    plain = fit_blocks(base, target, FOLDS, ROWS, PRECISION)
    scaled = fit_blocks([B * units for B in base], target, FOLDS, ROWS, PRECISION * units**2)
    one = plain.measure(pack_columns({1: further}, FOLDS))
    factors = np.array([1e5, 1e-3, 40.0])
    two = scaled.measure(pack_columns({1: further * factors}, FOLDS))
    np.testing.assert_allclose(two.by_fold, one.by_fold, atol=1e-6)
    np.testing.assert_allclose(two.coefficients[0] * factors, one.coefficients[0])
    np.testing.assert_allclose(scaled.theta * units, plain.theta)


def test_a_gain_is_antisymmetric_and_the_sum_of_its_folds() -> None:
    rng = np.random.default_rng(1)
    before, after = rng.uniform(10, 20, (2, 6, 3))
    rows = rng.uniform(5, 9, (6, 3))
    forth = compute_gain(before, after, rows)
    ratio = np.log(before.sum(axis=0) / after.sum(axis=0))
    assert forth.sum() == pytest.approx(0.5 * rows.sum(axis=0) @ ratio)
    np.testing.assert_allclose(forth, -compute_gain(after, before, rows), atol=1e-12)


def test_a_gain_that_rests_on_one_fold_is_as_unsure_as_it_is_large() -> None:
    rows = np.full((20, 1), 25.0)
    after = np.full((20, 1), 25.0)
    everywhere = compute_gain(1.5 * after, after, rows)
    event = after.copy()
    event[7] += 0.5 * after.sum()
    once = compute_gain(event, after, rows)
    assert once.sum() == pytest.approx(everywhere.sum())
    assert compute_standard_error(everywhere) < 1e-6 * everywhere.sum()
    assert compute_standard_error(once) > 0.8 * once.sum()


def test_probabilities_are_the_priors_of_equals_and_sure_only_where_many_folds_tell() -> None:
    gain = np.arange(8.0)
    own, other = weigh(np.array([gain, gain]), np.array([0.0, -1.0]))
    assert own / other == pytest.approx(np.e)
    event, steady = np.zeros((2, 20))
    event[3], steady[:] = 8.0, 0.4
    unsure, sure = (weigh(np.array([x, 0 * x]), np.zeros(2))[0] for x in (event, steady))
    assert 0.5 < unsure < 0.95 < 0.999 < sure
