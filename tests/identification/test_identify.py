"""Identification: planted parameters come back within their deviations; unseen ones are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.control import bench_run
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import DataError, GimbalPinError, LogError, UsageError
from gimbal_pin.identification import (
    ESTIMATORS,
    identify,
    keep_held_out_accuracy,
    split_logs,
)
from gimbal_pin.log import Log
from gimbal_pin.regression import subsample_log
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed, true_theta
from tests.identification.logs import hold
from tests.rigs import bundled, chain

TURRET = bundled("turret")
CLEAN = prescribed(nominal(TURRET), seconds=12.0)
NOISY = prescribed(nominal(TURRET), seconds=12.0, torque_noise=0.01, dt=2e-3)


@pytest.mark.parametrize(
    ("rig", "seconds"), [(bundled("thesis"), 12.0), (TURRET, 12.0), (chain(12), 8.0)]
)
def test_log_without_noise_gives_the_parameters_back(rig: Rig, seconds: float) -> None:
    log = prescribed(nominal(rig), seconds=seconds, dt=2e-3)
    found = identify(rig, [log], filtering=EXACT, holdout="none")
    planted = true_theta(rig)
    scale = np.abs(planted).max()
    np.testing.assert_allclose(found.estimate.theta, planted, atol=1e-5 * scale)
    np.testing.assert_allclose(found.stated, planted, atol=1e-9 * scale)
    assert min(found.train.fit_percent.values()) > 99.5


@pytest.mark.parametrize("name", ESTIMATORS)
def test_estimators_agree_without_noise_and_know_a_stated_rotor(name: str) -> None:
    """Output error sees the jumps of a torque between two samples, up to a sample off."""
    motors = tuple(replace(motor, gear_ratio=6.0, rotor_inertia=2e-4) for motor in TURRET.motors)
    geared = replace(TURRET, motors=motors)
    log = prescribed(nominal(geared), 1, seconds=8.0, dt=2e-3)
    found = identify(geared, [log], estimator=ESTIMATORS[name], filtering=EXACT)
    planted = true_theta(geared)
    near = 1e-3 if name == "output-error" else 1e-4
    np.testing.assert_allclose(found.estimate.theta, planted, atol=near * np.abs(planted).max())
    assert found.estimate.method == name
    np.testing.assert_allclose(found.model.rig.armature, 6.0**2 * 2e-4)
    assert not found.model.armature.any()


def test_motion_to_and_fro_keeps_its_turns() -> None:
    """A rate that turns every few periods of the filter accelerates most where it turns."""
    w = 2 * np.pi * np.array([1.1, 1.4])
    t = 1e-3 * np.arange(12000)[:, None]
    q = 0.3 * np.sin(w * t)
    v = 0.3 * w * np.cos(w * t)
    tau = nominal(TURRET).inverse(q, v, -(w**2) * q)
    tau += 0.01 * np.std(tau, axis=0) * np.random.default_rng(0).standard_normal(tau.shape)
    found = identify(TURRET, [Log("fast", TURRET.joints, t[:, 0], q, v, tau)], filtering=EXACT)
    assert min(found.train.used.values()) > 0.6
    assert found.held_out is not None
    assert min(found.held_out.fit_percent.values()) > 99.0


def test_deviations_are_calibrated() -> None:
    z = []
    for seed in range(8):
        log = prescribed(nominal(TURRET), seed, 12.0, torque_noise=0.02, dt=0.004)
        found = identify(TURRET, [log], filtering=EXACT, holdout="none").estimate
        z.append((found.theta - true_theta(TURRET)) / found.std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.abs(z).max() < 4.5


def test_simulated_sensors_leave_the_errors_within_their_deviations() -> None:
    rig = bundled("thesis", "zoom-lens")
    found = identify(rig, [bench_run(nominal(rig), rng=1, seconds=12)])
    assert np.all(np.abs(found.estimate.theta - true_theta(rig)) < 4 * found.estimate.std)
    assert found.held_out is not None
    assert min(found.held_out.fit_percent.values()) > 95


DRONE = bundled("drone")
LOUD = prescribed(nominal(DRONE), 1, 6.0, dt=4e-3)
SHAKEN = 0.05 * np.random.default_rng(0).standard_normal(CLEAN.q.shape)
REFUSED: dict[str, tuple[Rig, Log, type[GimbalPinError], str]] = {
    "joint at rest": (TURRET, hold(TURRET, NOISY, 1), DataError, "tilt"),
    "two samples": (TURRET, CLEAN.part(slice(0, 2)), DataError, "more"),
    "third of a second": (TURRET, CLEAN.part(slice(0, 300)), DataError, "more"),
    "no torque": (TURRET, replace(CLEAN, tau=None), UsageError, "tau_<joint>"),
    "noisy angles": (
        TURRET,
        replace(CLEAN, q=CLEAN.q + SHAKEN, v=None),
        DataError,
        "rate's noise.*finer angles",
    ),
    "mN m": (
        DRONE,
        replace(LOUD, tau=1000 * np.asarray(LOUD.tau)),
        LogError,
        r"--map 'tau_yaw=tau_yaw\*0.001'",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_logs_that_show_too_little_are_refused(kind: str) -> None:
    rig, log, error, words = REFUSED[kind]
    with pytest.raises(error, match=words) as caught:
        identify(rig, [log], filtering=EXACT)
    assert "\n" not in str(caught.value)


def test_held_out_part_is_last_in_time() -> None:
    (train,), (test,), how = split_logs([CLEAN], None, EXACT)
    assert how == "last third"
    assert len(train) == pytest.approx(2 / 3 * len(CLEAN), rel=1e-3)
    np.testing.assert_array_equal(np.append(train.t, test.t), CLEAN.t)
    for asked, how in ((None, "log 3 of 3"), ("log:1", "log 1 of 3")):
        assert split_logs([CLEAN] * 3, asked, EXACT)[2] == how
    assert split_logs([CLEAN], "none", EXACT)[1] == ()
    for wrong in ("log:4", "log:0", "half"):
        with pytest.raises(UsageError):
            split_logs([CLEAN] * 3, wrong, EXACT)


def test_refit_learns_from_all_and_keeps_the_held_out_accuracy() -> None:
    logs = [prescribed(nominal(TURRET), seed, 8.0, 0.05, 4e-3) for seed in (1, 2)]
    held, whole = (identify(TURRET, logs, filtering=EXACT, holdout=how) for how in (None, "none"))
    final = keep_held_out_accuracy(held, whole)
    np.testing.assert_array_equal(final.estimate.theta, whole.estimate.theta)
    assert final.held_out == held.held_out is not None
    assert np.median(final.estimate.std / held.estimate.std) < 0.9


def test_friction_that_drives_is_warned_of() -> None:
    driven = replace(TURRET, friction=-TURRET.friction)
    log = prescribed(nominal(driven), torque_noise=0.01, dt=4e-3)
    found = identify(TURRET, [log], filtering=EXACT)
    warned = [said.split(" is negative")[0] for said in found.warnings]
    assert warned == [name for name in found.names if name.endswith((".Fs", ".Fv"))]
    assert identify(TURRET, [NOISY], filtering=EXACT).warnings == ()


@pytest.mark.parametrize(("count", "length", "samples"), [(2, 80, 321), (9, 500, 31_000)])
def test_excerpt_stands_for_the_whole_log(count: int, length: int, samples: int) -> None:
    """Segments in order, as long as asked, evenly over the log with both ends."""
    t = 0.005 * np.arange(samples)
    log = Log("even", ("a",), t, t[:, None])
    found = subsample_log(log, count * length * 0.005, count).log
    rows = np.round(found.t / 0.005).astype(int).reshape(count, length)
    np.testing.assert_array_equal(np.diff(rows), 1)
    assert (rows[0, 0], rows[-1, -1]) == (0, samples - 1)
    assert np.ptp(rows[1:, 0] - rows[:-1, -1]) <= 1
    assert subsample_log(log, samples * 0.005, count).log is log
