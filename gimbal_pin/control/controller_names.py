"""Names of the controllers that hold a camera, in results, on pages and where a controller is asked for."""

OURS, BASELINE = "computed-torque", "pid"
"""Computed torque that knows how the base moves; a PID on the camera's attitude in the world, by its gyro."""
