"""A camera held still on a platform that moves: laws, loops of one margin, closed loops, and how still it stood."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from gimbal_pin.control import (
    Ahead,
    Aim,
    BaseState,
    CarriedTorque,
    EqualMarginLoop,
    Pid,
    compute_inertia,
    tune,
)
from gimbal_pin.dynamics import Estimated, nominal, reduce_parameters
from gimbal_pin.effects import Delay
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Platform, profile_s
from gimbal_pin.pointing import (
    WANTED,
    Course,
    Pointing,
    Row,
    Station,
    attitude,
    draw_profile,
    find_trusted_joints,
    jitter,
    simulate_holding,
    unbalance_payload,
)
from tests.pointing.recipes import DT, recipe
from tests.rigs import bundled

PID = Pid.placed(12.1, 0.9, 0.2)
HANDHELD = nominal(bundled("handheld"))


# --- Laws and margins ----------------------------------------------------------------------------------------------


def test_on_its_aim_the_law_is_the_models_inverse_on_a_moving_base() -> None:
    q, v, a, f, w, dw = np.random.default_rng(2).uniform(-0.4, 0.4, (6, 3))
    aim = Aim(q, v, a, (Ahead(q, v, a, BaseState(f, w, dw)),))
    law = CarriedTorque(HANDHELD, (PID,) * 3, DT)
    tau, _ = law.torque(0.0, q, v, aim, law.start())
    base = Platform(np.zeros(1), f[None], w[None], dw[None])
    expected = HANDHELD.inverse_dynamics(q, v, a, platform=base)
    np.testing.assert_allclose(tau, expected, atol=1e-9)


def test_noise_on_a_torque_near_its_limit_does_not_lower_the_limit() -> None:
    """What is cut off one sample is given in the next; a joint that was long beyond its limit leaves it at once."""
    law = CarriedTorque(replace(HANDHELD, terms=()), (PID,) * 3, DT)
    zero = np.zeros(3)
    pan = np.eye(3)[0]
    base = BaseState(np.array([0.0, 0.0, 9.81]), zero, zero)
    inertia = compute_inertia(law.model, zero[None])[0, 0, 0]
    memory = law.start()
    shares = []
    for part in [1.2, 0.6] * 20 + [9.0] * 500 + [0.0] * 3:
        a = part * law.model.tau_max[0] / inertia * pan
        aim = Aim(zero, zero, a, (Ahead(zero, zero, a, base),))
        tau, memory = law.torque(0.0, zero, zero, aim, memory)
        shares.append(tau[0] / law.model.tau_max[0])
    assert max(shares) <= 1.0
    assert np.mean(shares[:40]) == pytest.approx(0.9, abs=0.02)
    assert abs(shares[-1]) < 0.01


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_the_controller_of_its_kind_has_the_gains_of_a_given_law(kind: str) -> None:
    """The other one keeps its own."""
    law = tune(HANDHELD, kind=kind, bandwidth_hz=5.0).controller
    given = recipe(HANDHELD, law=law)
    for own in ("computed-torque", "pid"):
        gains = given.pointer(own).law.gains
        assert (gains == law.gains) == (own == kind)
        assert (gains == recipe(HANDHELD).pointer(own).law.gains) == (own != kind)


def test_all_loops_have_one_margin_and_a_late_drive_slows_its_own_joint_alone() -> None:
    found = EqualMarginLoop().margins
    assert found.crossover_hz == pytest.approx(25.0, abs=0.2)
    assert found.phase_margin_deg == pytest.approx(58.0, abs=1.0)
    slow = recipe(replace(HANDHELD, drive=(Delay("pan", 0.005),)))
    for name in slow.names:
        first, *others = slow.margins(name)
        assert first.disk_margin >= 1.07
        assert first.crossover_hz < 12
        assert others == [found] * 2
    forecast = slow.pointer().navigator.forecast
    assert forecast.leads == pytest.approx((0.0015, 0.0065))
    assert forecast.gains == (EqualMarginLoop().pid, slow.equals[0].pid)


@pytest.mark.parametrize("size", [1e-5, 10.0])
def test_a_model_is_trusted_as_far_as_its_torque_says_more_than_its_deviation(size: float) -> None:
    model = nominal(bundled("turret"))
    names = (*reduce_parameters(model.rig, base="rotating").base_names, *"abcd")
    covariance = size**2 * np.eye(len(names))
    known = Estimated(names, names, np.zeros(len(names)), covariance)
    ground = profile_s(0.01 * np.arange(200), np.random.default_rng(0))
    trusted = find_trusted_joints(replace(model, estimated=known), WANTED, ground)
    assert trusted == (size < 1,) * 2
    assert find_trusted_joints(model, WANTED, ground) == (True, True)


# --- Closed loops --------------------------------------------------------------------------------------------------


def test_knowing_more_holds_the_camera_stiller() -> None:
    """PID, moving base, friction, prediction: each less than the one before."""
    plant = nominal(unbalance_payload(bundled("handheld")))
    ground = draw_profile(plant.rig, 0.9, 0)
    ours = recipe(plant).pointer()
    pid = recipe(plant).pointer("pid")
    blind = replace(ours, navigator=replace(pid.navigator, accelerates=True))
    bare = replace(blind, law=replace(blind.law, model=replace(plant, terms=())))
    still = [
        simulate_holding(plant, pointer, ground, rng=np.random.default_rng(0), seconds=0.9).jitter[
            0
        ]
        for pointer in (pid, bare, blind, ours)
    ]
    assert still[0] > still[1] > 3 * still[2] > 3 * still[3]


def test_near_roll_90_and_at_the_torque_limit_there_are_events_and_bounded_torque() -> None:
    rig = bundled("thesis")
    weak = replace(rig, motors=tuple(replace(motor, tau_max=0.2) for motor in rig.motors))
    steep = attitude(0.2, 0.1, radians(88))
    for own, wanted, said in ((rig, steep, "singular"), (weak, WANTED, "torque limit")):
        course = Course(nominal(own), 0.4, Station.of(own))
        run = course.run(recipe(nominal(own), wanted), "computed-torque", 0)
        assert (np.abs(run.tau) <= own.tau_max * (1 + 1e-12)).all()
        assert any(said in event for event in run.events)


def test_what_cannot_be_run_is_refused() -> None:
    plant = nominal(bundled("turret"))
    ground = replace(draw_profile(plant.rig, 0.2, 0), quat=None)
    with pytest.raises(UsageError, match="unknown"):
        recipe(plant).pointer("magic")
    with pytest.raises(UsageError, match="no attitude"):
        simulate_holding(plant, recipe(plant).pointer("pid"), ground, rng=0, seconds=0.1)


# --- Measures ------------------------------------------------------------------------------------------------------


def test_jitter_is_what_is_fast_and_drift_what_is_slow() -> None:
    t = DT * np.arange(28000)
    error = np.stack([3e-5 * np.sin(2 * pi * 6 * t), 1e-3 * t / t[-1]], axis=1)
    rms, top, drift = jitter(error, DT)
    assert rms == pytest.approx(3e-5 / np.sqrt(2), rel=0.02)
    assert top == pytest.approx(3e-5, rel=0.1)
    assert drift == pytest.approx(1e-3, rel=0.05)


def test_a_row_tells_shares_at_the_limit_and_every_kind_of_event_once() -> None:
    """Of all but the first two seconds, in which the camera still turns to its aim."""
    t = DT * np.arange(8000)
    early = np.outer(t < 1.9, np.ones(3))
    tau = np.where(t < 6, 1.0, 2.0)[:, None]
    events = ("2.5 s: yaw at its limit for 0.05 s", "1.5 s: yaw at its limit for 0.07 s")
    base = np.zeros((8000, 4))
    run = Pointing("a", "S", 0, ("yaw",), t, early, tau, tau, base, np.full(1, 2.0), events)
    row = Row("a", (run,))
    assert row.jitter_max == 0.0
    assert row.at_limit["yaw"] == pytest.approx(1 / 3)
    assert row.torque_rms["yaw"] == pytest.approx(np.sqrt(2.0))
    assert row.happened == (f"{events[1]} (2 times)",)
