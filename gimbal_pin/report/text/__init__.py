"""Results as a person reads them in a terminal: tables with units, angles in degrees where that is said."""

from gimbal_pin.report.text.camera import verified as verified
from gimbal_pin.report.text.everything import auto as auto
from gimbal_pin.report.text.exported import exported as exported
from gimbal_pin.report.text.held import inspected as inspected
from gimbal_pin.report.text.loops import tracking as tracking
from gimbal_pin.report.text.loops import tuning as tuning
from gimbal_pin.report.text.parameters import following as following
from gimbal_pin.report.text.parameters import identified as identified
from gimbal_pin.report.text.parameters import several as several
from gimbal_pin.report.text.rig import base as base
from gimbal_pin.report.text.rig import check as check
from gimbal_pin.report.text.rig import excitation as excitation
from gimbal_pin.report.text.rig import rigs as rigs
from gimbal_pin.report.text.wrong import diagnosis as diagnosis
