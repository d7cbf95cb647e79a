"""Estimators: one file each, blocks of rows in, `Estimate` out."""

from collections.abc import Mapping
from types import MappingProxyType

from gimbal_pin.estimators.base import Estimate, Estimator
from gimbal_pin.estimators.ols import ols
from gimbal_pin.estimators.physical import physical
from gimbal_pin.estimators.robust import robust
from gimbal_pin.estimators.weighted import weighted

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {"ols": ols, "weighted": weighted, "robust": robust, "physical": physical}
)
"""By the name that the command line knows."""

__all__ = ["ESTIMATORS", "Estimate", "Estimator", "ols", "physical", "robust", "weighted"]
