"""Steps of controllers, on their own plant and on perturbed ones: their metrics, and what doubt costs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from gimbal_pin.control import (
    Judgement,
    Tracking,
    judge_controllers,
    metrics,
    minimum_jerk,
    pair_rivals,
    plan_step,
    track,
    tune,
)
from gimbal_pin.dynamics import Model, Sensors, nominal, simulate
from gimbal_pin.errors import UsageError
from gimbal_pin.rig import Limits, Motor
from tests.control.models import doubtful
from tests.rigs import bundled

DT = 0.004


# --- Steps -------------------------------------------------------------------------------------------------------


def test_minimum_jerk_rests_moves_and_rests() -> None:
    """With the peaks of its formula; v and a are q's derivatives."""
    motion = minimum_jerk(np.zeros(1), np.ones(1), dt=DT, move=0.5)
    assert not motion.v[[0, 25, 150, -1]].any()
    assert motion.q[-1] == pytest.approx(1.0)
    assert motion.v.max() == pytest.approx(15 / 8 / 0.5, rel=1e-3)
    np.testing.assert_allclose(np.gradient(motion.q, DT, axis=0)[1:-1], motion.v[1:-1], atol=0.01)
    assert motion.a.max() == pytest.approx(10 / 3**0.5 / 0.5**2, rel=1e-2)


def test_metrics_of_a_second_order_step_are_the_textbooks() -> None:
    """Overshoot exp(-π ζ/√(1 - ζ²)), error gone at the end."""
    t = np.arange(0, 4, 1e-3)
    s = np.maximum(t - 0.1, 0)
    root = np.sqrt(1 - 0.4**2)
    swing = np.cos(10 * root * s) + 0.4 / root * np.sin(10 * root * s)
    angle = -0.4 * (1 - np.exp(-4 * s) * swing)
    found = metrics(t, np.where(t < 0.1, 0.0, -0.4), angle, -0.4, 0.0)
    assert found.overshoot_percent == pytest.approx(100 * np.exp(-np.pi * 0.4 / root), abs=0.3)
    assert found.steady_state_error == pytest.approx(0.0, abs=1e-3)


def test_metrics_of_a_ramp_are_exact_and_who_never_arrives_has_none() -> None:
    t = np.arange(0, 1.0001, 1e-3)
    angle = np.clip((t - 0.1) / 0.5, 0, 1)
    found = metrics(t, angle, angle, 1.0, 0.0)
    assert (found.rise_time, found.settling_time) == pytest.approx((0.4, 0.49), abs=2e-3)
    late = metrics(t, np.ones_like(t), 1 - t, 1.0, 0.0)
    assert (late.rms_error, late.peak_error) == pytest.approx((np.sqrt(1 / 3), 1.0), rel=1e-3)
    assert np.isnan([late.rise_time, late.settling_time]).all()


@cache
def follow() -> Tracking:
    """Return the thesis's steps in full, twice with computed torque, and with a PID."""
    rig = bundled("thesis")
    motors = tuple(Motor(tau_max=10.0, encoder_bits=motor.encoder_bits) for motor in rig.motors)
    model = nominal(replace(rig, motors=motors, limits=(Limits(),) * 3))
    ours = tune(model).controller
    laws = {"ours": ours, "again": ours, "pid": tune(model, kind="pid").controller}
    return track(model, laws, rng=0, seconds=0.75)


def test_computed_torque_follows_the_thesiss_steps_ten_times_closer_than_a_pid() -> None:
    """All axes together and each alone: rms ≤ .007°, overshoot ≤ .05 %, cross-axis ≤ .005°."""
    found = follow()
    np.testing.assert_allclose(np.rad2deg(list(found.steps.values())), [30, 20, -25])
    for name in ("all-axes", "yaw", "roll", "tilt"):
        run = found.of(name, "ours")
        for own in run.joints.values():
            assert np.rad2deg(own.rms_error) <= 0.007
            assert not own.overshoot_percent > 0.05
        assert name == "all-axes" or np.rad2deg(run.cross_axis_peak) <= 0.005
    for joint, own in found.of("all-axes", "pid").joints.items():
        ours = found.of("all-axes", "ours").joints[joint]
        assert 10 * ours.rms_error < own.rms_error < np.deg2rad(0.25)


def test_every_controller_meets_the_same_noise_and_metrics_see_the_true_angle() -> None:
    """The log holds whole encoder steps; the true angle lies within half a step of them, and is none."""
    found = follow()
    run = found.of("roll", "ours")
    np.testing.assert_array_equal(run.q, found.of("roll", "again").q)
    away = np.abs(run.q[:, 1] - run.log.q[:, 1]).max() / found.rig.motors[1].encoder_step
    assert 0.3 < away <= 0.5 * (1 + 1e-6)


def test_steps_that_cannot_be_run_are_refused() -> None:
    with pytest.raises(UsageError, match="positive"):
        minimum_jerk(np.zeros(1), np.ones(1), dt=0.001, move=0.0)
    with pytest.raises(UsageError, match="seconds"):
        track(nominal(bundled("turret")), {}, rng=0, seconds=0.3)
    with pytest.raises(UsageError, match="all-axes/pid"):
        follow().of("all-axes", "lqr")


# --- Perturbed plants --------------------------------------------------------------------------------------------


def know(share: float = 0.0, **known: Any) -> Model:
    """Return a model of a stated doubt, its drives without lag."""
    model = doubtful(share)
    return replace(model, drive=(), estimated=replace(model.estimated, **known))


@cache
def judge(delay: float = 0.0, **doubt: Any) -> Judgement:
    """Return the judgement of one controller on plants that a model of a stated doubt leaves possible."""
    laws = pair_rivals(tune(know(), dt=DT, delay=0.0).stored)
    exact = Sensors.exact(2)
    return judge_controllers(
        know(**doubt), laws, rng=0, plants=3, delay=delay, sensors=exact, rest=0.5
    )


def test_without_doubt_and_noise_every_plant_is_the_single_simulation() -> None:
    model = know()
    reference = plan_step(model, DT, 0.5)
    law = tune(model, dt=DT, delay=0.0).controller
    log = simulate(model, law, reference, rng=0, sensors=Sensors.exact(2), delay=0)
    rms = np.std((reference.q - log.q)[125:], axis=0, mean=0.0)
    np.testing.assert_allclose(judge().errors["computed-torque"], [rms] * 3, rtol=1e-5)


@pytest.mark.parametrize(
    ("less", "more"),
    [
        ({}, {"share": 0.1}),
        ({"share": 0.1}, {"share": 0.3}),
        ({}, {"missed": (0.0, 0.0)}),
        ({"missed": (0.0, 0.0)}, {"missed": (0.05, 0.05)}),
        ({}, {"noise": (0.02, 0.02)}),
        ({}, {"delay": 0.01}),
    ],
    ids=["parameters", "more of them", "friction at standstill", "missed torque", "noise", "delay"],
)
def test_more_doubt_costs_error(less: dict[str, Any], more: dict[str, Any]) -> None:
    sure, unsure = (judge(**doubt).errors["computed-torque"].max(axis=0) for doubt in (less, more))
    assert (unsure > sure).all()


@pytest.mark.parametrize("bits", [8, None])
def test_no_error_is_smaller_than_the_encoders_resolve(bits: int | None) -> None:
    """An encoder that nobody states is the one of the log: rounding to a step has a deviation of step/√12."""
    model = know(angle_noise=(1e-3, 2e-3))
    model = replace(model, rig=replace(model.rig, motors=(Motor(4.0, encoder_bits=bits),) * 2))
    found = judge_controllers(model, pair_rivals(tune(model, dt=DT).stored), rng=0, plants=1)
    step = 2 * np.pi / 2**8 / np.sqrt(12)
    np.testing.assert_allclose(found.resolved, [step, step] if bits else [1e-3, 2e-3])
    assert all((rows >= found.resolved).all() for rows in found.errors.values())
