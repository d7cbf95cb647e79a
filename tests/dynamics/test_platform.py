"""Laws of a platform's motion.

A motion's rates are its attitude's derivative and its specific force is turned gravity; a measured motion is the true
one below the cutoff; a profile has the power that it states; the plant that it carries converges.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.dynamics import Plant, State, nominal
from gimbal_pin.effects import BaseTilt
from gimbal_pin.log import Array, Imu, Platform, profile_s
from gimbal_pin.log.profile import ACCELERATION
from gimbal_pin.rig import GRAVITY
from tests.rigs import bundled

UP = np.array([0.0, 0.0, GRAVITY])
DT = 1e-3


def assert_moves(platform: Platform, attitude: Rotation, push: Array) -> None:
    """Assert rate, angular acceleration and specific force by central differences of the attitude."""
    turn = (attitude[:-2].inv() * attitude[2:]).as_rotvec() / (2 * DT)
    np.testing.assert_allclose(platform.w[1:-1], turn, atol=1e-4)
    change = (platform.w[2:] - platform.w[:-2]) / (2 * DT)
    np.testing.assert_allclose(platform.dw[1:-1], change, atol=1e-3)
    pushes = np.tile(push + UP, (len(platform), 1))
    np.testing.assert_allclose(attitude.apply(platform.f.copy()), pushes, atol=1e-12)


def test_rates_are_the_attitudes_derivative_and_specific_force_is_turned_gravity() -> None:
    """Of a motion by formula, of what turns evenly on it, and of what an IMU reports of it below the cutoff."""
    t = DT * np.arange(4001)
    size = np.array([0.4, 0.6, 0.3])
    w = 2 * np.pi * np.array([0.7, 1.1, 0.4])
    push = np.array([0.5, -0.7, 0.3])
    angles = size * np.sin(t[:, None] * w)
    rates = size * w * np.cos(t[:, None] * w)
    true = Platform.turning(t, angles, rates, -(w**2) * angles, np.tile(push, (4001, 1)))
    attitude = Rotation.from_euler("xyz", angles)
    assert_moves(true, attitude, push)

    more = np.array([0.05, -0.08, 0.0])
    sunk = BaseTilt(roll_rate=0.05, pitch_rate=-0.08).carried(t, true)
    assert sunk is not None and BaseTilt(0.1, 0.2).carried(t, true) is true
    assert_moves(sunk, attitude * Rotation.from_euler("xyz", more * t[:, None]), push)

    seen = Platform.measured(t, Imu(true.w, true.f, true.quat), "log")
    for name, slack in (("f", 1e-2), ("w", 1e-2), ("dw", 1e-1), ("quat", 1e-4)):
        found = getattr(seen, name)[500:-500]
        np.testing.assert_allclose(found, getattr(true, name)[500:-500], atol=slack)
    lean = Platform.still(t, 0.2, -0.3)
    level = Platform.measured(t, Imu(lean.w, lean.f), "log")
    np.testing.assert_allclose(level.quat, lean.quat, atol=1e-9)


def test_profile_s_has_its_stated_power_whatever_the_sampling() -> None:
    t = 2.5e-3 * np.arange(24_001)
    one = profile_s(t, np.random.default_rng(1))
    fine = profile_s(t[:101] / 2, np.random.default_rng(1))
    np.testing.assert_allclose(one.f[:51], fine.f[::2], atol=1e-9)
    stated = np.sqrt(sum(band.rms**2 for band in ACCELERATION))
    shaken = np.linalg.norm(one.f, axis=1) - GRAVITY
    assert np.sqrt(np.mean(shaken**2)) == pytest.approx(stated, rel=0.1)


def test_the_plant_on_a_shaken_platform_converges() -> None:
    """With the third power of a step at whose ends alone the platform's motion is known."""
    plan = nominal(bundled("turret"))
    ends = []
    for parts in (1, 2, 16):
        dt = DT / parts
        t = dt * np.arange(100 * parts + 1)
        plant = Plant(plan, profile_s(t, np.random.default_rng(5)))
        state = State(np.array([0.3, 0.2]), np.array([3.0, -3.0]))
        for now in t[:-1].tolist():
            state = plant.step(now, state, np.array([0.05, -0.05]), dt)
        ends.append(state.q)
    coarse, fine = (np.abs(end - ends[-1]).max() for end in ends[:2])
    assert coarse < 1e-4 and fine < coarse / 6
