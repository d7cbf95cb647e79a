"""Torque at every joint that no motion of the joints explains, as a base that moves without an IMU makes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import identify
from gimbal_pin.log import Imu, Log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled

FEW = {name: CAUSES[name] for name in ("cogging",)}


def disturb(rig: Rig, share: float, joints: slice = slice(None)) -> Log:
    """Add slow torque of other frequencies than the motion's, a share of each joint's rms."""
    log = prescribed(nominal(rig), seconds=20.0, dt=4e-3, torque_noise=5e-3)
    rng = np.random.default_rng(3)
    tau = np.array(log.tau)
    waves = np.sin(
        2 * np.pi * np.multiply.outer(log.t, rng.uniform(0.3, 2.5, (40, rig.n)))
        + rng.uniform(0, 6, (40, rig.n))
    ).sum(axis=1)
    tau[:, joints] += (share * np.sqrt(np.mean(tau**2, axis=0)) * waves / waves.std(axis=0))[
        :, joints
    ]
    return replace(log, tau=tau)


def mentions_base(rig: Rig, log: Log) -> bool:
    """Whether the IMU of the base is asked for."""
    return any(
        f"gyro_{rig.base}_x" in said
        for said in identify(rig, [log], filtering=EXACT, examined="noisy").warnings
    )


@pytest.mark.parametrize("name", ["turret", "handheld"])
def test_a_base_that_may_have_moved_is_asked_for_its_imu(name: str) -> None:
    assert mentions_base(bundled(name), disturb(bundled(name), 0.5))


@pytest.mark.parametrize("name", ["turret", "thesis", "ptu"])
def test_a_base_is_not_mentioned_without_cause(name: str) -> None:
    """Not of clean logs, of one joint's trouble, or where its IMU is in the log."""
    rig = bundled(name)
    log = disturb(rig, 0.5)
    count = (len(log), 1)
    still = Imu(np.tile([0.0, 0.0, 0.0], count), np.tile([0.0, 0.0, 9.81], count))
    assert not mentions_base(rig, disturb(rig, 0.0))
    assert not mentions_base(rig, disturb(rig, 0.5, slice(0, 1)))
    assert not mentions_base(rig, replace(log, imus={rig.base: still}))


def shake_base(rig: Rig, acceleration: float) -> Log:
    """Simulate a base that no IMU measures and that accelerates horizontally, m/s² rms."""
    log = prescribed(nominal(rig), seconds=16.0, dt=4e-3, torque_noise=2e-3)
    model = rig.model.copy()
    model.gravity.linear = model.gravity.linear + np.array([1.0, 0.0, 0.0])
    sideways = prescribed(nominal(replace(rig, model=model)), seconds=16.0, dt=4e-3)
    sideways_torque = sideways.tau - prescribed(nominal(rig), seconds=16.0, dt=4e-3).tau
    rng = np.random.default_rng(4)
    waves = np.sin(
        2 * np.pi * np.outer(log.t, rng.uniform(0.3, 2.5, 40)) + rng.uniform(0, 6, 40)
    ).sum(axis=1)
    return replace(
        log, tau=log.tau + acceleration * sideways_torque * (waves / waves.std())[:, None]
    )


@pytest.mark.parametrize("acceleration", [3.0, 5.0])
def test_a_diagnosis_asks_for_the_imu_of_a_base_that_moved(acceleration: float) -> None:
    rig = bundled("handheld")
    found = diagnose(rig, shake_base(rig, acceleration), FEW, filtering=EXACT)
    assert f"gyro_{rig.base}_x" in " ".join(found.statements)
    assert found.verdict == "unknown"
    assert set(found.unexplained) == set(rig.joints)


def test_a_diagnosis_of_a_base_at_rest_does_not() -> None:
    rig = bundled("handheld")
    assert not diagnose(rig, shake_base(rig, 0.0), FEW, filtering=EXACT).statements
