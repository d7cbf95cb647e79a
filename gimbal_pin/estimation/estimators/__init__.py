"""Estimators: one file each, blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.estimation.estimators.bootstrap import Bootstrap as Bootstrap
from gimbal_pin.estimation.estimators.closed_loop import idim as idim
from gimbal_pin.estimation.estimators.closed_loop import output_error as output_error
from gimbal_pin.estimation.estimators.hausman import Hausman as Hausman
from gimbal_pin.estimation.estimators.hausman import hausman as hausman
from gimbal_pin.estimation.estimators.least_squares import Estimate as Estimate
from gimbal_pin.estimation.estimators.least_squares import Estimator as Estimator
from gimbal_pin.estimation.estimators.least_squares import Ridge as Ridge
from gimbal_pin.estimation.estimators.least_squares import ols as ols
from gimbal_pin.estimation.estimators.least_squares import robust as robust
from gimbal_pin.estimation.estimators.least_squares import weighted as weighted
from gimbal_pin.estimation.estimators.physical import physical as physical

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {
        "ols": ols,
        "weighted": weighted,
        "robust": robust,
        "instrumental": idim,
        "output-error": output_error,
        "ridge": Ridge(),
        "physical": physical,
    }
)
"""By the name that the command line knows."""
