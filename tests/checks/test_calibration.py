"""IMUs on several links: what is planted in how they sit comes back, and what they cannot tell stays near zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.checks import check_log, estimate_joint_rates, estimate_mountings
from gimbal_pin.dynamics import add_imu_noise, compute_imu_readings, nominal
from gimbal_pin.identification import given_beta, identify
from gimbal_pin.log import Array, Imu, Log, Platform, profile_s
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, fourier
from tests.rigs import bundled

STEP = 2 * np.pi / 2**16
"""Angle of one encoder step, rad."""
Mountings = Mapping[str, tuple[Array, Array]]
"""Link → misalignment as a rotation vector, rad, and gyro bias, rad/s."""


@cache
def true_log(name: str, moving: bool = True) -> Log:
    """A prescribed motion on profile S at half size, or on a base that stands, with exact IMUs."""
    rig = bundled(name)
    motion = fourier(rig, 0, 10.0)
    platform = (
        profile_s(motion.t, np.random.default_rng(0), 0.5) if moving else Platform.still(motion.t)
    )
    tau = nominal(rig).inverse_dynamics(motion.q, motion.v, motion.a, platform=platform)
    imus = compute_imu_readings(rig, rig.config.imus, motion.q, motion.v, motion.a, platform)
    return Log("log", rig.joints, motion.t, motion.q, motion.v, tau, imus=imus)


def mounted(log: Log, rig: Rig) -> tuple[Log, Mountings]:
    """The log as 16 bit and noisy IMUs see it that sit askew by degrees, biased by half a degree a second; and how.

    It has no joint rates.
    """
    rng = np.random.default_rng(1)
    planted = {link: (rng.normal(0, 0.035, 3), rng.normal(0, 0.01, 3)) for link in rig.config.imus}
    imus = {}
    for link, (turn, bias) in planted.items():
        imu = add_imu_noise(log.imus[link], rig.config.noise, log.dt, rng)
        M = pin.exp3(turn)
        assert imu.gyro is not None and imu.accel is not None
        imus[link] = Imu(imu.gyro @ M + bias, imu.accel @ M, imu.quat)
    return replace(log, q=np.round(log.q / STEP) * STEP, v=None, imus=imus), planted


@pytest.mark.parametrize("name", ["turret", "thesis"])
def test_planted_misalignment_and_bias_come_back_within_their_deviations(name: str) -> None:
    rig = bundled(name)
    log, planted = mounted(true_log(name), rig)
    found = estimate_mountings(rig, log)
    assert set(found) == set(planted)
    for link, (turn, bias) in planted.items():
        error = np.concatenate([found[link].misalignment - turn, found[link].bias - bias])
        assert np.all(np.abs(error) < 5 * found[link].std), link
        assert np.all(np.abs(error) < 2e-3)
        assert not found[link].contradicts
    last = found[rig.config.imus[-1]]
    assert last.after < 0.1 * last.before


@settings(max_examples=4)
@given(st.integers(0, 4000))
def test_exact_gyros_are_exact_joint_rates_and_need_no_mounting(start: int) -> None:
    rig = bundled("turret")
    part = true_log("turret").part(slice(start, start + 2000))
    np.testing.assert_allclose(estimate_joint_rates(rig, replace(part, v=None)), part.v, atol=1e-12)
    for mounting in estimate_mountings(rig, part).values():
        assert np.all(np.abs([*mounting.misalignment, *mounting.bias]) < 3 * mounting.std)


def test_what_a_standing_base_hides_stays_as_it_is() -> None:
    """A base that does not turn says nothing of how its IMU is turned; the links' are found all the same."""
    rig = bundled("turret")
    log, planted = mounted(true_log("turret", moving=False), rig)
    found = estimate_mountings(rig, log)
    link = rig.config.imus[1]
    assert not np.any(found[rig.base].misalignment)
    assert found[rig.base].std[:3].min() == 0.1
    assert np.abs(found[link].misalignment - planted[link][0]).max() < 2e-3


def test_identification_from_imus_that_sit_askew_is_better_than_from_the_bases_alone() -> None:
    rig = bundled("turret")
    log, _ = mounted(true_log("turret"), rig)
    blind = replace(log, imus={rig.base: log.imus[rig.base]})
    found, worse = (identify(rig, [x], filtering=EXACT, holdout="none") for x in (log, blind))
    true = given_beta(rig, found.reduction)
    errors = [np.abs(one.estimate.theta[: len(true)] - true).max() for one in (found, worse)]
    assert errors[0] < 0.03 * np.abs(true).max()
    assert errors[0] < 0.2 * errors[1]
    assert set(found.mountings["log"]) == set(rig.config.imus)
    assert not worse.mountings


def test_a_gyro_of_another_motion_is_left_out_and_an_event_says_so() -> None:
    rig = bundled("thesis")
    log = true_log("thesis")
    spine = log.imus["spine"]
    broken = replace(log, imus={**log.imus, "spine": Imu(spine.gyro[::-1], spine.accel)})
    found = check_log(rig, replace(broken, v=None))
    gone = [one.channel for one in found.alterations if one.cause == "contradicting-gyro"]
    assert gone == ["gyro_spine", "accel_spine"]
    assert set(found.log.imus) == {"head", "cradle"}
    # With the roll at a quarter turn the cradle's gyro alone hides a rate.
    clear = np.abs(np.cos(log.q[:, 1])) > 0.3
    assert np.abs(found.log.v - log.v)[clear].max() < 0.05


def test_a_log_without_imus_on_its_links_is_left_as_it_is() -> None:
    log = true_log("turret")
    for imus in ({}, {"base": log.imus["base"]}):
        bare = replace(log, v=None, imus=imus)
        found = check_log(bundled("turret"), bare)
        assert not found.mountings and found.log is bare
