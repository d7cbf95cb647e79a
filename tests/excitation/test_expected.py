"""What a motion will tell, before it is run: the deviations of `identify`, and what a rate costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import LogError
from gimbal_pin.excitation import ExpectedEstimate, excite, predict_estimate, record_log
from gimbal_pin.identification import Identified, identify
from gimbal_pin.log import Motion
from gimbal_pin.regression import LAG_DEVIATION, Filtering
from gimbal_pin.rig import Rig
from tests.excitation.designs import RIGS, designed


def thinned(motion: Motion, step: int) -> Motion:
    return Motion(*(x[::step] for x in (motion.t, motion.q, motion.v, motion.a)))


def expected(name: str, step: int = 5, **options: float) -> ExpectedEstimate:
    return predict_estimate(
        nominal(Rig.load(name)), thinned(designed(name, 0).motion, step), rng=0, **options
    )


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_predicted_deviations_are_the_spread_of_what_is_identified(name: str) -> None:
    """Of 60 logs, whose spread has a deviation of 9 %: of 20 it has 16 %. An encoder starts anywhere, and a
    torque acts as late as is presumed of it.
    """
    rig = Rig.load(name)
    whole = excite(rig, seconds=25, periods=5, starts=1, rng=0).motion
    motion = thinned(whole, 5)
    tau = nominal(rig).inverse(whole.q, whole.v, whole.a)
    found = predict_estimate(nominal(rig), motion, form_error=0.0, rng=0)
    thetas = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        moved = replace(motion, q=motion.q + rng.uniform(-1e-3, 1e-3, rig.n))
        log = record_log(nominal(rig), moved, 0.01, rng)
        when = rng.normal(motion.t[1] / 2, LAG_DEVIATION, rig.n)
        acting = [
            np.interp(motion.t + late, whole.t, x) - np.interp(motion.t, whole.t, x)
            for late, x in zip(when, tau.T)
        ]
        each = identify(rig, [replace(log, tau=log.tau + np.transpose(acting))], holdout="none")
        assert each.names == found.names
        thetas.append(each.estimate.theta)
    shown = np.array([said == "known" for said in found.known])
    ratio = (found.std / np.std(thetas, axis=0, ddof=1))[shown]
    assert shown.sum() > 0.8 * len(shown)
    assert 0.7 < np.median(ratio) < 1.5 and np.mean((ratio > 0.7) & (ratio < 1.5)) >= 0.9


def test_twice_the_noise_is_twice_the_deviation() -> None:
    """Of exact angles and rates, and as long as it is the log that says when the torque acts."""
    rig = Rig.load("turret")
    motion = thinned(designed("turret", 0).motion, 5)
    noise = replace(rig.config.noise, gyro=0.0)
    motors = [replace(motor, encoder_bits=None) for motor in rig.motors]
    exact = nominal(replace(rig, config=replace(rig.config, noise=noise), motors=tuple(motors)))
    once, twice = (
        predict_estimate(exact, motion, torque_noise=share, form_error=0.0, rng=0).std
        for share in (5e-4, 1e-3)
    )
    assert twice == pytest.approx(2 * once, rel=0.05)


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_what_a_model_misses_is_in_the_predicted_deviations(name: str) -> None:
    """A ripple, a spring and stiction of together 3 % of each torque: `identify` errs by what was predicted."""
    rig = Rig.load(name)
    rng = np.random.default_rng(0)
    motion = thinned(excite(rig, seconds=25, periods=5, starts=1, rng=0).motion, 5)
    found = predict_estimate(nominal(rig), motion, form_error=0.03, rng=0)
    errors = []
    for _ in range(12):
        log = record_log(nominal(rig), motion, 0.01, rng)
        size = np.sqrt(np.mean(log.tau**2, axis=0))
        q = motion.q
        v = motion.v
        parts = (
            np.sin(14 * q + rng.uniform(0, 6)),
            np.tanh(3 * (q - q.mean(axis=0))),
            np.sign(v) * np.exp(-((v / 0.2) ** 2)),
        )
        missed = sum(
            rng.choice([-1, 1], rig.n) * part / np.std(part, axis=0) for part in parts
        ) / np.sqrt(3)
        each = identify(rig, [replace(log, tau=log.tau + 0.03 * size * missed)], holdout="none")
        errors.append((each.estimate.theta - found.values) / found.std)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 2
    assert np.mean(np.abs(errors) < 3) > 0.95


def test_the_model_of_a_log_predicts_what_a_second_log_of_its_motion_states() -> None:
    """Stiction near rest alone is missed: shared out over all that could be missed, it would be predicted a third."""
    rig = Rig.load("turret")
    motion = thinned(excite(rig, seconds=25, periods=5, starts=1, rng=0).motion, 5)

    def record(seed: int) -> Identified:
        log = record_log(nominal(rig), motion, 0.01, np.random.default_rng(seed))
        size = np.sqrt(np.mean(log.tau**2, axis=0))
        stiction = 0.1 * size * np.sign(motion.v) * np.exp(-((motion.v / 0.2) ** 2))
        return identify(rig, [replace(log, tau=log.tau + stiction)], holdout="none")

    ratio = predict_estimate(record(0).model, motion, rng=0).std / record(1).estimate.std
    assert ratio.min() > 0.6 and ratio.max() < 1.6


def test_friction_that_nobody_states_is_told() -> None:
    """The deviations are shares of a torque that lacks it; the model of a log knows its friction, noise and misfit."""
    bare = nominal(Rig.load("turret"))
    motion = thinned(designed("turret", 0).motion, 5)
    bare = replace(bare, terms=())
    assert any(
        "pan, tilt state no friction" in one
        for one in predict_estimate(bare, motion, rng=0).warnings
    )
    log = record_log(nominal(bare.rig), motion, 0.05, np.random.default_rng(0))
    known = predict_estimate(identify(bare.rig, [log], holdout="none").model, motion, rng=0)
    assert not known.frictionless
    assert known.torque_noise == pytest.approx([0.05, 0.05], rel=0.5)


def test_a_joint_held_still_shows_none_of_its_friction() -> None:
    rig = Rig.load("turret")
    motion = thinned(designed("turret", 0).motion, 5)
    q, v, a = (x.copy() for x in (motion.q, motion.v, motion.a))
    q[:, 1], v[:, 1], a[:, 1] = 0.0, 0.0, 0.0
    found = predict_estimate(nominal(rig), Motion(motion.t, q, v, a), rng=0)
    said = dict(zip(found.names, found.known))
    assert said["tilt.Fs"] == said["tilt.Fv"] == "not" and said["pan.Fs"] == "known"
    assert any("tilt.Fs" in one for one in found.warnings)


def predict_swing(hz: float, rate: float) -> ExpectedEstimate:
    """What is to be expected of 20 s of two swings of each joint, the slower of the first at `hz`."""
    t = np.arange(0, 20, 1 / rate)
    w = 2 * np.pi * hz * np.array([1.0, 1.3])
    swings = [(0.3, w, np.outer(t, w)), (0.15, 2.6 * w, 1 + np.outer(t, 2.6 * w))]
    q, v, a = (
        sum(size * u**order * way(angle) for size, u, angle in swings)
        for order, way in enumerate((np.sin, np.cos, lambda x: -np.sin(x)))
    )
    return predict_estimate(nominal(Rig.load("turret")), Motion(t, q, v, a), rng=0)


def test_a_rate_too_slow_for_the_motion_is_told() -> None:
    """Twice the rate leaves less than a fifth; what it leaves is told from the error of a model's form on."""
    slow, quick = (predict_swing(0.3, rate) for rate in (10, 20))
    assert (
        all(5 * quick.sampling[joint] < share for joint, share in slow.sampling.items())
        and not quick.warnings
    )
    (said,) = replace(slow, sampling={"pan": 0.02, "tilt": 0.004}).warnings
    assert (
        "10 samples per second are too few" in said
        and "2 % of pan's" in said
        and "tilt" not in said
    )
    assert any("leaves no trace" in one for one in predict_swing(1.5, 20).warnings)
    assert not predict_swing(1.5, 160).warnings


def test_the_deviations_hold_a_lag_as_the_log_will_tell_it() -> None:
    """More noise leaves more of it open, and of the viscous friction that it looks like."""
    quiet, loud = (
        expected("turret", 1, torque_noise=noise, form_error=0.0) for noise in (1e-3, 1e-1)
    )
    assert all(quiet.lag_std[joint] < loud.lag_std[joint] < 2.5e-3 for joint in quiet.lag_std)
    log = record_log(
        nominal(Rig.load("turret")),
        designed("turret", 0).sample(1000),
        1e-1,
        np.random.default_rng(1),
    )
    stated = identify(Rig.load("turret"), [replace(log, t=log.t)], holdout="none").model.estimated
    assert stated is not None
    np.testing.assert_allclose(list(loud.lag_std.values()), stated.lag_std, rtol=0.3)


def test_a_motion_too_short_for_a_row_shows_nothing() -> None:
    motion = designed("turret", 0).motion
    short = Motion(*(x[:300] for x in (motion.t, motion.q, motion.v, motion.a)))
    found = predict_estimate(nominal(Rig.load("turret")), short, rng=0)
    assert set(found.known) == {"not"} and set(found.to_dict()["lag_std"].values()) == {None}


@pytest.mark.parametrize("name", RIGS)
def test_the_log_of_a_first_motion_tells_which_torque_has_the_wrong_sign(name: str) -> None:
    rig = Rig.load(name)
    motion = excite(rig, seconds=25, periods=5, starts=1, rng=0, first=True).motion
    log = record_log(nominal(rig), thinned(motion, 5), 0.01, np.random.default_rng(0))
    assert identify(rig, [log], holdout="none", filtering=Filtering(alignment=0.0)).names
    for j, joint in enumerate(rig.joints):
        signs = np.where(np.arange(rig.n) == j, -1.0, 1.0)
        for verb in (identify, diagnose):
            with pytest.raises(LogError, match=f"tau_{joint} has the wrong sign"):
                verb(rig, [replace(log, tau=log.tau * signs)])
