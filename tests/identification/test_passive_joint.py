"""Laws of a joint without a motor: its rows ``0 = A θ`` are as good as any, and tell parameters and no fault."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gimbal_pin.checks import check_log
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.errors import DataError
from gimbal_pin.identification import identify
from gimbal_pin.log import Array, Log
from tests.rigs import spelled

CART, BOB, LENGTH, INERTIA, GRAVITY = 2.0, 0.3, 0.3, 4e-3, 9.81
DRAG, RUBBING = 0.8, 2e-3
URDF = """<robot name="cart_pole"><link name="rail"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="bob"><inertial><origin xyz="0 0 0.3"/><mass value="{mass}"/>
<inertia ixx="0.003" iyy="0.003" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="belt" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="60" velocity="5"/></joint>
<joint name="pivot" type="continuous"><parent link="cart"/><child link="bob"/><axis xyz="0 -1 0"/>
<limit effort="1" velocity="30"/></joint></robot>
"""


RIG = spelled(URDF.format(mass=0.8 * BOB))
"""A cart and a pendulum, by a URDF whose pendulum weighs 20 % less."""


def push(t: Array) -> Array:
    """Force on the cart, N."""
    return 3.0 * np.sin(3.1 * t) + 4.0 * np.sin(5.3 * t + 1.0) + 4.0 * np.sin(8.9 * t + 2.0)


@cache
def record() -> Log:
    """A pendulum that hangs on a cart which a force pushes, with noise of a thousandth on every channel."""

    def slope(t: float, state: Array) -> Array:
        _, angle, speed, rate = state
        sine, cosine = np.sin(angle), np.cos(angle)
        moment = BOB * LENGTH
        mass = np.array(
            [[CART + BOB, -moment * cosine], [-moment * cosine, INERTIA + moment * LENGTH]]
        )
        force = push(np.asarray(t)) - DRAG * speed - moment * sine * rate**2
        torque = moment * GRAVITY * sine - RUBBING * rate
        return np.array([speed, rate, *np.linalg.solve(mass, [force, torque])])

    t = np.arange(0.0, 30.0, 4e-3)
    start = [0.0, np.pi, 0.0, 0.0]
    state = solve_ivp(slope, (0.0, t[-1]), start, "DOP853", t, rtol=1e-9, atol=1e-9).y.T
    noise = np.random.default_rng(0).standard_normal((len(t), 3))
    force = push(t)
    force += 0.01 * np.std(force) * noise[:, 0]
    q = state[:, :2] + 2e-5 * noise[:, 1:]
    tau = np.column_stack([force, np.zeros(len(t))])
    return Log("cart", ("belt", "pivot"), t, q, state[:, 2:], tau)


def test_the_mass_of_a_pendulum_that_nobody_drives_comes_back() -> None:
    found = identify(RIG, [record()])
    values = dict(zip(found.names, found.estimate.theta))
    assert values["bob.mz"] == pytest.approx(BOB * LENGTH, rel=0.02)
    assert values["bob.Iyy"] == pytest.approx(INERTIA + BOB * LENGTH**2, rel=0.02)


def test_nothing_is_said_of_a_joint_without_a_motor() -> None:
    assert check_log(RIG, record()).faults == ()
    found = diagnose(RIG, record())
    assert (found.verdict, found.findings) == ("nothing", ())


def test_a_torque_that_was_not_logged_is_not_taken_for_a_joint_without_a_motor() -> None:
    """The belt does not move by itself."""
    log = record()
    assert log.tau is not None
    bad = replace(log, tau=log.tau[:, ::-1].copy())
    with pytest.raises(DataError, match="tau_belt is zero all along"):
        identify(RIG, [bad])
    (fault,) = check_log(RIG, bad).faults
    assert (fault.cause, fault.joint) == ("stuck-channel", "belt")


def test_the_torque_that_is_predicted_of_it_is_nearly_none() -> None:
    log = record()
    fit = identify(RIG, log)
    predicted, left = fit.predict(log), fit.residual(log)
    np.testing.assert_array_equal(left["pivot"], -predicted["pivot"])
    gravity = BOB * GRAVITY * LENGTH
    assert predicted["pivot"].std() < 0.01 * gravity
    assert predicted["belt"].std() > 10 * left["belt"].std()
