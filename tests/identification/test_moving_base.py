"""Rigs whose base moves: what IMUs read, what a log then shows, and what is asked for without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.control import perturbed
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import (
    add_imu_noise,
    compute_imu_readings,
    nominal,
)
from gimbal_pin.effects import CAUSES
from gimbal_pin.identification import given_beta, greatest_base_motion, identify
from gimbal_pin.log import (
    BASE_MOTIONS,
    BaseMotion,
    Imu,
    Log,
    Platform,
    profile_s,
    read_log,
    write_motion,
)
from gimbal_pin.rig import GRAVITY, Rig, bundled_rigs
from tests.bench_logs import EXACT, fourier, prescribed, rows_of, true_theta
from tests.command_line import Run, refused
from tests.identification.moving import carry, list_times, sway
from tests.rigs import bundled

RIG = bundled("turret")


# --- IMUs --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_rigs())
def test_imu_reads_how_its_link_turns_and_falls(name: str) -> None:
    """Rate and specific force by differentiating the link's pose in the world."""
    rig = bundled(name)
    h = 1e-3
    t = (0.4 + h * np.arange(-2, 3))[:, None]
    size = 1.3 + np.arange(rig.n)
    w = 2 * np.pi * np.array([1.3, 0.9, 0.7])
    # The base accelerates by cos(w t), see `sway`.
    places = -np.cos(t * w) / w**2
    turns = Rotation.from_euler("xyz", 0.2 * np.sin(t * w[::-1])).as_matrix()
    q = np.sin(t * size)
    v = size * np.cos(t * size)
    found = compute_imu_readings(rig, rig.config.imus, q, v, -(size**2) * q, sway(t[:, 0]))
    assert rig.base in found
    slope = np.array([1, -8, 0, 8, -1]) / (12 * h)
    curve = np.array([-1, 16, -30, 16, -1]) / (12 * h**2)
    data = rig.model.createData()
    for link, imu in found.items():
        frame = rig.model.getFrameId(link, pin.FrameType.BODY)
        R = []
        p = []
        for angles, turn, place in zip(q, turns, places):
            pin.framesForwardKinematics(rig.model, data, angles)
            R.append(turn @ data.oMf[frame].rotation)
            p.append(place + turn @ data.oMf[frame].translation)
        spin = R[2].T @ np.tensordot(slope, R, 1)
        force = R[2].T @ (curve @ np.array(p) + np.array([0, 0, GRAVITY]))
        assert imu.gyro is not None and imu.accel is not None
        np.testing.assert_allclose(imu.gyro[2], pin.unSkew(spin), atol=1e-7)
        np.testing.assert_allclose(imu.accel[2], force, atol=1e-6)


# --- Identification ------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("platform", "motion"),
    [
        (sway(list_times(12.0)), "rotating"),
        (Platform.still(list_times(12.0), 0.3, -0.2), "tilted"),
        (Platform.still(list_times(12.0)), "fixed"),
        (None, "fixed"),
    ],
)
def test_parameters_that_a_base_shows_are_found(platform: Platform | None, motion: str) -> None:
    true = perturbed(RIG, 0.1, np.random.default_rng(0))
    log = carry(true, platform)
    assert greatest_base_motion(RIG, [log]) == motion
    found = identify(RIG, [log], filtering=EXACT)
    assert found.reduction.base == motion
    expected = given_beta(true.rig, found.reduction)
    theta = found.estimate.theta[: len(expected)]
    np.testing.assert_allclose(theta, expected, atol=1e-3 * np.abs(expected).max())


def test_hidden_parameters_are_found_within_their_deviations() -> None:
    """From the noise of all sensors; a model that ignores the platform is far worse."""
    t = list_times(20.0)
    rng = np.random.default_rng(2)
    log = carry(nominal(RIG), profile_s(t, np.random.default_rng(3), size=0.5), 20.0)
    imus = {RIG.base: add_imu_noise(log.imus[RIG.base], RIG.config.noise, 1e-3, rng)}
    noise = 0.01 * np.std(log.tau) * rng.standard_normal(log.q.shape)
    noisy = replace(log, tau=log.tau + noise, imus=imus)
    found, blind = (
        identify(RIG, [one], filtering=EXACT, holdout="none")
        for one in (noisy, replace(noisy, imus={}))
    )
    assert blind.train.torque_rmse["pan"] > 10 * found.train.torque_rmse["pan"]
    hidden = len(found.names) - len(blind.names)
    assert hidden == 6
    z = (found.estimate.theta - true_theta(RIG, "rotating")) / found.estimate.std
    assert np.abs(z).max() < 4


# --- Diagnosis -------------------------------------------------------------------------------------------


def test_motion_of_a_platform_is_found_and_without_its_imu_unknown() -> None:
    clean = carry(nominal(RIG), sway(list_times(8.0), 0.05), 8.0)
    noise = 1e-3 * np.random.default_rng(2).normal(size=clean.q.shape)
    log = replace(clean, tau=clean.tau + noise)
    few = {"cogging": CAUSES["cogging"]}
    found = diagnose(RIG, [log], few, rng=np.random.default_rng(0))
    (one,) = found.findings
    assert one.cause == "platform-motion"
    assert one.gain["torque_rmse_after"] < 0.5 * one.gain["torque_rmse_before"]
    assert found.verdict == "named"
    unseen = diagnose(RIG, [replace(log, imus={})], few, rng=np.random.default_rng(0))
    assert (unseen.verdict, unseen.findings) == ("unknown", ())
    assert unseen.unexplained == list(RIG.joints)


def disturb(rig: Rig, share: float, joints: slice = slice(None)) -> Log:
    """Return a log with slow torque of other frequencies than the motion's."""
    log = prescribed(nominal(rig), seconds=20.0, dt=4e-3, torque_noise=5e-3)
    rng = np.random.default_rng(3)
    rate = 2 * np.pi * rng.uniform(0.3, 2.5, (40, rig.n))
    phase = rng.uniform(0, 6, (40, rig.n))
    waves = np.sin(np.multiply.outer(log.t, rate) + phase).sum(axis=1)
    tau = np.array(log.tau)
    size = share * np.sqrt(np.mean(tau**2, axis=0)) / waves.std(axis=0)
    tau[:, joints] += (size * waves)[:, joints]
    return replace(log, tau=tau)


@pytest.mark.parametrize("name", ["turret", "handheld"])
def test_imu_of_the_base_is_asked_for_where_all_joints_are_disturbed(name: str) -> None:
    rig = bundled(name)
    moved = disturb(rig, 0.5)
    still = Imu(np.zeros((len(moved), 3)), np.tile([0.0, 0.0, 9.81], (len(moved), 1)))
    logs = {
        "moved": moved,
        "clean": disturb(rig, 0.0),
        "one joint": disturb(rig, 0.5, slice(0, 1)),
        "measured": replace(moved, imus={rig.base: still}),
    }
    asked = [
        kind
        for kind, log in logs.items()
        if any(
            f"gyro_{rig.base}_x" in said
            for said in identify(rig, [log], filtering=EXACT, examined="noisy").warnings
        )
    ]
    assert asked == ["moved"]


# --- The command line --------------------------------------------------------------------------------------


def test_simulate_moves_the_base_by_a_profile_or_a_log(run: Run, tmp_path: Path) -> None:
    motion = tmp_path / "motion.csv"
    paths = [tmp_path / "profile.csv", tmp_path / "along.csv"]
    write_motion(fourier(RIG, 0, 1.0), RIG.joints, motion)
    call = ("simulate", "turret", "--reference", motion)
    profile = ("--platform", "S", "--seed", 5)
    along = ("--platform-log", paths[0])
    for path, platform in zip(paths, (profile, along)):
        assert run(*call, *platform, "-o", path)[0] == 0
    first, second = (
        Platform.measured(log.t, log.imus["base"], log.name, 5.0)
        for log in (read_log(path, RIG) for path in paths)
    )
    assert np.abs(first.w).max() > 0.1
    np.testing.assert_allclose(second.w[200:800], first.w[200:800], atol=2e-2)
    refused(run(*call, *profile, *along, "-o", paths[1]), 2, "--platform")
    refused(run(*call, "--platform-log", motion, "-o", paths[1]), 2, "gyro_base_x")
