"""Samples of logs: smooth channels on a uniform grid."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.log import Log, signals
from gimbal_pin.regression import (
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, fourier


@pytest.fixture(scope="module")
def turret() -> Rig:
    return Rig.load("turret")


def test_the_rate_fuses_angle_and_gyro(turret: Rig) -> None:
    """Angle and rate together give a better rate than either alone, and a gyro's bias does not get through."""
    motion = fourier(turret, 0, 8.0)
    rng = np.random.default_rng(0)
    q = motion.q + 3e-5 * rng.standard_normal(motion.q.shape)
    v = motion.v + 2e-3 * rng.standard_normal(motion.v.shape) + 0.01
    tau = np.zeros_like(q)

    def error(log: Log) -> float:
        stretch = next(split_segments(log, 4.0))
        smooth = smooth_samples(stretch, EXACT, 0, stretch.length)
        return float(np.sqrt(np.mean((smooth.v - motion.v)[1000:-1000] ** 2)))

    both = error(Log("both", turret.joints, motion.t, q, v, tau))
    angle_alone = error(Log("angle", turret.joints, motion.t, q, None, tau))
    rate_alone = 2e-3 * signals.compute_noise_gain(signals.lowpass(32.0, 1000.0), 1000.0, 0)
    assert both < 0.7 * angle_alone
    assert (
        both < 0.9 * rate_alone < 0.01 / 10
    )  # the crossover at 10.6 Hz leaves 88 % of the gyro's noise
