"""Laws of what `identify` returns: parameters, covariance, prediction and residual of a log."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

import gimbal_pin as gp
from gimbal_pin import GimbalPinError, Log
from gimbal_pin.identification import ESTIMATORS, IdentificationResult
from gimbal_pin.regression import Block, Design, compute_blocks, fit_ridge
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled

RIG = bundled("turret")


@cache
def recorded() -> Log:
    return prescribed(gp.nominal(RIG), seconds=8.0, torque_noise=0.01, dt=4e-3)


# --- Estimators ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["ols", "weighted", "physical"])
def test_the_name_of_an_estimator_does_what_its_function_does(method: str) -> None:
    functions = {one.value: function for one, function in ESTIMATORS.items()}
    named = gp.identify(RIG, recorded(), estimator=method, filtering=EXACT)
    given = gp.identify(RIG, recorded(), estimator=functions[method], filtering=EXACT)
    np.testing.assert_array_equal(named.estimate.theta, given.estimate.theta)


def test_trust_is_the_width_of_the_prior_of_ridge() -> None:
    narrow = gp.identify(RIG, recorded(), estimator="ridge", trust=1e-3, filtering=EXACT)
    given = partial(fit_ridge, trust=1e-3)
    same = gp.identify(RIG, recorded(), estimator=given, trust=1e-3, filtering=EXACT)
    wide = gp.identify(RIG, recorded(), estimator="ridge", filtering=EXACT)
    np.testing.assert_array_equal(narrow.estimate.theta, same.estimate.theta)
    assert np.trace(narrow.estimate.covariance) < np.trace(wide.estimate.covariance)


@pytest.mark.parametrize("trust", [0.0, -1.0, np.inf])
def test_a_trust_that_is_not_positive_is_refused(trust: float) -> None:
    with pytest.raises(GimbalPinError, match="trust"):
        gp.identify(RIG, recorded(), trust=trust)


# --- Parameters ---------------------------------------------------------------------------------


@cache
def fitted() -> IdentificationResult:
    effects = ["cogging:tilt:harmonic=7"]
    return gp.identify(RIG, recorded(), effects, holdout="none", filtering=EXACT)


def rows_of(fit: IdentificationResult, log: Log) -> list[Block]:
    """Return the rows of a log as they were fitted."""
    effects = tuple(term.effect for term in fit.model.terms)
    return [*compute_blocks(Design(RIG, fit.reduction, effects, (log,), fit.filtering))]


def test_the_parameters_are_a_table_beside_their_covariance() -> None:
    fit = fitted()
    table = fit.params
    assert list(table) == ["name", "value", "std", "low", "high", "unit", "urdf"]
    assert tuple(table["name"]) == fit.names
    np.testing.assert_allclose(table["std"] ** 2, np.diag(fit.cov), rtol=1e-12)
    np.testing.assert_allclose(table["high"] - table["value"], table["value"] - table["low"])
    np.testing.assert_allclose((table["high"] - table["low"]) / table["std"], 2 * 1.96, rtol=1e-4)
    off = (table["value"] - table["urdf"])[: len(fit.reduction.independent)]
    assert np.all(np.abs(off) < 5 * table["std"][: len(off)])
    assert table["urdf"].isna().sum() == 2  # of the cogging, which no URDF states


# --- Prediction ---------------------------------------------------------------------------------


def test_the_prediction_is_the_regressor_times_the_parameters() -> None:
    fit = fitted()
    predicted = fit.predict(recorded())
    blocks = rows_of(fit, fit.data[0])
    expected = [block.A @ fit.params["value"].to_numpy() + block.known for block in blocks]
    np.testing.assert_allclose(predicted, np.concatenate(expected), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(predicted.index, np.concatenate([block.t for block in blocks]))
    assert tuple(predicted) == RIG.joints


def test_the_residual_is_what_the_fit_left_on_its_rows() -> None:
    fit = fitted()
    left = fit.residual(recorded())
    blocks = rows_of(fit, fit.data[0])
    measured = np.concatenate([block.b + block.known for block in blocks])
    np.testing.assert_allclose(fit.predict(recorded()) + left, measured, rtol=1e-9, atol=1e-12)
    rows = np.sum(np.concatenate([block.share for block in blocks]) ** 2, axis=0)
    rms = np.sqrt(np.sum(left.to_numpy() ** 2, axis=0) / rows)
    np.testing.assert_allclose(rms, list(fit.train.torque_rmse.values()), rtol=1e-9)


@pytest.mark.parametrize("masked", [True, False])
def test_a_prediction_reads_the_motion_alone_in_any_order_of_the_joints(masked: bool) -> None:
    fit = fitted()
    log = recorded()
    predicted = fit.predict(log, masked=masked)
    bare = fit.predict(replace(log, tau=None), masked=masked)
    np.testing.assert_array_equal(bare, predicted)
    turned = {name: getattr(log, name)[:, ::-1] for name in ("q", "v", "tau")}
    other = replace(log, joints=log.joints[::-1], **turned)
    np.testing.assert_allclose(fit.predict(other, masked=masked), predicted, rtol=1e-12)
    assert tuple(fit.predict(other)) == RIG.joints


def test_a_log_that_was_not_fitted_is_predicted_to_its_noise() -> None:
    other = prescribed(gp.nominal(RIG), seconds=6.0, torque_noise=0.01, dt=4e-3, seed=5)
    left = fitted().residual(other)
    assert np.all(left.std() < 0.01)
    assert np.all(left.std() < 0.1 * fitted().predict(other).std())


def test_on_a_base_that_moves_its_imu_is_part_of_the_prediction() -> None:
    rig = bundled("handheld")
    shaken = gp.profile_s(np.arange(0.0, 14.0, 0.001), 3)
    log = gp.bench_run(gp.nominal(rig), rng=1, seconds=12, platform=shaken, imus=[rig.base])
    fit = gp.identify(rig, log, holdout="none")
    assert fit.reduction.base != "fixed"
    left, torque = fit.residual(log), fit.predict(log)
    assert np.all(left.std() < 0.2 * torque.std())
    np.testing.assert_array_equal(fit.predict(replace(log, tau=None)), torque)
    still = fit.predict(replace(log, imus={}))
    assert np.any(np.abs(still - torque).max() > 5 * left.std())


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda fit: fit.predict("log.csv"), "predict: log: is 'log.csv', of type str; give a Log"),
        (lambda fit: fit.residual(RIG), "residual: log: is .* of type Rig"),
        (lambda fit: fit.residual(replace(recorded(), tau=None)), "no torque"),
        (lambda fit: fit.predict(recorded().part(slice(0, 12))), "shorter than"),
        (lambda fit: fit.predict(replace(recorded(), joints=("pan", "nod"))), "no joint 'tilt'"),
    ],
)
def test_what_cannot_be_predicted_is_refused_in_one_line(wrong: Any, said: str) -> None:
    with pytest.raises(GimbalPinError, match=said) as caught:
        wrong(fitted())
    assert "\n" not in str(caught.value)
