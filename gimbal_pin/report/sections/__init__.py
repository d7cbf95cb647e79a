"""One file per section: a function from results to a `Section`."""

from gimbal_pin.report.sections.animation import animation
from gimbal_pin.report.sections.data import data
from gimbal_pin.report.sections.diagnosis import diagnosis
from gimbal_pin.report.sections.excitation import excitation
from gimbal_pin.report.sections.margins import margins
from gimbal_pin.report.sections.parameters import parameters
from gimbal_pin.report.sections.pointing import pointing
from gimbal_pin.report.sections.rig import rig_section
from gimbal_pin.report.sections.summary import summary
from gimbal_pin.report.sections.torque import torque
from gimbal_pin.report.sections.tracking import tracking

__all__ = [
    "animation",
    "data",
    "diagnosis",
    "excitation",
    "margins",
    "parameters",
    "pointing",
    "rig_section",
    "summary",
    "torque",
    "tracking",
]
