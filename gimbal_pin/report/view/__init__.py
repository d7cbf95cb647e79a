"""The rig in motion: recorded as one HTML file, as pictures or video, or live in a browser."""

from gimbal_pin.report.view.live import Live, show
from gimbal_pin.report.view.output import Animation, animate
from gimbal_pin.report.view.scene import record

__all__ = ["Animation", "Live", "animate", "record", "show"]
