"""The camera's kinematics: attitude, Jacobian and its inverse, the motion that holds it, and where none does."""

from __future__ import annotations

from dataclasses import replace
from math import inf, radians

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.dynamics import compute_imu_readings
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Platform, profile_s
from gimbal_pin.pointing import WANTED, Sight, gyros_between, unable, verify
from gimbal_pin.pointing.sight import holding, lost_turn
from tests.rigs import bundled, chain

DT = 1e-3


def test_rates_are_those_of_the_gyros_and_drift_is_their_derivative() -> None:
    rig = bundled("thesis")
    sight = Sight(rig)
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-0.5, 0.5, (2, rig.n))
    w, dw = rng.uniform(-0.5, 0.5, (2, 3))
    base = Platform(np.zeros(1), np.zeros((1, 3)), w[None], dw[None])
    links = (rig.camera_frame, *gyros_between(rig))
    told = compute_imu_readings(rig, links, q[None], v[None], 0 * q[None], base)
    gyros = np.concatenate([told[link].gyro[0] for link in links])
    assert len(gyros) == 3 * (rig.n - 1)
    np.testing.assert_allclose(sight.rates(q, v, w), gyros, atol=1e-12)
    h = 1e-6
    change = sight.rate(q + h * v, v, w + h * dw) - sight.rate(q - h * v, v, w - h * dw)
    np.testing.assert_allclose(sight.drift(q, v, w, dw), change / (2 * h), atol=1e-7)


@pytest.mark.parametrize("joints", [1, 2, 3, 7])
def test_the_jacobian_is_the_attitudes_slope_and_its_inverse_takes_the_shortest_way(
    joints: int,
) -> None:
    sight = Sight(chain(joints))
    q = np.linspace(0.3, 0.9, joints)
    v = np.linspace(1.0, -0.5, joints)
    view = sight.view(q)
    h = 1e-6
    turn = pin.log3(sight.view(q - h * v).R.T @ sight.view(q + h * v).R) / (2 * h)
    np.testing.assert_allclose(view.J @ v, turn[sight.rows][-len(view.J) :], atol=1e-8)
    if not view.steep:
        inverse = np.linalg.pinv(view.J)
        np.testing.assert_allclose(view.inverse[:, sight.rows], inverse, atol=1e-10)
    np.testing.assert_array_equal(view.against, -view.inverse)


@pytest.mark.parametrize("roll", [70.0, 80.0, 88.0, 90.0])
def test_near_a_singular_pose_the_inverse_is_bounded_and_the_lost_turn_told(roll: float) -> None:
    sight = Sight(bundled("thesis"))
    q = np.array([0.3, radians(roll), 0.0])
    view = sight.view(q)
    assert view.steep == (roll > 75)
    assert np.abs(view.inverse).max() <= 4.0 + 1e-9
    assert "yaw and tilt" in lost_turn(sight, q)


def test_the_motion_that_holds_the_camera_keeps_its_attitude() -> None:
    sight = Sight(bundled("thesis"))
    t = 1e-4 * np.arange(6)
    ground = profile_s(t, np.random.default_rng(0)).about(sight.centre)
    held = holding(sight, WANTED, ground)
    bases = Rotation.from_quat(ground.quat, scalar_first=True).as_matrix()
    for base, q, v, w in zip(bases, held.q, held.v, ground.w):
        np.testing.assert_allclose(base @ sight.attitude(q), WANTED, atol=1e-10)
        np.testing.assert_allclose(sight.rate(q, v, w), 0, atol=1e-10)
    np.testing.assert_allclose(held.a[1:-1], np.gradient(held.v, t, axis=0)[1:-1], atol=0.5)


def test_what_cannot_hold_a_camera_says_why() -> None:
    rig = bundled("thesis")
    assert unable(rig, WANTED) is None
    tight = replace(rig, limits=tuple(replace(x, lower=-0.1, upper=0.1) for x in rig.limits))
    assert "reaches its limit" in str(unable(tight, WANTED))
    motors = tuple(replace(motor, tau_max=inf) for motor in rig.motors)
    limits = tuple(replace(limit, effort=inf) for limit in rig.limits)
    with pytest.raises(UsageError, match="torque limits are not stated"):
        verify(replace(rig, motors=motors, limits=limits))
