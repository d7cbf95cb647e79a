"""A report: a list of small sections, written as one offline HTML file.

``write("My rig", [summary(rig, found), torque(found, evaluate(found, logs))], "report.html")``
"""

from gimbal_pin.report.base import Section as Section
from gimbal_pin.report.base import render as render
from gimbal_pin.report.base import write as write
from gimbal_pin.report.evaluation import Evaluated as Evaluated
from gimbal_pin.report.evaluation import evaluate as evaluate
from gimbal_pin.report.full import carried as carried
from gimbal_pin.report.full import diagnosed as diagnosed
from gimbal_pin.report.full import full as full
from gimbal_pin.report.full import moving as moving
from gimbal_pin.report.sections import animation as animation
from gimbal_pin.report.sections import data as data
from gimbal_pin.report.sections import excitation as excitation
from gimbal_pin.report.sections import inspection as inspection
from gimbal_pin.report.sections import margins as margins
from gimbal_pin.report.sections import parameters as parameters
from gimbal_pin.report.sections import pointing as pointing
from gimbal_pin.report.sections import rig_section as rig_section
from gimbal_pin.report.sections import summary as summary
from gimbal_pin.report.sections import torque as torque
from gimbal_pin.report.sections import tracking as tracking
