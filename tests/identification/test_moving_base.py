"""Laws of rigs whose base moves: what IMUs read, what a log then shows, and what is asked for without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.control import perturbed
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import compute_imu_readings, nominal
from gimbal_pin.identification import given_beta, greatest_base_motion, identify
from gimbal_pin.log import (
    BASE_MOTIONS,
    BaseMotion,
    Imu,
    Log,
    Platform,
    read_log,
    write_motion,
)
from gimbal_pin.log.signals import lowpass, zero_phase
from gimbal_pin.rig import GRAVITY
from tests.bench_logs import EXACT, fourier, prescribed, rows_of, true_theta
from tests.command_line import Run, refused
from tests.identification.logs import carry, list_times, sway
from tests.rigs import bundled

RIG = bundled("turret")


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_imu_reads_how_its_link_turns_and_falls(name: str) -> None:
    """Rate and specific force by differences of the link's pose in the world."""
    rig = bundled(name)
    h = 1e-4
    t = (0.4 + h * np.arange(-1, 2))[:, None]
    size = 1.3 + np.arange(rig.n)
    q = np.sin(t * size)
    v = size * np.cos(t * size)
    found = compute_imu_readings(rig, rig.config.imus, q, v, -(size**2) * q, sway(t[:, 0]))
    assert rig.base in found
    # The base accelerates by cos(w t), see `sway`.
    w = 2 * np.pi * np.array([1.3, 0.9, 0.7])
    places = -np.cos(t * w) / w**2
    turns = Rotation.from_euler("xyz", 0.2 * np.sin(t * w[::-1]))
    data = rig.model.createData()
    for link, imu in found.items():
        frame = rig.model.getFrameId(link, pin.FrameType.BODY)
        R = []
        p = []
        for angles, turn, place in zip(q, turns, places):
            pin.framesForwardKinematics(rig.model, data, angles)
            R.append(turn * Rotation.from_matrix(data.oMf[frame].rotation))
            p.append(place + turn.apply(data.oMf[frame].translation))
        assert imu.gyro is not None and imu.accel is not None
        rate = (R[0].inv() * R[2]).as_rotvec() / (2 * h)
        np.testing.assert_allclose(imu.gyro[1], rate, atol=1e-5)
        push = (p[0] - 2 * p[1] + p[2]) / h**2 + np.array([0, 0, GRAVITY])
        np.testing.assert_allclose(imu.accel[1], R[1].inv().apply(push), atol=1e-5)


@pytest.mark.parametrize("motion", BASE_MOTIONS)
@pytest.mark.parametrize("name", ["turret", "thesis"])
def test_true_parameters_leave_no_residual_whatever_is_fitted(
    name: str, motion: BaseMotion
) -> None:
    """With fewer base parameters than the base shows, the rig as given stands for the others."""
    rig = bundled(name)
    log = carry(nominal(rig), sway(list_times(6.0)), 6.0)
    for block in rows_of(rig, log, base=motion):
        atol = 2e-4 * np.abs(block.b).max()
        np.testing.assert_allclose(block.A @ true_theta(rig, motion), block.b, atol=atol)


def shake(log: Log, share: float) -> Log:
    """Return the log with white torque noise."""
    tau = np.asarray(log.tau)
    noise = np.random.default_rng(1).standard_normal(tau.shape)
    return replace(log, tau=tau + share * np.std(tau, axis=0) * noise)


@pytest.mark.parametrize(
    ("platform", "motion"),
    [
        (sway(list_times(12.0)), "rotating"),
        (Platform.still(list_times(12.0), 0.3, -0.2), "tilted"),
        (Platform.still(list_times(12.0)), "fixed"),
    ],
)
def test_parameters_that_a_base_shows_are_found(platform: Platform, motion: str) -> None:
    true = perturbed(RIG, 0.1, np.random.default_rng(0))
    log = carry(true, platform)
    assert greatest_base_motion(RIG, [log]) == motion
    exact, noisy = (identify(RIG, [one], filtering=EXACT) for one in (log, shake(log, 0.01)))
    assert exact.reduction.base == noisy.reduction.base == motion
    expected = given_beta(true.rig, exact.reduction)
    scale = np.abs(expected).max()
    b = len(expected)
    np.testing.assert_allclose(exact.estimate.theta[:b], expected, atol=1e-3 * scale)
    assert np.abs((noisy.estimate.theta[:b] - expected) / noisy.estimate.std[:b]).max() < 4


def test_base_that_hardly_turns_keeps_what_it_hides_as_given() -> None:
    t = list_times(10.0)
    w = 0.04 * np.sin(5 * t)[:, None] * [1.0, 0.0, 0.0]
    log = carry(nominal(RIG), replace(Platform.still(t), w=w), 10.0)
    assert greatest_base_motion(RIG, [log]) == "rotating"
    found = identify(RIG, [shake(log, 0.5)], filtering=EXACT, holdout="none")
    assert found.reduction.base != "rotating"


def test_motion_of_a_platform_is_found_and_without_its_imu_unknown() -> None:
    log = shake(carry(nominal(RIG), sway(list_times(8.0), 0.05), 8.0), 0.005)
    found = diagnose(RIG, [log])
    (one,) = found.findings
    assert one.cause == "platform-motion"
    assert one.after < 0.5 * one.before
    assert found.verdict == "named"
    unseen = diagnose(RIG, [replace(log, imus={})])
    assert (unseen.verdict, unseen.stated) == ("unknown", ())
    assert unseen.unexplained == list(RIG.joints)


@pytest.mark.parametrize("name", ["turret", "handheld"])
def test_imu_of_the_base_is_asked_for_where_all_joints_are_disturbed(name: str) -> None:
    """By slow torque that has nothing to do with the motion."""
    rig = bundled(name)
    log = prescribed(nominal(rig), seconds=20.0, torque_noise=5e-3, dt=4e-3)
    white = np.random.default_rng(3).standard_normal(log.q.shape)
    waves = zero_phase(white, lowpass(2.0, 1 / log.dt))
    waves *= 0.5 * np.sqrt(np.mean(np.square(log.tau), axis=0)) / waves.std(axis=0)
    first = np.arange(rig.n) == 0
    moved, clean, touched = (replace(log, tau=log.tau + x * waves) for x in (1.0, 0.0, first))
    still = Imu(np.zeros((len(log), 3)), np.tile([0.0, 0.0, GRAVITY], (len(log), 1)))
    measured = replace(moved, imus={rig.base: still})
    asked = [
        any(f"gyro_{rig.base}_x" in said for said in identify(rig, [one], filtering=EXACT).warnings)
        for one in (moved, clean, touched, measured)
    ]
    assert asked == [True, False, False, False]


def test_simulate_moves_the_base_by_a_profile_or_a_log(run: Run, tmp_path: Path) -> None:
    motion = tmp_path / "motion.csv"
    paths = [tmp_path / "profile.csv", tmp_path / "along.csv"]
    write_motion(fourier(RIG, 0, 1.0), RIG.joints, motion)
    call = ("simulate", "turret", "--reference", motion, "-o")
    profile = ("--platform", "S", "--seed", 5)
    along = ("--platform-log", paths[0])
    for path, platform in zip(paths, (profile, along)):
        assert run(*call, path, *platform)[0] == 0
    first, second = (
        Platform.measured(log.t, log.imus["base"], log.name, 5.0).w
        for log in (read_log(path, RIG) for path in paths)
    )
    assert np.abs(first).max() > 0.1
    np.testing.assert_allclose(second[200:800], first[200:800], atol=2e-2)
    refused(run(*call, paths[1], *profile, *along), 2, "--platform")
    refused(run(*call, paths[1], "--platform-log", motion), 2, "gyro_base_x")
