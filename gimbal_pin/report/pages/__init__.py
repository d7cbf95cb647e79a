"""A report: a list of small sections, written as one offline HTML file.

``write("My rig", [summary(rig, found), torque(found, evaluate(found, logs))], "report.html")``
"""

from gimbal_pin.report.pages.base import Section as Section
from gimbal_pin.report.pages.base import render as render
from gimbal_pin.report.pages.base import write as write
from gimbal_pin.report.pages.evaluation import Evaluated as Evaluated
from gimbal_pin.report.pages.evaluation import evaluate as evaluate
from gimbal_pin.report.pages.full import carried as carried
from gimbal_pin.report.pages.full import diagnosed as diagnosed
from gimbal_pin.report.pages.full import full as full
from gimbal_pin.report.pages.full import moving as moving
from gimbal_pin.report.pages.sections import animation as animation
from gimbal_pin.report.pages.sections import data as data
from gimbal_pin.report.pages.sections import excitation as excitation
from gimbal_pin.report.pages.sections import inspection as inspection
from gimbal_pin.report.pages.sections import margins as margins
from gimbal_pin.report.pages.sections import parameters as parameters
from gimbal_pin.report.pages.sections import pointing as pointing
from gimbal_pin.report.pages.sections import rig_section as rig_section
from gimbal_pin.report.pages.sections import summary as summary
from gimbal_pin.report.pages.sections import torque as torque
from gimbal_pin.report.pages.sections import tracking as tracking
