"""What a motion will tell, before it is run.

The deviations of `identify` are predicted, with what a model misses and with the lag of a torque; a rate too slow,
friction that nobody states and a joint that stands are told.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.excitation import excite, predict_estimate, record_log
from gimbal_pin.identification import IdentificationResult, identify
from gimbal_pin.log import Array, Motion
from gimbal_pin.regression import LAG_DEVIATION
from tests.excitation.designs import designed
from tests.rigs import bundled

RIG = bundled("turret")
MODEL = nominal(RIG)


def thin(motion: Motion, step: int = 5) -> Motion:
    """Return every so many samples of a motion."""
    return Motion(*(x[::step] for x in (motion.t, motion.q, motion.v, motion.a)))


@cache
def repeat() -> Motion:
    """Return a motion of five periods, at 1 kHz."""
    return excite(RIG, seconds=25, periods=5, starts=1, rng=0).motion


def record(
    motion: Motion, rng: np.random.Generator, missed: Array, noise: float = 0.01
) -> IdentificationResult:
    """Return what is identified from a log whose torque holds a part more."""
    log = record_log(MODEL, motion, noise, rng)
    return identify(RIG, [replace(log, tau=log.tau + missed)], holdout="none")


def test_predicted_deviations_are_the_spread_of_what_is_identified() -> None:
    """Of 16 logs: encoders start and torques act anywhere that is presumed."""
    whole = repeat()
    motion = thin(whole)
    tau = MODEL.inverse_dynamics(whole.q, whole.v, whole.a)
    found = predict_estimate(MODEL, motion, form_error=0.0, rng=0)
    thetas = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        moved = replace(motion, q=motion.q + rng.uniform(-1e-3, 1e-3, 2))
        late = motion.t + rng.normal(motion.t[1] / 2, LAG_DEVIATION, (2, 1))
        acting = [np.interp(t, whole.t, x) - x[::5] for t, x in zip(late, tau.T)]
        thetas.append(record(moved, rng, np.transpose(acting)).estimate.theta)
    spread = np.std(thetas, axis=0, ddof=1) / found.std
    assert {*found.known} == {"known"}
    assert 0.8 < np.sqrt(np.mean(spread**2)) < 1.2
    assert 0.5 < spread.min() <= spread.max() < 1.5


def test_what_a_model_misses_is_in_the_predicted_deviations() -> None:
    """A ripple and stiction of together 3 % of each torque: `identify` errs by what was predicted."""
    rng = np.random.default_rng(0)
    motion = thin(repeat())
    found = predict_estimate(MODEL, motion, form_error=0.03, rng=0)
    tau = MODEL.inverse_dynamics(motion.q, motion.v, motion.a)
    size = 0.03 * np.sqrt(np.mean(tau**2, axis=0) / 2)
    errors = []
    for _ in range(4):
        ripple = np.sin(14 * motion.q + rng.uniform(0, 6))
        stiction = np.sign(motion.v) * np.exp(-((motion.v / 0.2) ** 2))
        missed = sum(size * part / np.std(part, axis=0) for part in (ripple, stiction))
        each = record(motion, rng, missed)
        errors.append((each.estimate.theta - found.values) / found.std)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 2
    assert np.mean(np.abs(errors) < 3) > 0.95


def test_the_model_of_a_log_predicts_what_a_second_log_of_its_motion_states() -> None:
    """Stiction near rest alone is missed: shared out over all that could be missed, it would be predicted a third."""
    motion = thin(repeat())
    tau = MODEL.inverse_dynamics(motion.q, motion.v, motion.a)
    near_rest = np.sign(motion.v) * np.exp(-((motion.v / 0.2) ** 2))
    stiction = 0.1 * np.sqrt(np.mean(tau**2, axis=0)) * near_rest
    first, second = (record(motion, np.random.default_rng(seed), stiction) for seed in (0, 1))
    ratio = predict_estimate(first.model, motion, rng=0).std / second.estimate.std
    assert ratio.min() > 0.6 and ratio.max() < 1.6


def test_friction_that_nobody_states_is_told_and_a_log_knows_it() -> None:
    bare = replace(MODEL, terms=())
    motion = thin(designed("turret", 0).motion)
    assert "pan, tilt state no friction" in predict_estimate(bare, motion, rng=0).warnings[0]
    logged = record(motion, np.random.default_rng(0), 0 * motion.q, noise=0.05)
    known = predict_estimate(logged.model, motion, rng=0)
    assert not known.frictionless
    assert known.torque_noise == pytest.approx([0.05, 0.05], rel=0.5)


def test_a_joint_held_still_shows_none_of_its_friction() -> None:
    motion = thin(designed("turret", 0).motion)
    pan = np.array([1.0, 0.0])
    held = Motion(motion.t, motion.q * pan, motion.v * pan, motion.a * pan)
    found = predict_estimate(MODEL, held, rng=0)
    said = dict(zip(found.names, found.known))
    assert said["tilt.Fs"] == said["tilt.Fv"] == "not" != said["pan.Fs"]
    assert any("tilt.Fs" in one for one in found.warnings)


def test_a_rate_too_slow_for_the_motion_is_told() -> None:
    """Twice the rate leaves less than a fifth; what it leaves is told from the error of a model's form on."""
    motion = designed("turret", 0).motion
    slow, quick = (predict_estimate(MODEL, thin(motion, step), rng=0) for step in (100, 50))
    assert all(5 * quick.sampling[joint] < share for joint, share in slow.sampling.items())
    (said,) = replace(quick, sampling={"pan": 0.02, "tilt": 0.004}).warnings
    assert "tilt" not in said


def test_more_noise_leaves_more_of_a_lag_open_as_the_log_will_tell_it() -> None:
    motion = designed("turret", 0).motion
    quiet, loud = (
        predict_estimate(MODEL, motion, torque_noise=noise, form_error=0.0, rng=0)
        for noise in (1e-3, 1e-1)
    )
    assert all(quiet.lag_std[joint] < loud.lag_std[joint] < 2.5e-3 for joint in quiet.lag_std)
    stated = record(motion, np.random.default_rng(1), 0 * motion.q, noise=0.1).model.estimated
    assert stated is not None
    np.testing.assert_allclose(list(loud.lag_std.values()), stated.lag_std, rtol=0.3)
