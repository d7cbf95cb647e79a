"""What controllers are called where a person reads of them."""

from __future__ import annotations

CONTROLLERS = {
    "pid": "PID",
    "pid-joint": "joint PID",
    "pid-world": "world-frame PID",
    "computed-torque-fixed": "computed torque, base taken as fixed",
    "without-hidden": "computed torque without hidden parameters",
    "tuned": "your controller (gains of tune)",
}
"""Controllers whose names say more than their keys."""


def controller_name(key: str) -> str:
    """Return a controller's name as a person reads it: ``pid`` as PID, ``computed-torque`` as computed torque."""
    return CONTROLLERS.get(key, key.replace("-", " "))
