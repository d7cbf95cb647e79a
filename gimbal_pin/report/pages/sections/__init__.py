"""One file per section: a function from results to a `Section`."""

from gimbal_pin.report.pages.sections.animation import animation as animation
from gimbal_pin.report.pages.sections.data import data as data
from gimbal_pin.report.pages.sections.diagnosis import diagnosis as diagnosis
from gimbal_pin.report.pages.sections.excitation import excitation as excitation
from gimbal_pin.report.pages.sections.inspection import inspection as inspection
from gimbal_pin.report.pages.sections.margins import margins as margins
from gimbal_pin.report.pages.sections.parameters import parameters as parameters
from gimbal_pin.report.pages.sections.pointing import pointing as pointing
from gimbal_pin.report.pages.sections.rig import rig_section as rig_section
from gimbal_pin.report.pages.sections.summary import summary as summary
from gimbal_pin.report.pages.sections.torque import torque as torque
from gimbal_pin.report.pages.sections.tracking import tracking as tracking
