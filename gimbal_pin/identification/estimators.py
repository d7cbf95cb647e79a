"""Estimators by name: blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

from gimbal_pin.errors import UsageError
from gimbal_pin.identification.output_error import fit_idim, fit_output_error
from gimbal_pin.regression import (
    TRUST,
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
"""Method → the estimator of that name, in Python and on the command line."""


def find_estimator(estimator: Estimator | str, trust: float = TRUST) -> Estimator:
    """Return the estimator of a name, or the given one where it is no name.

    Args:
        estimator: A value of `Method`, such as "weighted", or a function of blocks.
        trust: Relative standard deviation of the URDF's masses, the width of the prior of "ridge".

    Raises:
        UsageError: No estimator has that name.
    """
    if not isinstance(estimator, str):
        return estimator
    if estimator == Method.RIDGE.value:
        return partial(fit_ridge, trust=trust)
    for method, found in ESTIMATORS.items():
        if method.value == estimator:
            return found
    names = ", ".join(method.value for method in ESTIMATORS)
    raise UsageError("estimator", f"is '{estimator}'", f"give one of {names}")
