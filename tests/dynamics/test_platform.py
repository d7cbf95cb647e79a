"""Laws of a rig on a platform that moves: MuJoCo's inverse dynamics, the energy balance, the fixed base as a case."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from scipy.spatial.transform import Rotation

from gimbal_pin.dynamics import (
    Model,
    MovingBase,
    Plant,
    State,
    compute_regressor,
    compute_rnea,
    name_columns,
    nominal,
    reduce_parameters,
    scan_columns,
    stack_regressors,
)
from gimbal_pin.effects import BaseTilt, Coulomb, Term
from gimbal_pin.log import Array, Imu, Platform, profile_s
from gimbal_pin.log.profile import ACCELERATION, ATTITUDE
from gimbal_pin.rig import GRAVITY, Rig, bundled_rigs
from tests.dynamics.test_reduction import subspace
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import VARIETY, bundled, states

UP = np.array([0.0, 0.0, GRAVITY])


def shaken(seed: int, count: int = 20) -> tuple[Platform, Array, Array]:
    """Wild attitudes and motions, with the attitude's matrices and the acceleration in the world."""
    rng = np.random.default_rng(seed)
    angles, rates, accelerations = rng.uniform(-1.2, 1.2, (3, count, 3)) * np.array(
        [1, 3, 20]
    ).reshape(3, 1, 1)
    a = rng.uniform(-10, 10, (count, 3))
    return (
        Platform.turning(np.arange(float(count)), angles, rates, accelerations, a),
        Rotation.from_euler("xyz", angles).as_matrix(),
        a,
    )


# --- the equation of the motion itself ------------------------------------------------------------------------------


@given(st.lists(st.floats(-1.4, 1.4), min_size=12, max_size=12))
def test_rates_are_the_attitudes_derivative_and_specific_force_is_turned_gravity(
    numbers: list[float],
) -> None:
    """R' = R [w]x and w' = dw along ``e(t) = e0 + e1 sin t + e2 cos 2t``, by five-point differences."""
    e0, e1, e2, a = np.reshape(numbers, (4, 3))
    h = 1e-3
    t = h * np.arange(-2, 3)[:, None]
    e = e0 + e1 * np.sin(t) + e2 * np.cos(2 * t)
    de = e1 * np.cos(t) - 2 * e2 * np.sin(2 * t)
    dde = -e1 * np.sin(t) - 4 * e2 * np.cos(2 * t)
    moving = Platform.turning(t[:, 0], e, de, dde, np.tile(a, (5, 1)))
    R = Rotation.from_euler("xyz", e).as_matrix()
    weights = np.array([1, -8, 0, 8, -1]) / (12 * h)
    spin = R[2].T @ np.tensordot(weights, R, 1)
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], moving.w[2], atol=1e-8)
    np.testing.assert_allclose(weights @ moving.w, moving.dw[2], atol=1e-7)
    np.testing.assert_allclose(R[2] @ moving.f[2], a + UP, atol=1e-12)
    w, *xyz = moving.quat[2] if moving.quat is not None else ()
    np.testing.assert_allclose(
        pin.Quaternion(np.array([*xyz, w])).toRotationMatrix(), R[2], atol=1e-12
    )


def test_profile_s_is_what_control_says_of_it_whatever_the_sampling() -> None:
    t = 2.5e-3 * np.arange(24_001)
    one = profile_s(t, np.random.default_rng(1))
    fine = profile_s(t[:101] / 2, np.random.default_rng(1))
    np.testing.assert_allclose(one.f[:51], fine.f[::2], atol=1e-9)
    spread = np.sqrt(sum(band.rms**2 for band in ACCELERATION))
    assert np.sqrt(np.mean((np.linalg.norm(one.f, axis=1) - GRAVITY) ** 2)) == pytest.approx(
        spread, rel=0.1
    )
    frequency = np.fft.rfftfreq(len(t), 2.5e-3)
    power = np.sum(np.abs(np.fft.rfft(one.w, axis=0)) ** 2, axis=1)
    inside = np.zeros(len(frequency), dtype=bool)
    for band in ATTITUDE:
        inside |= (frequency > 0.9 * band.low) & (frequency < 1.1 * band.high)
    assert power[inside].sum() > 0.97 * power.sum()
    half = profile_s(t[:1000], np.random.default_rng(1), size=0.5)
    assert np.std(half.w) == pytest.approx(np.std(one.w[:1000]) / 2, rel=0.02)


def test_a_measured_motion_is_the_true_one_below_the_cutoff() -> None:
    t = 1e-3 * np.arange(6001)
    e = np.array([0.2, 0.1, 0.3])
    w = 2 * np.pi * np.array([0.7, 1.1, 0.4])
    angles = e * np.sin(t[:, None] * w)
    rates = e * w * np.cos(t[:, None] * w)
    accelerations = 0 * t[:, None]
    true = Platform.turning(
        t, angles, rates, accelerations - e * w**2 * np.sin(t[:, None] * w), 0 * angles + 0.5
    )
    seen = Platform.measured(t, Imu(true.w, true.f, true.quat), "log")
    for name, size in (("f", 2e-3), ("w", 2e-3), ("dw", 2e-2), ("quat", 1e-5)):
        np.testing.assert_allclose(
            getattr(seen, name)[500:-500], getattr(true, name)[500:-500], atol=size
        )
    assert seen.quat is not None and true.quat is not None
    np.testing.assert_allclose(Platform.measured(t, Imu(true.w, true.f), "log").f, seen.f)


# --- inverse dynamics -------------------------------------------------------------------------------------------------


def mujoco_model(rig: Rig) -> mujoco.MjModel:
    """The rig's URDF in MuJoCo behind a free joint, nothing in it but rigid bodies."""
    robot = etree.fromstring(rig.urdf.encode())
    robot.insert(0, etree.Element("link", name="world"))
    joint = etree.SubElement(robot, "joint", name="free", type="floating")
    etree.SubElement(joint, "parent", link="world")
    etree.SubElement(joint, "child", link=rig.base)
    return rigid_bodies(robot)


def mujoco_torque(
    rig: Rig, q: Array, v: Array, a: Array, platform: Platform, world: Array
) -> Array:
    """mj_inverse with the base where the world sees it: MuJoCo's free joint has its rate in the body's frame."""
    assert platform.quat is not None
    place, speed = np.random.default_rng(0).normal(size=(2, len(q), 3))  # no joint feels them
    pose = np.hstack([place, platform.quat])
    rate = np.hstack([speed, platform.w])
    push = np.hstack([world, platform.dw])
    return torque(mujoco_model(rig), rig.joints, q, v, a, list(zip(pose, rate, push)))


@pytest.mark.parametrize(("name", "payload"), VARIETY)
def test_torque_is_mujocos_on_every_bundled_rig(name: str, payload: str) -> None:
    rig = bundled(name, payload)
    platform, _, world = shaken(1)
    at = states(rig.n, 2)
    ours = compute_rnea(rig, *at, platform)
    np.testing.assert_allclose(ours, mujoco_torque(rig, *at, platform, world), rtol=0, atol=1e-9)
    still = compute_rnea(rig, *at)
    assert np.abs(ours - still).max() > 0.1 * np.abs(still).max()


@pytest.mark.parametrize("name", bundled_rigs())
def test_a_fixed_base_is_a_platform_at_rest_and_a_lean_is_turned_gravity(name: str) -> None:
    rig = bundled(name)
    t = np.arange(20.0)
    at = states(rig.n, 4)
    np.testing.assert_allclose(
        compute_rnea(rig, *at, Platform.still(t)), compute_rnea(rig, *at), atol=1e-12
    )
    np.testing.assert_allclose(
        compute_regressor(rig, *at, Platform.still(t)), compute_regressor(rig, *at), atol=1e-12
    )
    leaning = BaseTilt(roll=0.3, pitch=-0.7).apply(rig)
    np.testing.assert_allclose(
        compute_rnea(rig, *at, Platform.still(t, 0.3, -0.7)), compute_rnea(leaning, *at), atol=1e-12
    )
    np.testing.assert_allclose(
        compute_rnea(leaning, *at, Platform.still(t)), compute_rnea(leaning, *at), atol=1e-12
    )


def test_what_turns_evenly_on_a_platform_moves_as_both_turns_at_once() -> None:
    """About one axis the angles add up; a base that sinks leans by its rate's time."""
    t = np.linspace(0.0, 2.0, 30)
    pushed = np.tile([0.4, 0.5, 0.6], (30, 1))
    pitch = np.stack([0 * t, 0.3 * np.sin(3 * t), 0 * t], axis=1)
    rate = np.gradient(pitch, t, axis=0)
    more = np.tile([0.0, 0.05, 0.0], (30, 1))
    own = Platform.turning(t, pitch, rate, 0.2 * rate, pushed)
    both = Platform.turning(t, pitch + more * t[:, None], rate + more, 0.2 * rate, pushed)
    sunk = BaseTilt(pitch_rate=0.05).carried(t, own)
    assert sunk is not None and BaseTilt(0.1, 0.2).carried(t, own) is own
    for name in ("f", "w", "dw"):
        np.testing.assert_allclose(getattr(sunk, name), getattr(both, name), atol=1e-12)
    alone = BaseTilt(roll_rate=0.02, pitch_rate=-0.03).carried(t, None)
    assert alone is not None
    lean = (
        BaseTilt(roll=0.02 * t[7], pitch=-0.03 * t[7])
        .apply(Rig.load("turret"))
        .model.gravity.linear
    )
    np.testing.assert_allclose(alone.f[7], -lean, atol=1e-12)


@pytest.mark.parametrize("name", bundled_rigs())
def test_the_regressor_is_inverse_dynamics_for_any_bodies(name: str) -> None:
    rig = bundled(name)
    platform = shaken(5)[0]
    at = states(rig.n, 6)
    phi = rig.phi * np.random.default_rng(7).uniform(0.5, 2, 10 * rig.n)
    expected = compute_rnea(rig.with_phi(phi), *at, platform)
    np.testing.assert_allclose(
        compute_regressor(rig, *at, platform) @ phi, expected, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(
        Model(rig.with_phi(phi), ()).inverse(*at, platform=platform), expected, atol=0
    )


@pytest.mark.parametrize("name", bundled_rigs())
def test_power_at_joints_and_base_is_the_rate_of_energy(name: str) -> None:
    """d/dt (T + V) = q'ᵀ tau + w·M + v·F: energy in the world, where the base really moves and falls; h⁴ errors."""
    rig = bundled(name)
    world = rig.floating.copy()
    world.gravity.linear = -UP
    data = world.createData()
    h = 1e-3
    rng = np.random.default_rng(8)
    w = rng.uniform(1, 4, (3, rig.n + 6))
    size = rng.uniform(0.1, 0.6, (3, rig.n + 6))

    def motion(t: float) -> tuple[Array, Array, Array]:
        s = size * np.sin(w * t)
        c = size * np.cos(w * t)
        return s.sum(0), (w * c).sum(0), (-(w**2) * s).sum(0)

    def at(t: float) -> tuple[Platform, Array, Array]:
        (x, dx, ddx) = motion(t)
        one = np.zeros(1)
        platform = Platform.turning(one, x[None, 3:6], dx[None, 3:6], ddx[None, 3:6], ddx[None, :3])
        R = Rotation.from_euler("xyz", x[None, 3:6]).as_matrix()[0]
        q = np.concatenate([x[:3], pin.Quaternion(R).coeffs(), x[6:]])
        return platform, q, np.concatenate([R.T @ dx[:3], platform.w[0], dx[6:]])

    def energy(t: float) -> float:
        _, q, v = at(t)
        return float(
            pin.computeKineticEnergy(world, data, q, v) + pin.computePotentialEnergy(world, data, q)
        )

    for t in rng.uniform(0, 10, 5):
        rate = (8 * (energy(t + h) - energy(t - h)) - (energy(t + 2 * h) - energy(t - 2 * h))) / (
            12 * h
        )
        platform, _, v = at(t)
        x, dx, ddx = motion(t)
        tau = compute_rnea(rig, x[None, 6:], dx[None, 6:], ddx[None, 6:], platform)[0]
        lifted = (np.r_[np.zeros(6), 1.0, x[6:]], np.r_[np.zeros(3), platform.w[0], dx[6:]])
        wrench = pin.rnea(
            rig.floating,
            rig.floating.createData(),
            *lifted,
            np.r_[platform.f[0], platform.dw[0], ddx[6:]],
        )
        np.testing.assert_allclose(wrench[6:], tau, atol=1e-12)
        assert rate == pytest.approx(
            v[:6] @ wrench[:6] + v[6:] @ tau, abs=1e-7 * (1 + np.abs(v) @ np.abs(wrench))
        )


# --- what shows -------------------------------------------------------------------------------------------------------

COUNTS = {
    ("thesis", False): (15, 17, 21),
    ("thesis", True): (9, 11, 12),
    ("handheld", False): (15, 17, 21),
    ("turret", False): (8, 10, 14),
}
"""CONTROL, "Identifiable inertial parameters": what a base that stands, leans, turns shows; two axes by n - 1."""


@pytest.mark.parametrize(("name", "diagonal"), COUNTS)
def test_a_lean_adds_two_and_turning_four_more(name: str, diagonal: bool) -> None:
    rig = bundled(name)
    found = [reduce_parameters(rig, diagonal, base) for base in ("fixed", "tilted", "rotating")]  # type: ignore[arg-type]
    assert tuple(len(one.independent) for one in found) == COUNTS[name, diagonal]
    assert (
        tuple(subspace(stack_regressors(rig, diagonal, one.base)[0]).shape[1] for one in found)
        == COUNTS[name, diagonal]
    )
    assert set(found[0].independent) < set(found[1].independent) < set(found[2].independent)
    assert set(found[2].zero) < set(found[1].zero) < set(found[0].zero)


@pytest.mark.parametrize("name", bundled_rigs())
def test_one_lean_shows_as_much_as_many_and_translation_adds_nothing_to_turning(name: str) -> None:
    rig = bundled(name)
    (names, places) = name_columns(bundled(name))
    at = states(rig.n, 9, 200)
    lean = Platform.still(np.arange(200.0), 0.4, 0.3)
    turning, R, _ = shaken(10, 200)
    in_place = Platform(turning.t, R.transpose(0, 2, 1) @ UP, turning.w, turning.dw)
    for base, platform in (("tilted", lean), ("rotating", in_place)):
        matrix = compute_regressor(rig, *at, platform)[:, :, places].reshape(-1, len(places))
        assert (
            scan_columns(matrix, names).independent == reduce_parameters(rig, base=base).independent
        )  # type: ignore[arg-type]


def test_the_level_of_a_motion_is_told_from_it() -> None:
    t = 1e-3 * np.arange(5000)
    noise = np.random.default_rng(0).normal(0, 0.005, (5000, 3))
    upright = Platform(t, UP + noise, noise + 0.01, 0 * noise)
    assert upright.motion == "fixed"
    sway = np.outer(0.01 * np.sin(2 * np.pi * t), [1.0, 0.0, 0.0])
    assert Platform(t, UP + noise, noise + sway, 0 * noise).motion == "rotating"
    assert Platform.still(t, 0.05).motion == "tilted"
    assert profile_s(t, np.random.default_rng(0), size=0.5).motion == "rotating"


# --- forward dynamics -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_rigs())
def test_the_plants_acceleration_inverts_inverse_dynamics(name: str) -> None:
    rig = bundled(name)
    platform = shaken(11)[0]
    model = nominal(rig)
    t = np.arange(20)
    q, v, a = states(rig.n, 12)
    tau = model.inverse(q, v, a, platform=platform)
    plant = Plant(model, platform)
    for k in t[1:-1]:
        state = State(q[k], v[k])
        np.testing.assert_allclose(
            plant.acceleration(float(k), state, tau[k]), a[k], rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("name", bundled_rigs())
def test_a_base_too_heavy_to_be_moved_moves_as_prescribed(name: str) -> None:
    """One ABA of the heavy base is ``D⁻¹(τ - C v - G)`` with RNEA's bias and CRBA's D, at samples and between them."""
    rig = bundled(name)
    (platform, *_) = shaken(11)
    armature = np.linspace(1e-4, 1e-2, rig.n)
    rng = np.random.default_rng(3)
    carrier = MovingBase(rig, platform, armature)
    own = rig.model.copy()
    own.armature = armature
    for t in (0.0, 3.0, 3.4, float(platform.t[-1])):
        x = rng.uniform(-2, 2, 2 * rig.n)
        net = rng.uniform(-3, 3, rig.n)
        upper = pin.crba(own, own.createData(), x[: rig.n])
        D = np.triu(upper) + np.triu(upper, 1).T
        expected = np.linalg.solve(D, net - carrier.bias(t, *np.split(x, 2)))
        found = carrier.accelerations(t, *np.split(x, 2), net.tolist())
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", bundled_rigs())
def test_a_platform_at_rest_carries_the_plant_along_the_fixed_ones_way(name: str) -> None:
    """Friction, sticking and all: the two ways of computing the same torque part by rounding alone."""
    rig = bundled(name)
    dt = 1e-3
    model = nominal(rig)
    n = 300
    still = Plant(model, Platform.still(dt / 2 * np.arange(2 * n + 1)))
    fixed = Plant(model)
    one = other = State(np.full(rig.n, 0.2), np.full(rig.n, 0.4))
    for k in range(n):
        tau = 0.2 * np.sin(20 * k * dt + np.arange(rig.n))
        one = still.step(k * dt, one, tau, dt)
        other = fixed.step(k * dt, other, tau, dt)
    np.testing.assert_allclose(one.q, other.q, atol=1e-10)
    np.testing.assert_allclose(one.v, other.v, atol=1e-9)


@pytest.mark.parametrize(("rate", "order"), [(3.0, 4), (0.5, 2)])
def test_the_plant_on_a_shaken_platform_converges(rate: float, order: int) -> None:
    """Of fourth order while the joints slide; stops and starts, where dry friction jumps, leave two orders."""
    rig = bundled("turret")
    ends = []
    model = nominal(rig)
    v = rate * np.array([1.0, -1.0])
    for parts in (1, 2, 16):
        dt = 1e-3 / parts
        platform = profile_s(dt / 2 * np.arange(200 * parts + 1), np.random.default_rng(5))
        plant = Plant(model, platform)
        state = State(np.array([0.3, 0.2]), v)
        for k in range(100 * parts):
            state = plant.step(k * dt, state, np.array([0.05, -0.05]), dt)
        ends.append(state.q)
    coarse, fine = (np.abs(end - ends[-1]).max() for end in ends[:2])
    assert coarse < 1e-4 and fine < 2.0 ** (1 - order) * coarse


def test_shaking_moves_a_joint_only_when_it_breaks_its_dry_friction() -> None:
    rig = bundled("turret")
    dt = 1e-3
    platform = profile_s(dt / 2 * np.arange(201), np.random.default_rng(5))
    q = np.array([0.3, 0.2])
    none = np.zeros(2)
    need = np.abs(
        compute_rnea(rig, *(np.tile(x, (201, 1)) for x in (q, none, none)), platform)
    ).max(axis=0)
    for share, moves in ((1.001, False), (0.5, True)):
        rubbing = tuple(
            Term(Coulomb(joint), (share * level,))
            for joint, level in zip(rig.joints, need.tolist())
        )
        plant = Plant(Model(rig, rubbing), platform)
        state = State(q, none)
        for k in range(100):
            state = plant.step(k * dt, state, none, dt)
        assert bool(np.any(state.q != q)) == moves
