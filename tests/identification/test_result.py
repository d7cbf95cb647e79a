"""Laws of what `identify` returns: parameters, covariance, prediction and residual of a log."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest

import gimbal_pin as gp
from gimbal_pin import GimbalPinError, Log
from gimbal_pin.identification import ESTIMATORS
from gimbal_pin.regression import fit_ridge
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
