"""Identify, diagnose, tune and show a camera gimbal from its URDF and a log."""

__version__ = "0.1.0"
