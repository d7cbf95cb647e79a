"""Estimators: one file each, blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.estimators.base import Estimate, Estimator
from gimbal_pin.estimators.bootstrap import Bootstrap
from gimbal_pin.estimators.hausman import Hausman, hausman
from gimbal_pin.estimators.idim import idim
from gimbal_pin.estimators.ols import ols
from gimbal_pin.estimators.output_error import output_error
from gimbal_pin.estimators.physical import physical
from gimbal_pin.estimators.ridge import Ridge
from gimbal_pin.estimators.robust import robust
from gimbal_pin.estimators.weighted import weighted

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

__all__ = [
    "ESTIMATORS",
    "Bootstrap",
    "Estimate",
    "Estimator",
    "Hausman",
    "Ridge",
    "hausman",
    "idim",
    "ols",
    "output_error",
    "physical",
    "robust",
    "weighted",
]
