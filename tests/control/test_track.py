"""Step tracking: the trajectories, the metrics, and what computed torque owes the rig."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import Tracking, home, metrics, minimum_jerk, track, tune
from gimbal_pin.control.tracking import shrink_steps
from gimbal_pin.dynamics import Model, Sensors, nominal
from gimbal_pin.effects import Term
from gimbal_pin.errors import UsageError
from gimbal_pin.rig import Limits, Motor, Rig, bundled_payloads, bundled_rigs

BEFORE = 0.1

METRICS = {"rise_time", "overshoot_percent", "settling_time", "steady_state_error", "rms_error"}


# --- Trajectories ------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=4), st.floats(0.2, 2.0))
def test_minimum_jerk_rests_moves_and_rests(goal: list[float], move: float) -> None:
    start = np.linspace(-1, 1, len(goal))
    motion = minimum_jerk(start, np.array(goal), dt=0.001, move=move, before=0.1, after=0.2)
    still = (motion.t <= 0.1) | (motion.t >= 0.1 + move)
    assert not motion.v[still].any() and np.abs(motion.a[still]).max() < 1e-12
    np.testing.assert_allclose(motion.q[0], start)
    np.testing.assert_allclose(motion.q[-1], goal, atol=1e-12)
    distance = np.abs(np.array(goal) - start)
    assert (np.abs(motion.v).max(axis=0) <= distance / move * 15 / 8 + 1e-12).all()
    assert (np.abs(motion.a).max(axis=0) <= distance / move**2 * 10 / np.sqrt(3) + 1e-12).all()


def test_minimum_jerk_is_consistent_and_minimal() -> None:
    """v and a are q's derivatives, and any smooth detour with the same ends costs more jerk."""
    motion = minimum_jerk(np.zeros(1), np.ones(1), dt=1e-3, move=1.0, before=0.0, after=0.0)
    np.testing.assert_allclose(
        np.gradient(motion.q[:, 0], motion.t)[1:-1], motion.v[1:-1, 0], atol=1e-5
    )
    np.testing.assert_allclose(
        np.gradient(motion.v[:, 0], motion.t)[1:-1], motion.a[1:-1, 0], atol=1e-4
    )

    def jerk(acceleration: np.ndarray) -> float:
        return float(np.sum(np.gradient(acceleration, motion.t) ** 2))

    s = motion.t
    bump = np.gradient(np.gradient(s**3 * (1 - s) ** 3, s), s)
    for size in (0.3, -0.3):
        assert jerk(motion.a[:, 0] + size * bump) > jerk(motion.a[:, 0])


def test_minimum_jerk_refuses_what_takes_no_time() -> None:
    with pytest.raises(UsageError, match="positive"):
        minimum_jerk(np.zeros(1), np.ones(1), dt=0.001, move=0.0)


@pytest.mark.parametrize("name", bundled_rigs())
def test_steps_stay_within_every_limit(name: str) -> None:
    plant = nominal(Rig.load(name))
    rig = plant.rig
    start = home(plant.rig)
    wanted = np.deg2rad([30.0, -80.0, 170.0])[: rig.n]
    goal = shrink_steps(plant, wanted.tolist(), 0.5)
    assert (np.sign(goal) == np.sign(wanted)).all() and (np.abs(goal) <= np.abs(wanted)).all()
    motion = minimum_jerk(start, start + goal, dt=0.001)
    tau = plant.inverse(motion.q, motion.v, motion.a)
    for j, limit in enumerate(rig.limits):
        assert (
            limit.lower - 1e-9 <= motion.q[:, j].min()
            and motion.q[:, j].max() <= limit.upper + 1e-9
        )
        assert np.abs(motion.v[:, j]).max() <= limit.velocity * (1 + 1e-9)
        assert np.abs(motion.a[:, j]).max() <= limit.acceleration * (1 + 1e-9)
        assert np.abs(tau[:, j]).max() <= 1.01 * 0.9 * rig.tau_max[j]


def test_steps_that_fit_are_left_alone() -> None:
    plant = nominal(generous("thesis"))
    wanted = np.deg2rad([30.0, 20.0, -25.0])
    np.testing.assert_allclose(shrink_steps(plant, wanted.tolist(), 0.5), wanted)


def generous(name: str, payload: str | None = None) -> Rig:
    """A rig whose motors and limits let the thesis's steps be whole."""
    rig = Rig.load(name, payload)
    motors = tuple(Motor(tau_max=10.0, encoder_bits=motor.encoder_bits) for motor in rig.motors)
    return replace(
        rig, motors=motors, limits=tuple(Limits(limit.lower, limit.upper) for limit in rig.limits)
    )


# --- Metrics -----------------------------------------------------------------------------------------------------


@given(st.floats(3, 30), st.floats(0.2, 0.8), st.sampled_from([-0.4, 0.1, 0.5]))
def test_metrics_of_a_second_order_step_are_the_textbooks(
    w: float, damping: float, distance: float
) -> None:
    """Overshoot exp(-π ζ/√(1 - ζ²)), settling within the envelope's 4/(ζ ω), error gone at the end."""
    t = np.arange(0, BEFORE + 12 / (damping * w), 1e-3)
    s = np.maximum(t - BEFORE, 0)
    wd = w * np.sqrt(1 - damping**2)
    share = 1 - np.exp(-damping * w * s) * (np.cos(wd * s) + damping * w / wd * np.sin(wd * s))
    wanted = np.where(t < BEFORE, 0.0, distance)
    found = metrics(t, wanted, distance * share, distance, 0.0)
    expected = 100 * np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert found.overshoot_percent == pytest.approx(expected, abs=0.3)
    assert (
        found.settling_time <= np.log(1 / (0.02 * np.sqrt(1 - damping**2))) / (damping * w) + 2e-3
    )
    assert abs(found.steady_state_error) < 1e-3 * abs(distance)
    assert found.rms_error == pytest.approx(np.sqrt(np.mean((wanted - distance * share) ** 2)))
    assert found.peak_error == pytest.approx(abs(distance), rel=0.05)


def test_metrics_of_a_ramp_are_exact() -> None:
    t = np.arange(0, 1.0001, 1e-3)
    angle = np.clip((t - 0.1) / 0.5, 0, 1)
    found = metrics(t, angle, angle, 1.0, 0.0)
    assert found.rise_time == pytest.approx(0.4, abs=2e-3)
    assert found.settling_time == pytest.approx(0.49, abs=2e-3)
    assert (found.overshoot_percent, found.rms_error, found.steady_state_error) == (0.0, 0.0, 0.0)


def test_a_joint_that_never_arrives_has_no_rise_or_settling_time() -> None:
    t = np.arange(0, 1, 1e-3)
    found = metrics(t, np.ones_like(t), 0.5 * np.linspace(0, 1, len(t)), 1.0, 0.0)
    assert np.isnan(found.rise_time) and np.isnan(found.settling_time)
    still = metrics(t, np.zeros_like(t), 1e-3 * np.sin(t), 0.0, 0.0)
    assert np.isnan([still.rise_time, still.overshoot_percent, still.settling_time]).all()
    assert still.peak_error == pytest.approx(1e-3 * np.sin(0.999))


# --- Tracking ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole() -> Tracking:
    """The thesis's steps in full on the concentric rig, its encoders and gyros, 8 Hz, the exact model."""
    model = nominal(generous("thesis"))
    laws = {kind: tune(model, kind=kind).controller for kind in ("computed-torque", "pid")}
    return track(model, laws, rng=np.random.default_rng(0), seconds=0.75)


def test_computed_torque_follows_the_thesiss_steps(whole: Tracking) -> None:
    """All axes together and each alone: rms ≤ .007°, overshoot ≤ .05 %, cross-axis ≤ .01° (aim .002° and a bit)."""
    np.testing.assert_allclose(np.rad2deg(list(whole.steps.values())), [30, 20, -25])
    for name in ("all-axes", "yaw", "roll", "tilt"):
        run = whole.of(name, "computed-torque")
        for joint, found in run.joints.items():
            assert np.rad2deg(found.rms_error) <= 0.007
            assert name not in ("all-axes", joint) or found.overshoot_percent <= 0.05
        assert name == "all-axes" or np.rad2deg(run.cross_axis_peak) <= 0.005


def test_pid_is_the_yardstick_and_no_straw_man(whole: Tracking) -> None:
    """Same bandwidth: it follows within tenths of a degree, overshoots under 3 %, and errs ten times more."""
    for joint, found in whole.of("all-axes", "pid").joints.items():
        assert np.rad2deg(found.rms_error) < 0.25 and found.overshoot_percent < 3
        assert (
            found.rms_error > 10 * whole.of("all-axes", "computed-torque").joints[joint].rms_error
        )


def wrong(model: Model, inertia: float, friction: float) -> Model:
    """The model with every body's inertial parameters and every coefficient off, with alternating signs."""
    n = model.rig.n
    signs = np.where(np.arange(n) % 2, -1.0, 1.0)
    phi = model.rig.phi * np.repeat(1 + inertia * signs, 10)
    terms = tuple(
        Term(term.effect, tuple((1 + friction * signs[k // 2]) * value for value in term.values))
        for k, term in enumerate(model.terms)
    )
    return Model(model.rig.with_phi(phi), terms)


@pytest.mark.parametrize(("name", "payload"), list(zip(bundled_rigs(), bundled_payloads())))
def test_a_model_beats_pid_on_every_axis_even_if_wrong(name: str, payload: str) -> None:
    """3 % wrong in inertia, 10 % in friction, all axes together: rms error below PID's on every axis, by far."""
    plant = nominal(Rig.load(name, payload))
    dt = 0.002
    laws = {
        "wrong": tune(wrong(plant, 0.03, 0.1), dt=dt, delay=dt).controller,
        "pid": tune(plant, kind="pid", dt=dt, delay=dt).controller,
    }
    sensors = Sensors.exact(plant.rig.n)
    found = track(
        plant, laws, rng=np.random.default_rng(0), seconds=0.7, sensors=sensors, one_by_one=False
    )
    for joint, pid in found.of("all-axes", "pid").joints.items():
        model_based = found.of("all-axes", "wrong").joints[joint]
        assert model_based.rms_error < pid.rms_error / 3
        assert model_based.saturated == 0


def test_every_controller_meets_the_same_noise_and_every_run_is_repeatable() -> None:
    model = nominal(Rig.load("turret"))
    law = tune(model).controller
    first, again = (
        track(
            model,
            {"a": law, "b": law},
            rng=np.random.default_rng(7),
            seconds=0.65,
            one_by_one=False,
        )
        for _ in range(2)
    )
    a, b = (first.of("all-axes", label) for label in "ab")
    np.testing.assert_array_equal(a.q, b.q)
    np.testing.assert_array_equal(a.q, again.of("all-axes", "a").q)


def test_metrics_see_the_true_angle_not_the_encoders() -> None:
    """The log holds whole encoder steps; the true angle lies within half a step of them, and is none."""
    model = nominal(Rig.load("turret"))
    step = model.rig.motors[0].encoder_step
    run = track(
        model,
        {"a": tune(model).controller},
        rng=np.random.default_rng(0),
        seconds=0.65,
        one_by_one=False,
    )
    seen = run.of("all-axes", "a")
    np.testing.assert_allclose(
        seen.log.q[:, 0] / step, np.round(seen.log.q[:, 0] / step), atol=1e-6
    )
    away = np.abs(seen.q[:, 0] - seen.log.q[:, 0])
    assert 0.3 * step < away.max() <= 0.5 * step * (1 + 1e-6)


def test_to_dict_has_the_contracts_keys(whole: Tracking) -> None:
    data = json.loads(json.dumps(whole.to_dict(), allow_nan=False))
    assert data["schema"] == 1 and data["pointing"] == []
    names = [(row["name"], row["controller"]) for row in data["experiments"]]
    kinds = ("computed-torque", "pid")
    assert names == [(name, kind) for name in ("all-axes", "yaw", "roll", "tilt") for kind in kinds]
    for row in data["experiments"]:
        assert tuple(row["joints"]) == ("yaw", "roll", "tilt")
        for joint, entry in row["joints"].items():
            assert set(entry) >= METRICS
            moved = row["name"] in ("all-axes", joint)
            assert (entry["overshoot_percent"] is None) != moved
        assert (row["cross_axis_peak"] is None) == (row["name"] == "all-axes")


def test_bad_requests_are_refused(whole: Tracking) -> None:
    model = nominal(Rig.load("turret"))
    with pytest.raises(UsageError, match="seconds"):
        track(model, {}, rng=np.random.default_rng(0), seconds=0.3)
    with pytest.raises(UsageError, match="all-axes/pid"):
        whole.of("all-axes", "lqr")
