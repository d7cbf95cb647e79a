"""A report: a list of small sections, written as one offline HTML file.

``write("My rig", [summary(rig, found), torque(found, evaluate(found, logs))], "report.html")``
"""

from gimbal_pin.report.base import Section, render, write
from gimbal_pin.report.carried import carried, moving
from gimbal_pin.report.evaluation import Evaluated, evaluate
from gimbal_pin.report.full import full
from gimbal_pin.report.sections import (
    animation,
    data,
    excitation,
    margins,
    parameters,
    pointing,
    rig_section,
    summary,
    torque,
    tracking,
)

__all__ = [
    "Evaluated",
    "Section",
    "animation",
    "carried",
    "data",
    "evaluate",
    "excitation",
    "full",
    "margins",
    "moving",
    "parameters",
    "pointing",
    "render",
    "rig_section",
    "summary",
    "torque",
    "tracking",
    "write",
]
