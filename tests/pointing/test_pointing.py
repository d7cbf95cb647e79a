"""A camera held still on a platform that moves: kinematics, forecast, laws, margins, measures, failing sensors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import hypot, pi, radians

import numpy as np
import pinocchio as pin
import pytest
from camera.contest import foretell
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gimbal_pin.control import (
    Ahead,
    Aim,
    BaseState,
    CarriedTorque,
    EqualMarginLoop,
    JointPid,
    Pid,
    tune,
)
from gimbal_pin.dynamics import Estimated, Model, compute_imu_readings, compute_rnea, nominal
from gimbal_pin.effects import Delay
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array, Imu, Platform, profile_s
from gimbal_pin.pointing import (
    WANTED,
    Course,
    Forecast,
    Fusion,
    Guard,
    Measurement,
    Pointer,
    Pointing,
    Recipe,
    Row,
    Sight,
    Spectrum,
    Station,
    attitude,
    draw_profile,
    find_trusted_joints,
    gyros_between,
    jitter,
    run_controllers,
    simulate_holding,
    unbalance_payload,
)
from gimbal_pin.pointing.guard import Watch
from gimbal_pin.pointing.navigator import Fused
from gimbal_pin.pointing.sight import holding, inverted, lost_turn
from gimbal_pin.rig import Noise, Rig
from tests.failing_sensors import FailingSensors, SensorFault
from tests.rigs import chain

TAPS = 128
ACCELEROMETER = 1e-4 * 9.81
GYRO = np.deg2rad(0.005)
STEEP = 4.0

DT = 1e-3
NOISE = Noise(GYRO, ACCELEROMETER)
PID = Pid.placed(12.1, 0.9, 0.2)


@cache
def rig_of(name: str) -> Rig:
    return Rig.load(name)


@cache
def spectrum() -> Spectrum:
    """Profile S at half size, as an IMU with noise shows it."""
    t = DT * np.arange(8000)
    moved = profile_s(t, np.random.default_rng(9), 0.5)
    rng = np.random.default_rng(10)
    size = 1 / np.sqrt(2 * DT)
    gyro = moved.w + GYRO * size * rng.standard_normal((8000, 3))
    accel = moved.f + ACCELEROMETER * size * rng.standard_normal((8000, 3))
    return Spectrum.of(Imu(gyro, accel), DT)


def recipe(model: Model, wanted: Array = WANTED, noise: Noise = NOISE, **more: object) -> Recipe:
    return Recipe(model, wanted, spectrum(), noise, 2 * pi / 2**16, **more)  # type: ignore[arg-type]


# --- Kinematics --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["thesis", "handheld", "turret"])
def test_the_cameras_rate_and_its_acceleration(name: str) -> None:
    """``ω_c = Rᵀ ω + J q̇``, as an IMU there reports it; the drift is its derivative without joint acceleration."""
    rig = rig_of(name)
    rng = np.random.default_rng(3)
    sight = Sight(rig)
    q, v, w, dw = (rng.uniform(-0.5, 0.5, size) for size in (rig.n, rig.n, 3, 3))
    view = sight.view(q)
    np.testing.assert_allclose(
        sight.rate(q, v, w)[sight.rows], (view.R.T @ w)[sight.rows] + view.J @ v, atol=1e-12
    )
    base = Platform(np.zeros(1), np.zeros((1, 3)), w[None], dw[None])
    links = gyros_between(rig)
    told = compute_imu_readings(
        rig, [rig.camera_frame, *links], q[None], v[None], np.zeros((1, rig.n)), base
    )
    gyros = [np.asarray(told[link].gyro)[0] for link in (rig.camera_frame, *links)]
    np.testing.assert_allclose(np.concatenate(gyros), sight.rates(q, v, w), atol=1e-12)
    assert len(links) == (0 if name == "turret" else 1)
    h = 1e-6
    change = (sight.rate(q + h * v, v, w + h * dw) - sight.rate(q - h * v, v, w - h * dw)) / (2 * h)
    np.testing.assert_allclose(sight.drift(q, v, w, dw), change, atol=1e-7)


@pytest.mark.parametrize("name", ["thesis", "handheld"])
def test_inverse_kinematics_reaches_and_holds_the_attitude(name: str) -> None:
    rig = rig_of(name)
    sight = Sight(rig)
    t = DT * np.arange(6)
    ground = profile_s(t, np.random.default_rng(0)).about(sight.centre)
    held = holding(sight, WANTED, ground)
    base = Rotation.from_quat(np.asarray(ground.quat), scalar_first=True).as_matrix()
    turned = base @ np.array([sight.attitude(q) for q in held.q])
    np.testing.assert_allclose(turned, np.broadcast_to(WANTED, turned.shape), atol=1e-10)
    np.testing.assert_allclose(held.v[1:-1], (held.q[2:] - held.q[:-2]) / (2 * DT), atol=0.02)
    for q, v, w in zip(held.q, held.v, ground.w):
        assert np.abs(sight.rate(q, v, w)).max() < 1e-10


@pytest.mark.parametrize("joints", [1, 2, 3, 7])
def test_the_cameras_jacobian_is_the_slope_of_its_attitude(joints: int) -> None:
    """``Rᵀ dR/dq_k`` is the turn of joint k, however many there are: of one, too."""
    sight = Sight(chain(joints))
    q = np.linspace(0.3, 0.9, joints)
    view = sight.view(q)
    step = 1e-6
    assert view.inverse.shape == (joints, 3) and np.isfinite(view.inverse).all()
    for k, along in enumerate(step * np.eye(joints)):
        turn = view.R.T @ (sight.view(q + along).R - sight.view(q - along).R) / (2 * step)
        rates = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        np.testing.assert_allclose(view.J[:, k], rates[-len(view.J) :], atol=1e-8)


@given(st.floats(-pi / 2, pi / 2))
def test_near_roll_90_the_inverse_stays_bounded(roll: float) -> None:
    view = Sight(rig_of("thesis")).view(np.array([0.3, roll, 0.2]))
    assert np.abs(view.inverse).max() <= STEEP + 1e-9
    if not view.steep:
        np.testing.assert_allclose(view.inverse @ view.J, np.eye(3), atol=1e-10)
    assert (
        view.steep == (1 / max(np.cos(roll), 1e-12) > STEEP) or abs(1 / np.cos(roll) - STEEP) < 0.3
    )


@pytest.mark.parametrize("roll", [70.0, 80.0, 88.0])
def test_the_turn_that_is_lost_is_told_with_what_it_takes(roll: float) -> None:
    """Yaw and tilt, whose axes close to sin 1/2 (90° - roll) of each other, share the motion: √2/2 of 1/sin of that."""
    sight = Sight(rig_of("thesis"))
    told = lost_turn(sight, np.array([0.3, radians(roll), 0.0]))
    times = float(told.split("would have to turn ")[1].split()[0])
    assert times == pytest.approx(np.sqrt(0.5) / np.sin(radians(90 - roll) / 2), rel=0.06)
    assert "yaw and tilt" in told and "about z" in told
    assert "without end" in lost_turn(sight, np.array([0.3, pi / 2, 0.0]))


def test_more_axes_than_needed_take_the_shortest_way() -> None:
    J = np.random.default_rng(0).standard_normal((3, 4))
    np.testing.assert_allclose(inverted(J)[0], np.linalg.pinv(J), atol=1e-10)


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_the_axes_meet_in_the_centre(name: str) -> None:
    """A platform turned about it leaves it where it is, and an accelerometer there reads what was the origin's."""
    rig = rig_of(name)
    sight = Sight(rig)
    t = DT * np.arange(4)
    assert sight.apart < 1e-9 < Sight(rig_of("handheld")).apart
    ground = profile_s(t, np.random.default_rng(1))
    moved = ground.about(sight.centre)
    there = (
        moved.f
        + np.cross(moved.dw, sight.centre)
        + np.cross(moved.w, np.cross(moved.w, sight.centre))
    )
    np.testing.assert_allclose(there, ground.f, atol=1e-9)


# --- Forecast ----------------------------------------------------------------------------------------------------


def test_the_forecast_sees_a_smooth_motion_ahead() -> None:
    """Rate, angular acceleration and force of another draw of the profile, 1.5 ms ahead; gravity passes as it is."""
    forecast = Forecast(spectrum(), (PID,), DT, (0.0015,))
    weights = forecast.weights[0]
    t = DT / 2 * np.arange(4000)
    rate = weights[:2]
    force = weights[2]
    assert force.sum() == pytest.approx(1.0, abs=1e-3)
    ground = profile_s(t, np.random.default_rng(4))
    past = np.lib.stride_tricks.sliding_window_view(np.asarray(ground.w[::2]), TAPS, axis=0)[
        :, :, ::-1
    ]
    first = 2 * (TAPS - 1) + 3
    count = len(past) - 2
    now = ground.w[first - 3 :: 2][:count]
    ahead = ground.w[first::2][:count]
    seen = (past[:count] @ rate.T)[..., 0]
    assert np.std(seen - ahead) < 0.3 * np.std(now - ahead)
    foreseen = (past[:count] @ rate.T)[..., 1]
    true = ground.dw[first::2][:count]
    assert np.std(foreseen - true) < 0.2 * np.std(true)
    coarse = Forecast(spectrum().until(200.0), (PID,), DT, (0.0015,)).weights[0]
    assert np.linalg.norm(coarse[1]) < 1.5 * np.linalg.norm(
        rate[1]
    )  # what was not sampled is noise all the same
    filled = forecast.step(
        forecast.start(ground.w[0], ground.f[0]), DT, ground.w[1], ground.f[1]
    ).taps
    np.testing.assert_array_equal(filled[0], [*ground.w[1], *ground.f[1]])
    np.testing.assert_array_equal(filled[TAPS - 1], [*ground.w[0], *ground.f[0]])


def flown(forecast: Forecast, w: Array, f: Array):  # type: ignore[no-untyped-def]
    """What a forecast remembers after every sample of a flight."""
    memory = [forecast.start(w[0], f[0])]
    for k in range(1, len(w)):
        memory.append(forecast.step(memory[-1], k * DT, w[k], f[k]))
    return memory


def test_a_forecast_is_used_while_it_errs_less_than_none() -> None:
    """Of profile S at once; of a propeller that it was not shown never, until the flight has shown it, in 4 s."""
    rng = np.random.default_rng(5)
    t = DT / 2 * np.arange(9001)
    ground = profile_s(t, rng)
    w, f = (
        x[::2] + size * rng.standard_normal((4501, 3))
        for x, size in ((ground.w, 2e-3), (ground.f, 0.02))
    )
    known = Forecast(spectrum(), (PID,), DT, (0.0015,))
    assert (last := flown(known, w[:1200], f[:1200])[-1]).trust == 1.0 and not last.events
    wave = np.sin(2 * pi * 110.0 * DT * np.arange(len(w)))[:, None]
    w = w + 0.05 * wave
    f = f + 2.0 * wave
    memory = flown(known, w, f)
    assert max(past.trust for past in memory[:2048]) == 0.0 and memory[-1].trust == 1.0
    assert ["more" in event for event in memory[-1].events] == [True, False]
    assert flown(replace(known, learns=False), w, f)[-1].trust == 0.0
    # A line that stops and another that begins: none is used within 0.1 s, and that is told.
    memory = [memory[-1]]
    for k in range(200):
        own = np.sin(2 * pi * 170.0 * DT * k)
        memory.append(
            known.step(
                memory[-1], 4.5 + k * DT, w[k] - 0.05 * (wave[k] - own), f[k] - 2 * (wave[k] - own)
            )
        )
    assert memory[100].trust == 0.0 and "none is used" in memory[-1].events[-1]


def test_filters_learned_in_flight_are_those_of_what_was_seen() -> None:
    """Those of the spectrum at once, some samples later, and all of them together."""
    rng = np.random.default_rng(6)
    forecast = Forecast(spectrum(), (PID, PID), DT, (0.0015, 0.004))
    w = 0.1 * rng.standard_normal((3100, 3)).cumsum(axis=0)
    f = 9.81 + rng.standard_normal((3100, 3))
    memory = flown(forecast, w, f)
    changed = [k for k in range(1, 3100) if memory[k].weights is not memory[k - 1].weights]
    assert len(changed) == 2 and all(
        memory[k].weights is memory[k - 1].weights for k in (2048, 3072)
    )
    for k in changed:
        seen = Forecast(forecast.known(memory[k]), forecast.gains, DT, forecast.leads)
        for found, wanted in zip(memory[k].weights, seen.weights):
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


def test_none_has_one_gain_and_one_phase() -> None:
    """A line of any frequency as it was half a sample ago, of rate, acceleration and force: nothing is amplified."""
    forecast = Forecast(spectrum(), (PID,), DT, (0.0,))
    for hz in (1.0, 75.0, 180.0, 400.0):
        s = 2j * pi * hz
        t = DT * np.arange(3)
        wave = np.exp(s * t)
        w, dw, f = [
            complex(*x)
            for x in np.array([seen(forecast, part) for part in (wave.real, wave.imag)]).T
        ]
        before = np.exp(s * (t[2] - DT / 2))
        assert f == w and abs(w) <= 1 and abs(dw) <= abs(s)
        assert np.angle(w / before) == pytest.approx(0, abs=1e-9) == np.angle(dw / (s * before))


def seen(forecast: Forecast, wave: Array) -> list[float]:
    """Rate, angular acceleration and force about one axis after three samples of the same signal on every channel."""
    memory = forecast.start(np.full(3, wave[0]), np.full(3, wave[0]))
    for k in (1, 2):
        memory = forecast.step(memory, k * DT, np.full(3, wave[k]), np.full(3, wave[k]))
    (carried,) = forecast.ahead(memory)
    return [float(x[0]) for x in (carried.w, carried.dw, carried.f)]


def test_the_spectrum_parts_noise_from_motion() -> None:
    found = spectrum()
    assert np.sqrt(found.rate_noise) == pytest.approx(GYRO, rel=0.1)
    assert np.sqrt(found.force_noise) == pytest.approx(ACCELEROMETER, rel=0.1)
    moved = profile_s(DT * np.arange(8000), np.random.default_rng(9), 0.5)
    power = np.sum(found.rate) * (found.f[1] - found.f[0])
    assert power == pytest.approx(1.01 * np.mean(np.asarray(moved.w) ** 2), rel=0.15)


def test_fusion_halves_the_walk_and_leaves_the_motion_alone() -> None:
    """The mean of two gyros' walks has half the variance of one; without noise nothing is corrected."""
    rng = np.random.default_rng(0)
    fusion = Fusion(GYRO, 2 * pi / 2**16, DT)
    camera = np.eye(3)
    own = []
    fused = []
    memory = Fused.begun([np.eye(3)], np.zeros((1, 3)))
    last = np.zeros(3)
    for gyro, other in rng.standard_normal((8000, 2, 3)) * GYRO / np.sqrt(2 * DT):
        camera = camera @ pin.exp3((last + gyro) * DT / 2)
        memory = fusion.compared(memory.on(other[None], DT), camera, [np.eye(3)])
        last = gyro
        own.append(pin.log3(camera)), fused.append(pin.log3(camera @ pin.exp3(memory.turn)))
    assert np.mean(np.diff(fused[::200], axis=0) ** 2) < 0.7 * np.mean(
        np.diff(own[::200], axis=0) ** 2
    )
    still = Fused.begun([np.eye(3)], np.ones((1, 3))).on(np.ones((1, 3)), DT)
    after = fusion.compared(still, pin.exp3(np.ones(3) * DT), [np.eye(3)])
    assert max(np.abs(after.turn).max(), np.abs(after.rate).max()) < 1e-12


@pytest.mark.parametrize(("scale", "ended"), [(0.0, False), (0.01, True)])
def test_gaps_beyond_the_gyros_noise_end_the_fusion(scale: float, ended: bool) -> None:
    """A platform that swings by 5° at half a hertz; with the end the camera's attitude keeps its turn for ever."""
    rng = np.random.default_rng(1)
    fusion = Fusion(GYRO, 2 * pi / 2**16, DT)
    camera = np.eye(3)
    memory = Fused.begun([np.eye(3)], np.zeros((1, 3)))
    last = np.zeros(3)
    for k in range(6000):
        angle, rate = np.array([[radians(5)], [radians(5) * pi]]) * [
            [np.sin(pi * k * DT)],
            [np.cos(pi * k * DT)],
        ]
        noise = GYRO / np.sqrt(2 * DT) * rng.standard_normal((2, 3))
        other = noise[1] + [0, (1 + scale) * rate[0], 0]
        camera = camera @ pin.exp3((last + noise[0]) * DT / 2)
        last = noise[0]
        q = np.rint(angle[0] / fusion.step) * fusion.step
        memory = fusion.compared(
            memory.on(other[None], DT), camera, [pin.exp3(np.array([0, -q, 0]))]
        )
        if memory.ended:
            break
    assert memory.ended == ended
    assert not ended or (
        k < 500 and not memory.rate.any() and np.abs(memory.turn).max() < fusion.bound
    )


def test_what_is_fast_is_the_plain_formula() -> None:
    """The 3 by 3 inverse, the forecast in one product, and the mean of the gyros' attitudes."""
    rng = np.random.default_rng(5)
    J = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    np.testing.assert_allclose(inverted(J)[0], np.linalg.inv(J), rtol=1e-12, atol=1e-13)
    forecast = Forecast(spectrum(), (PID, PID), DT, (0.0, 0.0015))
    taps = rng.standard_normal((TAPS + 1, 6))
    past = forecast.start(np.zeros(3), np.zeros(3))._replace(taps=taps[1:], trust=1.0)
    past = forecast.step(
        past._replace(scores=np.array([[0.0] * 4, [1.0] * 4])), 0.0, *np.split(taps[0], 2)
    )
    taps = taps[:-1]
    for weights, ahead in zip(forecast.weights, forecast.ahead(past)):
        plain = [weights[2] @ taps[:, 3:], weights[0] @ taps[:, :3], weights[1] @ taps[:, :3]]
        np.testing.assert_allclose(ahead, plain, rtol=1e-12, atol=1e-13)
    fusion = Fusion(GYRO, 2 * pi / 2**16, DT)
    others = rng.standard_normal((2, 3))
    between = rng.standard_normal((2, 3))
    camera = pin.exp3(rng.standard_normal(3))
    to = [pin.exp3(turn) for turn in between]
    memory = Fused.begun([camera @ R.T for R in to], others).on(others, DT)
    after = fusion.compared(memory, camera, to)
    moved = [pin.log3(camera.T @ camera @ R.T @ pin.exp3(DT * w) @ R) for R, w in zip(to, others)]
    np.testing.assert_allclose(
        after.turn, fusion.gain * np.sum(moved, axis=0) / 3, rtol=1e-12, atol=1e-15
    )
    np.testing.assert_allclose(after.rate, after.turn / DT, rtol=1e-12)


@pytest.mark.parametrize("name", ["thesis", "handheld", "turret"])
def test_the_aim_is_the_plain_formula(name: str) -> None:
    """``q̇ = J⁻¹(ω_c - Rᵀ ω)``, ``e = J⁻¹ log(Rᵀ R_d)``, ``ė = -J⁻¹ ω_c``, ``q̇_d = q̇ + ė`` to rounding."""
    rig = rig_of(name)
    rng = np.random.default_rng(6)
    navigator = recipe(nominal(rig)).pointer("pid").navigator
    q, gyro, w = (rng.uniform(-0.4, 0.4, size) for size in (rig.n, 3, 3))
    seen = Measurement(0.0, q, gyro, w, rng.standard_normal(3), np.zeros(0))
    camera = pin.exp3(rng.standard_normal(3) / 4) @ WANTED
    known = navigator.start(seen, camera, np.eye(3))
    fix, _ = navigator.fix(seen, known._replace(turns=()))
    view = navigator.sight.view(q)
    rows = navigator.sight.rows
    inverse = np.linalg.inv(view.J)
    v = inverse @ (gyro - view.R.T @ w)[rows]
    np.testing.assert_allclose(fix.v, v, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(fix.aim.v, v - inverse @ gyro[rows], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(
        fix.aim.q, q + inverse @ pin.log3(camera.T @ WANTED)[rows], rtol=1e-12
    )


@pytest.mark.parametrize("channel", range(5))
@pytest.mark.parametrize("times", [*np.linspace(0.5, 4.0, 15), 1e9])
@given(st.integers(0, 100), st.integers(0, 2))
def test_a_wrong_reading_costs_no_right_one(
    channel: int, times: float, seed: int, axis: int
) -> None:
    """One so many times as large as changes: the next is used as it is; held angles go on with the joints' rates."""
    rng = np.random.default_rng(seed)
    guard = Guard(DT)
    v = np.array([0.5, -0.3, 1e-3])
    size = [0, 0.04, 0.04, 3, 0.04]
    watch = None
    for k in range(60):
        noise = [x * rng.uniform(-1, 1, 3) for x in size]
        noise[0] = k * DT * v * [1, 1, 0]  # the third moves by less than its encoder's step
        true = Measurement(k * DT, *noise)
        wrong = {
            Measurement._fields[channel + 1]: noise[channel]
            + times * max(size[channel], 0.01) * np.eye(3)[axis]
        }
        seen = true._replace(**wrong) if k == 50 else true  # type: ignore[arg-type]
        watch = guard.start(seen) if watch is None else watch
        used, watch = guard.step(seen, watch, v)
        if k != 50:
            assert all(np.array_equal(a, b) for a, b in zip(true, used))
        elif channel == 0 and times > 4:
            np.testing.assert_allclose(used.q, true.q, atol=1e-4)


@given(
    st.lists(st.floats(-120, 120), min_size=9, max_size=9),
    st.lists(st.floats(-3e-3, 3e-3), min_size=3, max_size=3),
)
def test_the_guards_quick_way_passes_nothing_that_sifting_stops(
    rates: list[float], moved: list[float]
) -> None:
    guard = Guard(DT)
    (gyro, w, links) = np.array(rates).reshape(3, 3)
    seen = Measurement(0.0, np.zeros(3), gyro, w, np.ones(3), links)
    before = Measurement(0.0, np.zeros(3), gyro + 1, w + 1, np.zeros(3), links + 1)
    if guard.sound(seen, before, np.array(moved)):
        _, after = guard.sifted(DT, seen, guard.start(before), np.zeros(3), np.array(moved))
        assert after.calm


@pytest.mark.parametrize("steep", [False, True])
@pytest.mark.parametrize("stuck", [1, 3])
def test_near_a_singular_pose_gyros_tell_that_joints_move_and_not_which(
    stuck: int, steep: bool
) -> None:
    """There one joint may stand though the damped inverse moves it; encoders that all stand while it moves failed."""
    guard = Guard(DT, noisy=False)
    first = Measurement(0.0, np.zeros(3), *(np.zeros(3) for _ in range(4)))
    watch = guard.start(first)
    rates = np.full(3, 5.0)
    for k in range(1, 4):
        moved = np.where(np.arange(3) < stuck, 0.0, k * DT * rates)
        _, watch = guard.step(first._replace(t=k * DT, q=moved), watch, rates, steep)
    assert any("encoders failed" in event for event in watch.events) == (stuck == 3 or not steep)


# --- Laws and margins ----------------------------------------------------------------------------------------------


def test_without_error_the_law_is_the_models_inverse() -> None:
    model = nominal(rig_of("handheld"))
    rng = np.random.default_rng(2)
    q, v, a, f, w, dw = rng.uniform(-0.4, 0.4, (6, 3))
    aim = Aim(q, v, a, (Ahead(q, v, a, BaseState(f, w, dw)),))
    law = CarriedTorque(model, (PID,) * 3, DT)
    tau, _ = law.torque(0.0, q, v, aim, law.start())
    base = Platform(np.zeros(1), f[None], w[None], dw[None])
    np.testing.assert_allclose(
        tau, model.inverse(q[None], v[None], a[None], platform=base)[0], atol=1e-9
    )
    bare, _ = replace(law, model=replace(model, terms=())).torque(0.0, q, v, aim, law.start())
    np.testing.assert_allclose(
        bare, compute_rnea(model.rig, q[None], v[None], a[None], base)[0], atol=1e-12
    )


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_the_controller_of_its_kind_has_the_gains_of_a_given_law(kind: str) -> None:
    """Whatever their margins; the other one keeps its own, and so does the PID that is fallen back to."""
    model = nominal(rig_of("handheld"))
    law = tune(
        model, kind=kind, bandwidth_hz={"pan": 5.0, "roll": 6.0, "tilt": 7.0}, robust=kind != "pid"
    ).controller
    given = recipe(model, law=law)
    plain = recipe(model)
    (other,) = {"computed-torque", "pid"} - {kind}
    own = given.pointer(kind)
    beside = given.pointer(other)
    assert (
        given.kind == kind
        and own.law.gains == law.gains != plain.pointer(kind).law.gains == beside.law.gains
    )
    assert isinstance(own.law, JointPid if kind == "pid" else CarriedTorque)
    assert kind == "pid" or (
        own.law.robust == law.robust is not None and own.navigator.fusion is not None
    )
    assert (
        own.navigator.accelerates == (kind != "pid")
        and own.fallback.gains == plain.pointer(kind).fallback.gains
    )
    assert given.margins(other) == plain.margins(other) != given.margins(kind)


def test_noise_on_a_torque_near_its_limit_does_not_lower_the_limit() -> None:
    """What is cut off one sample is given in the next: the mean stays, but for what is forgotten within a sample."""
    model = nominal(rig_of("handheld"))
    zero = np.zeros(3)
    limit = float(model.tau_max[0])
    law = CarriedTorque(replace(model, terms=()), (PID,) * 3, DT)
    weight = float(compute_rnea(model.rig, zero[None], zero[None], np.eye(3)[:1])[0, 0])
    memory = law.start()
    given_by_yaw = []
    for part in [1.2, 0.6] * 20:
        a = np.array([part * limit / weight, 0.0, 0.0])
        aim = Aim(zero, zero, a, (Ahead(zero, zero, a, BaseState([0.0, 0.0, 9.81], zero, zero)),))
        tau, memory = law.torque(0.0, zero, zero, aim, memory)
        given_by_yaw.append(tau[0] / limit)
    assert max(given_by_yaw) <= 1.0
    assert np.mean(given_by_yaw) == pytest.approx((1.0 + 0.6 + 0.2 * law.lasting) / 2, abs=0.005)
    # A joint that was long beyond its limit leaves it at once, with what one more sample at the limit would give.
    for part in [9.0] * 500 + [0.0] * 3:
        a = np.array([part * limit / weight, 0.0, 0.0])
        aim = Aim(zero, zero, a, (Ahead(zero, zero, a, BaseState([0.0, 0.0, 9.81], zero, zero)),))
        tau, memory = law.torque(0.0, zero, zero, aim, memory)
    assert abs(tau[0]) < 0.01 * limit


def test_all_loops_have_the_same_margin() -> None:
    equal = EqualMarginLoop()
    found = equal.margins
    assert found.crossover_hz == pytest.approx(25.0, abs=0.2)
    assert found.phase_margin_deg == pytest.approx(58.0, abs=1.0)
    assert found.disk_margin >= 1.07 and found.delay_margin >= 0.004
    late = EqualMarginLoop(drive=(Delay("yaw", 0.005),))
    assert late.fair(late.margins) and late.margins.crossover_hz < 8


def test_a_model_that_knows_nothing_is_not_find_trusted_joints() -> None:
    from gimbal_pin.dynamics import reduce_parameters

    rig = rig_of("turret")
    names = (*reduce_parameters(rig, base="rotating").base_names, *(f"f{k}" for k in range(4)))
    ground = profile_s(0.01 * np.arange(200), np.random.default_rng(0))

    def known(size: float) -> Model:
        covariance = size**2 * np.eye(len(names))
        return replace(
            nominal(rig), estimated=Estimated(names, names, np.zeros(len(names)), covariance)
        )

    assert (
        find_trusted_joints(known(1e-5), WANTED, ground)
        == (True, True)
        == find_trusted_joints(nominal(rig), WANTED, ground)
    )
    assert find_trusted_joints(known(10.0), WANTED, ground) == (False, False)


# --- Measures ------------------------------------------------------------------------------------------------------


def test_jitter_is_what_is_fast_and_drift_what_is_slow() -> None:
    t = DT * np.arange(28000)
    error = np.stack([3e-5 * np.sin(2 * pi * 6 * t), 1e-3 * t / t[-1]], axis=1)
    rms, top, drift = jitter(error, DT)
    assert rms == pytest.approx(3e-5 / np.sqrt(2), rel=0.02)
    assert top == pytest.approx(3e-5, rel=0.1) and drift == pytest.approx(1e-3, rel=0.05)


# --- In closed loop --------------------------------------------------------------------------------------------------


def test_knowing_more_holds_the_camera_stiller() -> None:
    """PID, moving base, friction, prediction: each less than the one before. One seed is one run."""
    rig = rig_of("handheld")
    plant = nominal(unbalance_payload(rig))
    ground = draw_profile(rig, 0.9, 0)
    known = recipe(plant)
    pid = known.pointer("pid")
    ours = known.pointer()
    blind = replace(ours, navigator=replace(pid.navigator, accelerates=True))
    bare = replace(blind, law=replace(blind.law, model=replace(plant, terms=())))  # type: ignore[type-var]

    def held(pointer: Pointer, seconds: float = 0.9) -> Pointing:
        return simulate_holding(
            plant, pointer, ground, rng=np.random.default_rng(0), seconds=seconds
        )

    still = [held(pointer).jitter[0] for pointer in (pid, bare, blind, ours)]
    assert still[0] > still[1] > 3 * still[2] > 3 * still[3]
    np.testing.assert_array_equal(*(held(ours, 0.1).error for _ in range(2)))


def test_both_controllers_meet_the_same_motions() -> None:
    rig = rig_of("turret")
    plant = nominal(rig)
    station = Station.of(rig)
    rows = run_controllers(Course(plant, 0.2, station), recipe(plant), 2)
    assert [row.controller for row in rows] == ["pid", "computed-torque"]
    for runs in zip(*(row.runs for row in rows)):
        np.testing.assert_array_equal(*(run.base for run in runs))
    assert [run.seed for run in rows[0].runs] == [0, 1] and not np.allclose(
        *(run.base for run in rows[0].runs)
    )


def test_nothing_moves_what_is_known_exactly() -> None:
    """Exact sensors, a known model without friction, the motion foreknown: what is left is the sampling."""
    rig = rig_of("thesis")
    plant = replace(nominal(rig), terms=())
    ground = draw_profile(rig, 1.0, 0, size=0.2)
    told = foretell(recipe(plant, noise=Noise()), ground)
    run = simulate_holding(
        plant, told, ground, rng=np.random.default_rng(0), seconds=0.8, station=Station.exact(rig)
    )
    assert np.abs(np.rad2deg(run.error[400:])).max() < 2e-3 and not run.events


FAULTS = {
    "camera gyro frozen": (SensorFault("frozen", ("gyro",), 0.2), "gyro", 1.0),
    "platform IMU frozen": (SensorFault("frozen", ("w", "f"), 0.2), "without feed-forward", 1.0),
    "encoders frozen": (SensorFault("frozen", ("q",), 0.2), "encoders", 1.0),
    "encoders say NaN": (SensorFault("nan", ("q",), 0.2), "angles go on from the gyros", 1.0),
    "the gyro in between frozen": (SensorFault("frozen", ("links",), 0.2), "own gyro alone", 0.1),
    "a sample is dropped": (SensorFault("dropped", (), 0.2, 0.201), "never came", 0.1),
    "the clock steps back": (SensorFault("clock", (), 0.2, step=-7.0), "clock stepped", 0.1),
    "NaN from the first sample on": (
        SensorFault("nan", ("gyro", "w", "f"), 0.0, 0.1),
        "failed",
        180.0,
    ),
    "everything says NaN": (SensorFault("nan", ("q", "gyro", "w", "f"), 0.2), "given up", 180.0),
}


@pytest.mark.parametrize("case", FAULTS)
def test_failing_sensors_leave_bounded_torque_and_an_event(case: str) -> None:
    fault, word, allowed = FAULTS[case]
    rig = rig_of("thesis")
    plant = nominal(rig)
    holder = FailingSensors(recipe(plant).pointer("computed-torque"), (fault,))
    run = simulate_holding(
        plant, holder, draw_profile(rig, 0.4, 0), rng=np.random.default_rng([0, 1]), seconds=0.4
    )
    assert np.isfinite(run.tau).all() and np.isfinite(run.error).all()
    assert (np.abs(run.tau) <= rig.tau_max * (1 + 1e-12)).all()
    assert any(word in event for event in run.events), run.events
    assert np.abs(np.rad2deg(run.error)).max() < allowed


def test_near_roll_90_and_at_the_torque_limit_there_are_events_and_bounded_torque() -> None:
    rig = rig_of("thesis")
    plant = nominal(rig)
    wanted = attitude(0.2, 0.1, radians(88))
    course = Course(plant, 0.4, Station.of(rig))
    run = course.run(recipe(plant, wanted), "computed-torque", 0)
    assert np.isfinite(run.tau).all() and (np.abs(run.tau) <= rig.tau_max * (1 + 1e-12)).all()
    assert any(
        "singular" in event and "yaw and tilt would have to turn" in event for event in run.events
    )
    assert not any("encoders" in event for event in run.events)
    weak = replace(rig, motors=tuple(replace(motor, tau_max=0.2) for motor in rig.motors))
    run = replace(course, plant=nominal(weak)).run(recipe(nominal(weak)), "computed-torque", 0)
    assert (
        any("torque limit" in event for event in run.events)
        and max(Row("", (run,)).at_limit.values()) > 0.2
    )
    assert (np.abs(run.tau) <= 0.2 + 1e-12).all() and np.isfinite(run.error).all()


class BlindGuard(Guard):
    """A guard that lets every reading through."""

    def step(
        self, seen: Measurement, watch: Watch, v: Array, steep: bool = False
    ) -> tuple[Measurement, Watch]:
        return seen, watch


def test_what_is_no_number_becomes_no_torque() -> None:
    """Whatever slips through: past a blind guard a NaN of the gyro reaches the law, and no torque comes out."""
    rig = rig_of("turret")
    pointer = replace(recipe(nominal(rig)).pointer(), guard=BlindGuard(DT))
    seen = Measurement(
        0.0, np.array([0.3, 0.4]), np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 9.81]), np.zeros(0)
    )
    memory = pointer.start(seen, WANTED, np.eye(3))
    tau, memory = pointer.torque(seen._replace(t=DT, gyro=np.full(3, np.nan)), memory)
    assert (tau == 0).all() and any("no number" in event for event in memory.events)


READING = st.sampled_from([0.0, 1.0, -3.0, np.nan, np.inf, 1e9])


@given(
    st.lists(
        st.tuples(*[READING] * 5, st.sampled_from([DT, 2 * DT, -1.0, 5.0, np.nan])),
        min_size=1,
        max_size=60,
    )
)
def test_whatever_the_sensors_say_the_guard_passes_numbers_on(
    stream: list[tuple[float, ...]],
) -> None:
    guard = Guard(DT)
    stamp = 0.0
    last = -1.0
    first = Measurement(0.0, *(np.zeros(3) for _ in range(5)))
    watch = guard.start(first)
    for *values, step in stream:
        stamp = step if stamp != stamp else stamp + step
        seen, watch = guard.step(
            Measurement(stamp, *(np.full(3, x) for x in values)), watch, np.zeros(3)
        )
        for channel in (seen.q, seen.gyro, seen.w, seen.f, seen.links, watch.rates):
            assert np.isfinite(channel).all()
        assert np.isfinite(seen.t) and seen.t > last
        last = seen.t


def test_what_cannot_be_run_is_refused() -> None:
    rig = rig_of("turret")
    plant = nominal(rig)
    with pytest.raises(UsageError, match="unknown"):
        recipe(plant).pointer("magic")
    ground = draw_profile(rig, 0.2, 0)
    pointer = recipe(plant).pointer("pid")
    with pytest.raises(UsageError, match="no attitude"):
        simulate_holding(
            plant, pointer, replace(ground, quat=None), rng=np.random.default_rng(0), seconds=0.1
        )
    with pytest.raises(UsageError, match="lasts"):
        simulate_holding(plant, pointer, ground, rng=np.random.default_rng(0), seconds=1.0)


def test_a_run_knows_its_torque_and_its_limits() -> None:
    t = DT * np.arange(8000)
    tau = np.where(t < 6, 1.0, 2.0)[:, None]
    quat = np.tile([1.0, 0, 0, 0], (8000, 1))
    run = Pointing("a", "S", 0, ("yaw",), t, np.zeros((8000, 3)), tau, tau, quat, np.array([2.0]))
    row = Row("a", (run, run))
    assert run.counted.start == 2000 and row.at_limit["yaw"] == pytest.approx(1 / 3)
    assert row.torque_rms["yaw"] == pytest.approx(hypot(1.0, 1.0), rel=1e-9)
