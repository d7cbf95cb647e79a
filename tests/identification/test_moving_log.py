"""Logs of a rig whose base moves: what IMUs report, and what identification makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.checks.stuck_channel import compute_denial
from gimbal_pin.control import perturbed, tune
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import (
    Model,
    Sensors,
    add_imu_noise,
    compute_base,
    compute_imu_readings,
    nominal,
    reduce_parameters,
    simulate,
)
from gimbal_pin.effects import CAUSES
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.identification import given_beta, greatest_base_motion, identify
from gimbal_pin.log import (
    BASE_MOTIONS,
    Array,
    BaseMotion,
    Imu,
    Log,
    Platform,
    profile_s,
    read_log,
    write_motion,
)
from gimbal_pin.regression import classify_base_motion
from gimbal_pin.report import show_diagnosis
from gimbal_pin.report.summary import missed
from gimbal_pin.rig import GRAVITY, bundled_rigs
from tests.bench_logs import EXACT, fourier, rows_of, true_theta
from tests.command_line import Run, refused, result
from tests.rigs import bundled

PHANTOM = Path(__file__).parents[3] / "shared" / "data" / "phantom4_motion" / "path_1.csv"


def swaying(t: Array, size: float = 0.2) -> Platform:
    """A few degrees and some m/s² on every axis, below 2 Hz: nothing that the filters would take away."""
    w = 2 * np.pi * np.array([0.7, 0.9, 1.3])
    s = np.sin(t[:, None] * w)
    c = np.cos(t[:, None] * w)
    return Platform.turning(
        t, size * s, size * w * c, -size * w**2 * s, 5 * size * np.cos(t[:, None] * w[::-1])
    )


def carried(model: Model, platform: Platform | None, seconds: float = 20.0, seed: int = 0) -> Log:
    """The log of a prescribed motion on a moving base, without noise."""
    motion = fourier(model.rig, seed, seconds)
    tau = model.inverse(motion.q, motion.v, motion.a, platform=platform)
    imus = {} if platform is None else {model.rig.base: Imu(platform.w, platform.f)}
    return Log("carried", model.rig.joints, motion.t, motion.q, motion.v, tau, imus=imus)


def times(seconds: float = 20.0) -> Array:
    return 1e-3 * np.arange(round(seconds * 1000) + 1)


# --- IMUs -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_rigs())
def test_an_imu_reports_how_its_link_turns_and_falls_in_the_world(name: str) -> None:
    """Rate and specific force by differentiating the link's pose in the world, the base's motion included."""
    rig = bundled(name)
    h = 1e-3
    t = 0.4 + h * np.arange(-2, 3)
    platform = swaying(t)
    size = 1.3 + np.arange(rig.n)
    # Its origin's acceleration is 5 · 0.2 cos(w t): its place -cos(w t)/w².
    w = 2 * np.pi * np.array([1.3, 0.9, 0.7])
    p = -np.cos(t[:, None] * w) / w**2
    R = Rotation.from_euler("xyz", 0.2 * np.sin(t[:, None] * w[::-1])).as_matrix()
    q = np.sin(t[:, None] * size)
    v = size * np.cos(t[:, None] * size)
    a = -(size**2) * np.sin(t[:, None] * size)
    links = rig.config.imus
    found = compute_imu_readings(rig, links, q, v, a, platform)
    assert set(found) == set(links) and rig.base in links
    slope = np.array([1, -8, 0, 8, -1]) / (12 * h)
    curve = np.array([-1, 16, -30, 16, -1]) / (12 * h**2)
    data = rig.model.createData()
    for link in links:
        frame = rig.model.getFrameId(link, pin.FrameType.BODY)
        turns = []
        places = []
        for angles, base_turn, base_place in zip(q, R, p):
            pin.framesForwardKinematics(rig.model, data, angles)
            turns.append(base_turn @ data.oMf[frame].rotation)
            places.append(base_place + base_turn @ data.oMf[frame].translation)
        spin = turns[2].T @ np.tensordot(slope, turns, 1)
        force = turns[2].T @ (curve @ np.array(places) + np.array([0, 0, GRAVITY]))
        gyro = found[link].gyro
        accel = found[link].accel
        assert gyro is not None and accel is not None
        np.testing.assert_allclose(gyro[2], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-7)
        np.testing.assert_allclose(accel[2], force, atol=1e-6)


def test_noise_has_its_density_and_comes_from_the_generator() -> None:
    rig = bundled("turret")
    still = Platform.still(times())
    imu = compute_imu_readings(rig, [rig.base], *(np.zeros((len(still), 2)),) * 3, still)[rig.base]
    one, again = (
        add_imu_noise(imu, rig.config.noise, 1e-3, np.random.default_rng(0)) for _ in range(2)
    )
    assert one.gyro is not None and one.accel is not None and again.gyro is not None
    np.testing.assert_array_equal(one.gyro, again.gyro)
    assert one.gyro.std() == pytest.approx(rig.config.noise.gyro * np.sqrt(500), rel=0.02)
    assert (one.accel - still.f).std() == pytest.approx(
        rig.config.noise.accelerometer * np.sqrt(500), rel=0.02
    )


# --- the closed loop --------------------------------------------------------------------------------------------------


def test_a_log_holds_what_moves_the_base_and_its_torque_is_inverse_dynamics() -> None:
    rig = bundled("turret")
    model = nominal(rig)
    reference = fourier(rig, 0, 1.0)
    platform = swaying(5e-4 * np.arange(2 * len(reference)))
    sensors = replace(Sensors.exact(rig.n), imus=rig.config.imus)
    law = tune(model).controller
    rng = np.random.default_rng(0)
    log = simulate(model, law, reference, rng=rng, sensors=sensors, platform=platform)
    seen = log.imus[rig.base]
    np.testing.assert_array_equal(seen.gyro, platform.w[: 2 * len(log) : 2])
    np.testing.assert_array_equal(seen.accel, platform.f[: 2 * len(log) : 2])
    assert set(log.imus) == set(rig.config.imus) and seen.quat is not None and log.v is not None
    middle = Platform(log.t, *(x[1::2] for x in (platform.f, platform.w, platform.dw)))
    half = [(x[1:] + x[:-1]) / 2 for x in (log.q, log.v)]
    tau = model.inverse(*half, np.diff(log.v, axis=0) / 1e-3, platform=middle.part(slice(0, -1)))
    steady = np.all(np.abs(half[1]) > 2e-3, axis=1)
    assert steady.mean() > 0.5
    np.testing.assert_allclose(tau[steady], np.asarray(log.tau)[:-1][steady], atol=0.02)
    with pytest.raises(
        UsageError, match=r"platform: lasts from 0 to 0.4995 s, the reference from 0 to 1 s; give"
    ):
        simulate(model, law, reference, rng=rng, platform=platform.part(slice(0, 1000)))


def test_a_base_that_stands_changes_no_log_and_its_imus_change_no_estimate() -> None:
    rig = bundled("turret")
    reference = fourier(rig, 0, 5.0)
    law = tune(nominal(rig)).controller
    model = nominal(rig)
    plain, seen = (
        simulate(
            model,
            law,
            reference,
            rng=np.random.default_rng(1),
            sensors=replace(Sensors.of(rig, 1e-3), imus=imus),
        )
        for imus in ((), rig.config.imus)
    )
    assert not plain.imus and set(seen.imus) == set(rig.config.imus)
    np.testing.assert_array_equal(plain.tau, seen.tau)
    one, other = (identify(rig, [log], holdout="none") for log in (plain, seen))
    assert other.reduction.base == "fixed"
    np.testing.assert_array_equal(one.estimate.theta, other.estimate.theta)


# --- identification ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", BASE_MOTIONS)
@pytest.mark.parametrize("name", ["turret", "thesis"])
def test_the_true_parameters_leave_no_residual_whatever_is_fitted(
    name: str, motion: BaseMotion
) -> None:
    """The base moves; with fewer base parameters than it shows, the rig as given stands for the others."""
    rig = bundled(name)
    log = carried(nominal(rig), swaying(times(8.0)), 8.0)
    true = true_theta(rig, motion)
    for block in rows_of(rig, log, base=motion):
        assert np.abs(block.A @ true - block.b).max() < 2e-4 * np.abs(block.b).max()


@pytest.mark.parametrize(
    ("platform", "motion"),
    [
        (swaying(times()), "rotating"),
        (Platform.still(times(), 0.3, -0.2), "tilted"),
        (None, "fixed"),
    ],
)
def test_what_the_base_does_is_told_and_what_it_shows_is_found(
    platform: Platform | None, motion: str
) -> None:
    rig = bundled("turret")
    true = perturbed(rig, 0.1, np.random.default_rng(0))
    log = carried(true, platform)
    assert greatest_base_motion(rig, [log]) == motion
    found = identify(rig, [log], filtering=EXACT)
    assert found.reduction.base == motion and found.to_dict()["base_motion"] == motion
    expected = given_beta(true.rig, found.reduction)
    assert (
        np.abs(found.estimate.theta[: len(expected)] - expected).max()
        < 1e-3 * np.abs(expected).max()
    )
    assert found.held_out is not None and min(found.held_out.fit_percent.values()) > 99.8


@pytest.mark.parametrize("size", [0.05, 0.1, 0.2])
def test_a_platform_that_moves_unseen_is_unknown(size: float) -> None:
    """Without its IMU no joint is explained, and no cause is named for what all of them feel."""
    rig = bundled("turret")
    rng = np.random.default_rng(2)
    clean = carried(nominal(rig), swaying(times(8.0), size), 8.0)
    assert clean.tau is not None
    log = replace(clean, tau=clean.tau + 1e-3 * rng.normal(size=clean.tau.shape), imus={})
    found = diagnose(
        rig, [log], {name: CAUSES[name] for name in ("delay", "presliding", "torque-ripple")}
    )
    assert (found.verdict, found.findings) == ("unknown", ()) and found.unexplained == list(
        rig.joints
    )


def test_a_platform_that_moves_is_a_finding_with_what_it_is_worth() -> None:
    """Against a model that stands."""
    size = 0.02
    rig = bundled("turret")
    rng = np.random.default_rng(2)
    clean = carried(nominal(rig), swaying(times(8.0), size), 8.0)
    assert clean.tau is not None
    log = replace(clean, tau=clean.tau + 1e-3 * rng.normal(size=clean.tau.shape))
    found = diagnose(rig, [log], {"cogging": CAUSES["cogging"]}, rng=rng)
    (one,) = found.findings
    assert one.cause == "platform-motion"
    assert one.gain["torque_rmse_after"] < 0.5 * one.gain["torque_rmse_before"]
    assert one.gain["rollout_rmse_after"] < one.gain["rollout_rmse_before"]
    rate = np.sqrt(np.mean(np.sum(swaying(times(8.0), size).w[:5_333] ** 2, axis=1)))
    assert one.parameters[0].value == pytest.approx(rate, rel=0.05)
    # The model has it from the IMU: nobody is told that it is missing, and nothing is compensated for it.
    assert (found.verdict, found.lacking, found.verdict_without_platform) == (
        "named",
        (),
        "nothing",
    )
    assert "by the platform's motion alone" in show_diagnosis(found).to_text()
    assert missed(found) == ""
    assert "missing" not in show_diagnosis(found).html


def test_without_a_cause_to_look_for_nothing_is_found() -> None:
    """A base at rest is none, though its IMU is in the log."""
    rig = bundled("turret")
    log = carried(nominal(rig), swaying(times(12.0), 0.0), 12.0)
    assert diagnose(rig, [log], {}, rng=np.random.default_rng(0)).verdict == "nothing"


def test_hidden_parameters_are_found_from_a_shaken_log_with_noise_within_their_deviations() -> None:
    """Profile S at half size, 25 s, the sensors' own noise; a model that ignores the platform is far worse."""
    rig = bundled("turret")
    true = perturbed(rig, 0.1, np.random.default_rng(1))
    t = times(25.0)
    rng = np.random.default_rng(2)
    clean = carried(true, profile_s(t, np.random.default_rng(3), size=0.5), 25.0)
    assert clean.v is not None and clean.tau is not None
    imus = {rig.base: add_imu_noise(clean.imus[rig.base], rig.config.noise, 1e-3, rng)}
    noise = [
        size * rng.standard_normal(clean.q.shape) for size in (1e-5, 2e-3, 0.01 * np.std(clean.tau))
    ]
    q, v, tau = (x + e for x, e in zip((clean.q, clean.v, clean.tau), noise))
    found = identify(
        rig, [replace(clean, q=q, v=v, tau=tau, imus=imus)], filtering=EXACT, holdout="none"
    )
    expected = given_beta(true.rig, found.reduction)
    kept = reduce_parameters(rig).independent
    hidden = [i for i, j in enumerate(found.reduction.independent) if j not in kept]
    theta = found.estimate.theta[: len(expected)]
    std = found.estimate.std[: len(expected)]
    assert len(hidden) == 6 and np.all(np.abs(theta - expected)[hidden] < 4 * std[hidden])
    large = [i for i in hidden if abs(expected[i]) > 0.1 * np.abs(expected).max()]
    assert len(large) >= 2 and np.all(np.abs(theta / expected - 1)[large] < 0.1)
    blind = identify(
        rig, [replace(clean, q=q, v=v, tau=tau, imus={})], filtering=EXACT, holdout="none"
    )
    assert blind.train.torque_rmse["pan"] > 10 * found.train.torque_rmse["pan"]


def test_a_base_that_hardly_turns_keeps_what_it_hides_as_given() -> None:
    """A rate just over the threshold shows no inertia under the torque's noise: the fit falls back, and says so."""
    rig = bundled("turret")
    t = times(10.0)
    w = np.tile([0.0, 0.0, 0.0], (len(t), 1))
    w[:, 0] = 0.04 * np.sin(5 * t)
    platform = Platform(t, np.tile([0.0, 0.0, GRAVITY], (len(t), 1)), w, 0.0 * w)
    log = carried(nominal(rig), platform, 10.0)
    tau = np.asarray(log.tau)
    noise = 0.3 * np.std(tau) * np.random.default_rng(0).standard_normal(tau.shape)
    found = identify(rig, [replace(log, tau=tau + noise)], filtering=EXACT, holdout="none")
    assert greatest_base_motion(rig, [log]) == "rotating" and found.reduction.base != "rotating"


def test_base_says_what_a_moving_base_adds() -> None:
    found = compute_base(bundled("thesis"), diagonal=True).to_dict()
    assert found["identifiable"] == 15
    for motion, count in (("tilted", 17), ("rotating", 18)):
        entry = found["moving_base"][motion]
        assert entry["identifiable"] == count == 15 + len(entry["adds"])
    assert {"spine.mx", "spine.mz + fork.my"} <= {
        entry["name"] for entry in found["moving_base"]["rotating"]["adds"]
    }


# --- the command line -------------------------------------------------------------------------------------------------


def test_simulate_shakes_the_rig_and_carries_it_along_a_log(run: Run, tmp_path: Path) -> None:
    one, again, other, along = (
        tmp_path / f"{name}.csv" for name in ("one", "again", "other", "along")
    )
    quick = tmp_path / "quick.csv"
    long = tmp_path / "long.csv"
    for path, seconds in ((quick, 1.0), (long, 1.5)):
        write_motion(fourier(bundled("turret"), 0, seconds), bundled("turret").joints, path)
    shaken = ("simulate", "turret", "--reference", quick, "--platform", "S", "--seed")
    for path, seed in ((one, 5), (again, 5), (other, 6)):
        assert run(*shaken, seed, "-o", path)[0] == 0
    assert one.read_bytes() == again.read_bytes() != other.read_bytes()
    header = one.read_text().splitlines()[0].split(",")
    columns = [
        f"{kind}_base_{axis}"
        for kind, axes in (("gyro", "xyz"), ("accel", "xyz"), ("quat", "wxyz"))
        for axis in axes
    ]
    assert header[-10:] == columns
    code, _, err = run(
        "simulate", "turret", "--reference", long, "--platform-log", one, "--imus", "-o", along
    )
    assert code == 0 and "one.csv ends after 1 s, and so does the simulation" in err
    first, second = (read_log(path, bundled("turret")) for path in (one, along))
    assert set(second.imus) == set(bundled("turret").config.imus)
    seen, copied = (
        Platform.measured(log.t, log.imus["base"], log.name, 5.0) for log in (first, second)
    )
    np.testing.assert_allclose(copied.w[200:800], seen.w[200:800], atol=2e-2)
    both = run("simulate", "turret", "--platform", "S", "--platform-log", one, "-o", along)
    refused(both, 2, "--platform: is given beside --platform-log")


def test_a_torque_that_sticks_while_the_base_moves_is_told_by_what_the_rest_of_the_log_says() -> (
    None
):
    """The base moves only while the torque is stuck: the rest of the log, taken alone, would have other columns."""
    t = times(12.0)
    rig = bundled("turret")
    moving = swaying(t)
    still = (t < 5.0) | (t > 8.0)
    platform = replace(
        moving,
        f=np.where(still[:, None], [0.0, 0.0, GRAVITY], moving.f),
        w=moving.w * ~still[:, None],
    )
    log = carried(nominal(rig), None, 12.0)
    log = replace(log, imus={rig.base: Imu(platform.w, platform.f)})
    rest = log.part(np.flatnonzero(still))
    assert classify_base_motion(rig, rest) == "fixed" != classify_base_motion(rig, log)
    assert 0.0 <= compute_denial(rig, log, 0, ~still, EXACT) < np.inf


def test_a_platform_log_without_an_accelerometer_is_refused(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "gyro.csv"
    path.write_text(
        "t,gyro_base_x,gyro_base_y,gyro_base_z\n"
        + "".join(f"{k / 100},0,0,0\n" for k in range(100))
    )
    said = run("simulate", "turret", "--platform-log", path, "-o", tmp_path / "log.csv")
    refused(said, 2, "gyro.csv: holds no gyro or no accelerometer of the base")
    with pytest.raises(LogError, match="holds 3 samples of the platform"):
        Platform.measured(np.arange(3.0), Imu(np.zeros((3, 3)), np.zeros((3, 3))), "short")


def test_a_real_platform_carries_the_rig(run: Run, tmp_path: Path) -> None:
    if not PHANTOM.is_file():
        pytest.skip(
            "shared/data/phantom4_motion/path_1.csv, a measured platform motion, is not there"
        )
    maps = [f"gyro_base_{axis}=Gyr_{axis.upper()}*pi/180" for axis in "xyz"]
    maps += [f"accel_base_{axis}=Acc_{axis.upper()}" for axis in "xyz"] + ["t=time"]
    options = [part for each in maps for part in ("--map", each)]
    path = tmp_path / "log.csv"
    moves = tmp_path / "moves.csv"
    write_motion(fourier(bundled("turret"), 0, 10.0), bundled("turret").joints, moves)
    code, _, err = run(
        "simulate", "turret", "--reference", moves, "--platform-log", PHANTOM, *options, "-o", path
    )
    assert code == 0, err
    found = result(run, "identify", "turret", path)
    assert (
        found["base_motion"] == "rotating" and min(found["held_out"]["fit_percent"].values()) > 90
    )
