"""A turret's motion that never repeats, and comparisons of what is read with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas

from gimbal_pin.log import Imu, Log, log_columns
from tests.log.writers import Columns
from tests.rigs import bundled

TURRET = bundled("turret")
T = np.arange(600) * 5000 / 1e6
"""Times of the logs: whole microseconds, s."""
FEW = T[:60]


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return angles and rates of two joints, (N, 2) each."""
    size = np.array([0.5, 0.3, 0.2, 0.1])
    w = np.outer([1.0, 1.3], [1.1, 2.3, 4.7, 7.9])
    phase = w * t[:, None, None] + np.outer([1.0, 2.0], [0.3, 1.1, 2.0, 0.7])
    return np.sin(phase) @ size, (w * np.cos(phase)) @ size


def planted(t: np.ndarray = T, has_imu: bool = False) -> Log:
    """Return a log of that motion, with torques that follow from it."""
    q, v = swing(t)
    tau = np.column_stack([0.3 * v[:, 0], np.sin(q[:, 1])])
    gyro = v[:, [0, 1, 1]]
    imu = Imu(gyro, 9.0 - gyro, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    return Log("planted", TURRET.joints, t, q, v, tau, imus={"base": imu} if has_imu else {})


def write_csv(columns: Columns, path: Path) -> Path:
    """Write columns with pandas; return the path."""
    pandas.DataFrame(dict(columns)).to_csv(path, index=False)
    return path


def held(values: np.ndarray | None) -> np.ndarray:
    """Return an array that must be there."""
    assert values is not None
    return values


def same(a: Log, b: Log) -> None:
    """Assert that two logs hold the same numbers, bit by bit, signs of zeros included."""
    assert a.joints == b.joints
    one, other = ({name: x.tobytes() for name, x in log_columns(log).items()} for log in (a, b))
    assert one == other


def agree(log: Log, expected: Log, within: float = 1e-9) -> None:
    """Compare a log with what was written, its times from the first sample on."""
    np.testing.assert_allclose(log.t - log.t[0], expected.t - expected.t[0], atol=1e-6)
    for name, values in expected.channels.items():
        np.testing.assert_allclose(getattr(log, name), values, atol=within)
