"""Estimators by name: blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.errors import UsageError
from gimbal_pin.identification.output_error import fit_idim, fit_output_error
from gimbal_pin.regression import (
    Estimator,
    Method,
    fit_ordinary,
    fit_physical,
    fit_ridge,
    fit_robust,
    fit_weighted,
)

ESTIMATORS: Mapping[Method, Estimator] = MappingProxyType(
    {
        Method.ORDINARY: fit_ordinary,
        Method.WEIGHTED: fit_weighted,
        Method.ROBUST: fit_robust,
        Method.INSTRUMENTAL: fit_idim,
        Method.OUTPUT_ERROR: fit_output_error,
        Method.RIDGE: fit_ridge,
        Method.PHYSICAL: fit_physical,
    }
)
"""Method → the estimator that the command line offers by its name."""


def find_estimator(name: str) -> Estimator:
    """Return the estimator of a name; `UsageError` for a name that none has."""
    for method, estimator in ESTIMATORS.items():
        if method.value == name:
            return estimator
    raise UsageError("estimator", f"is '{name}'", f"give one of {', '.join(map(str, ESTIMATORS))}")
