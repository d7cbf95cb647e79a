"""Logs whose cause today's search names wrongly: what the new diagnosis has to answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

FEW = {name: CAUSES[name] for name in ("friction-drift", "torque-ripple", "cogging", "torque-gain")}


@pytest.mark.xfail(strict=True, reason="a gain that drifts is no cause of the library yet: new diagnosis")
@pytest.mark.parametrize("loss", [0.3, 0.2, 0.15])
def test_a_motor_that_loses_gain_is_a_drift_of_the_gain_or_unknown(loss: float) -> None:
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), seconds=16.0, torque_noise=0.005, dt=4e-3)
    tau = np.array(log.tau)
    tau[:, 0] /= 1 - loss * (log.t - log.t[0]) / (log.t[-1] - log.t[0])
    found = diagnose(rig, [replace(log, tau=tau)], FEW)
    assert found.verdict == "unknown" or any("gain" in one.cause for one in found.findings)
