"""Estimators by name: blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.estimation.estimators.bootstrap import Bootstrap as Bootstrap
from gimbal_pin.estimation.estimators.closed_loop import fit_idim as fit_idim
from gimbal_pin.estimation.estimators.closed_loop import fit_output_error as fit_output_error
from gimbal_pin.estimation.estimators.hausman import Hausman as Hausman
from gimbal_pin.estimation.estimators.hausman import compare_with_instruments as compare_with_instruments
from gimbal_pin.regression import Estimator, fit_ordinary, fit_physical, fit_ridge, fit_robust, fit_weighted

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {
        "ols": fit_ordinary,
        "weighted": fit_weighted,
        "robust": fit_robust,
        "instrumental": fit_idim,
        "output-error": fit_output_error,
        "ridge": fit_ridge,
        "physical": fit_physical,
    }
)
"""By the name that the command line knows."""
