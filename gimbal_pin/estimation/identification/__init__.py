"""Logs in, model with uncertainty out (THESIS 4.2, 4.5)."""

from gimbal_pin.estimation.identification.checks import DROWNED as DROWNED
from gimbal_pin.estimation.identification.checks import check_driven as check_driven
from gimbal_pin.estimation.identification.checks import check_enough as check_enough
from gimbal_pin.estimation.identification.checks import check_log as check_log
from gimbal_pin.estimation.identification.checks import check_sampling as check_sampling
from gimbal_pin.estimation.identification.checks import check_seen as check_seen
from gimbal_pin.estimation.identification.checks import unseen as unseen
from gimbal_pin.estimation.identification.fitting import assembled as assembled
from gimbal_pin.estimation.identification.fitting import given_beta as given_beta
from gimbal_pin.estimation.identification.fitting import greatest_base_motion as greatest_base_motion
from gimbal_pin.estimation.identification.fitting import identify as identify
from gimbal_pin.estimation.identification.fitting import refittable_effects as refittable_effects
from gimbal_pin.estimation.identification.fitting import refitted as refitted
from gimbal_pin.estimation.identification.fitting import split as split
from gimbal_pin.estimation.identification.fitting import to_model as to_model
from gimbal_pin.estimation.identification.identified import Identified as Identified
from gimbal_pin.estimation.identification.identified import faults as faults
from gimbal_pin.estimation.identification.validation import Accuracy as Accuracy
from gimbal_pin.estimation.identification.validation import accuracy as accuracy
