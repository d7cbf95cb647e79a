"""Failing sensors: what is wrong is replaced and told, costs no right reading, and leaves the torque bounded."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import nominal
from gimbal_pin.pointing import Guard, Measurement, draw_profile, simulate_holding
from tests.failing_sensors import FailingSensors, SensorFault
from tests.pointing.recipes import DT, recipe
from tests.rigs import bundled


@pytest.mark.parametrize("channel", Measurement._fields[1:])
@given(st.floats(0.5, 4.0) | st.just(1e9), st.integers(0, 100))
def test_a_wrong_reading_costs_no_right_one(channel: str, times: float, seed: int) -> None:
    """One so many times as large as changes: the next is used as it is; held angles go on with the joints' rates."""
    rng = np.random.default_rng(seed)
    guard = Guard(DT)
    v = np.array([0.5, -0.3, 0.0])
    size = {"q": 0.0, "gyro": 0.04, "w": 0.04, "f": 3.0, "links": 0.04}
    watch = guard.start(Measurement(-DT, *np.zeros((5, 3))))
    for k in range(60):
        noise = {name: x * rng.uniform(-1, 1, 3) for name, x in size.items()}
        true = Measurement(k * DT, **{**noise, "q": k * DT * v})
        spike = times * max(size[channel], 0.01) * np.eye(3)[seed % 3] * (k == 50)
        seen = true._replace(**{channel: getattr(true, channel) + spike})
        used, watch = guard.step(seen, watch, v)
        if k != 50:
            assert all(np.array_equal(a, b) for a, b in zip(true, used))
        elif times > 4:
            np.testing.assert_allclose(used.q, true.q, atol=1e-4)
            assert np.abs(used.q).max() < 10


@pytest.mark.parametrize("steep", [False, True])
def test_near_a_singular_pose_gyros_tell_that_joints_move_and_not_which(steep: bool) -> None:
    """There one joint may stand though the damped inverse moves it."""
    guard = Guard(DT, noisy=False)
    first = Measurement(0.0, *np.zeros((5, 3)))
    watch = guard.start(first)
    for k in range(1, 4):
        seen = first._replace(t=k * DT, q=np.array([0.0, 5.0, 5.0]) * k * DT)
        _, watch = guard.step(seen, watch, np.full(3, 5.0), steep)
    assert any("encoders failed" in event for event in watch.events) != steep


@pytest.mark.parametrize(
    ("fault", "said", "degrees"),
    [
        (SensorFault("frozen", ("gyro",), 0.2), "gyro", 0.14),
        (SensorFault("frozen", ("w", "f"), 0.2), "without feed-forward", 0.12),
        (SensorFault("frozen", ("q",), 0.2), "encoders", 0.1),
        (SensorFault("nan", ("q",), 0.2), "angles go on from the gyros", 1.0),
        (SensorFault("frozen", ("links",), 0.2), "own gyro alone", 0.1),
        (SensorFault("dropped", (), 0.2, 0.201), "never came", 0.1),
        (SensorFault("clock", (), 0.2, step=-7.0), "clock stepped", 0.1),
        (SensorFault("nan", ("q", "gyro", "w", "f"), 0.2), "given up", 180.0),
    ],
)
def test_failing_sensors_leave_bounded_torque_and_an_event(
    fault: SensorFault, said: str, degrees: float
) -> None:
    plant = nominal(bundled("thesis"))
    holder = FailingSensors(recipe(plant).pointer(), (fault,))
    ground = draw_profile(plant.rig, 0.4, 0)
    run = simulate_holding(plant, holder, ground, rng=np.random.default_rng(1), seconds=0.4)
    assert (np.abs(run.tau) <= plant.rig.tau_max * (1 + 1e-12)).all()
    assert any(said in event for event in run.events), run.events
    assert np.abs(np.rad2deg(run.error)).max() < degrees
