"""What a log says of the base: whether it stands, leans or turns."""

from __future__ import annotations

from gimbal_pin.estimation.rows.grid import SHORTEST
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import BaseMotion, Platform
from gimbal_pin.rig.rig import Rig


def carrying(rig: Rig, log: Log) -> str | None:
    """Return the base link if its IMU says that the base moves or leans; None where it stands or nobody says."""
    return None if base_motion(rig, log) == "fixed" else rig.base


def base_motion(rig: Rig, log: Log) -> BaseMotion:
    """Return what the base does in a log, as its IMU says; "fixed" where it has none."""
    imu = log.imus.get(rig.base)
    if imu is None or imu.gyro is None or imu.accel is None or len(log) < SHORTEST:
        return "fixed"
    return Platform.measured(log.t, imu, log.name).motion
