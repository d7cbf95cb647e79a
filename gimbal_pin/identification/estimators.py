"""Estimators by name: blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.identification.output_error import fit_idim, fit_output_error
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
