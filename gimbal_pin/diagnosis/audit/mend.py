"""Logs from parts of logs: what a check goes on with after taking out what is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log import Array, Imu, Log
from gimbal_pin.rows import Flags

Indices = NDArray[np.integer[Any]]

CHANNELS = ("q", "v", "tau")
"""The measured channels of the joints, by their names in `Log`."""


def taken(log: Log, rows: Indices, t: Array | None = None) -> Log:
    """Return the samples with these indices, in this order, with other times `t` or each with its own."""
    names = ("q", "v", "tau", "q_ref", "temperature")
    chosen: dict[str, Any] = {name: value[rows] for name in names if (value := getattr(log, name)) is not None}
    imus = {link: picked(imu, rows) for link, imu in log.imus.items()}
    return replace(log, **chosen, t=log.t[rows] if t is None else t, imus=imus)


def picked(imu: Imu, rows: Indices) -> Imu:
    """Return an IMU's samples with these indices."""
    return Imu(**{name: value[rows] for name in ("gyro", "accel", "quat") if (value := getattr(imu, name)) is not None})


def without(log: Log, bad: Flags, event: str) -> Log | None:
    """Return the log without the rows where `bad`, (N,), holds, and with the event; None if too little is left."""
    if np.mean(bad) > 0.5:
        return None
    return noted(taken(log, np.flatnonzero(~bad)), event)


def noted(log: Log, event: str) -> Log:
    """Return the log with one more event."""
    return replace(log, events=(*log.events, event))


def changed(log: Log, channels: Mapping[str, Any]) -> Log:
    """Return the log with other values in some channels."""
    return replace(log, **channels)
