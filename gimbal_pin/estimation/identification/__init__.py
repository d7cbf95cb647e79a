"""Logs in, model with uncertainty out (THESIS 4.2, 4.5)."""

from gimbal_pin.estimation.identification.assembling import assembled, given_beta, to_model
from gimbal_pin.estimation.identification.fitting import added, identify, moved, refitted
from gimbal_pin.estimation.identification.holding_out import split
from gimbal_pin.estimation.identification.identified import Identified
from gimbal_pin.estimation.identification.judging import Accuracy, accuracy
from gimbal_pin.estimation.identification.seen import (
    DROWNED,
    check_driven,
    check_sampling,
    check_seen,
    enough,
    unseen,
    within,
)
from gimbal_pin.estimation.identification.warning import faults

__all__ = [
    "DROWNED",
    "Accuracy",
    "Identified",
    "accuracy",
    "added",
    "assembled",
    "check_driven",
    "check_sampling",
    "check_seen",
    "enough",
    "faults",
    "given_beta",
    "identify",
    "moved",
    "refitted",
    "split",
    "to_model",
    "unseen",
    "within",
]
