"""One file per section: a function from results to a `Section`."""

from gimbal_pin.report.sections.animation import animation as animation
from gimbal_pin.report.sections.data import data as data
from gimbal_pin.report.sections.diagnosis import diagnosis as diagnosis
from gimbal_pin.report.sections.excitation import excitation as excitation
from gimbal_pin.report.sections.inspection import inspection as inspection
from gimbal_pin.report.sections.margins import margins as margins
from gimbal_pin.report.sections.parameters import parameters as parameters
from gimbal_pin.report.sections.pointing import pointing as pointing
from gimbal_pin.report.sections.rig import rig_section as rig_section
from gimbal_pin.report.sections.summary import summary as summary
from gimbal_pin.report.sections.torque import torque as torque
from gimbal_pin.report.sections.tracking import tracking as tracking
