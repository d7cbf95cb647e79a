"""Every controller that can hold a camera: its name, and what it is."""

from __future__ import annotations

from collections.abc import Mapping

HOLDING: Mapping[str, str] = {
    "pid-joint": "PID of each joint, its wanted angle by the platform's gyro",
    "pid-world": "PID on the camera's attitude in the world, by the camera's gyro",
    "computed-torque-fixed": "computed torque that takes the base as fixed",
    "without-hidden": "computed torque on a moving base, without the parameters that only such a base shows",
    "computed-torque": "the same with them",
    "with-friction": "the same with friction",
    "with-prediction": "the same with the platform's motion foreseen",
    "with-gyros": "the same with all gyros fused",
    "with-observer": "with-gyros and a disturbance observer",
    "lyapunov": "with-gyros and Lyapunov redesign",
    "switch": "all that with-gyros knows; on joints whose model is worth less than its uncertainty, PID",
    "oracle": "with-gyros, the motion foreknown: told the platform's where each drive's torque acts",
}
"""Name → what it is; each from "without-hidden" on with all that the one before it has; those from "with-observer" to
"switch" stand beside each other, on top of "with-gyros", and the oracle too."""
OURS, BASELINE, ORACLE = "switch", "pid-world", "oracle"
TUNED = "tuned"
"""The controller with the gains that somebody asked for: it has its own margins, not those of the others."""
COMPILED = "compiled"
"""The same as it was exported and compiled for the gimbal's processor."""
