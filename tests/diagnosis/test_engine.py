"""The engine: noise from the data, discrepancy, one criterion (DIAGNOSIS, *The engine*)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gimbal_pin.diagnosis import BAND, Evidence, Explained, explain, gather
from gimbal_pin.diagnosis.engine.criterion import by_block, criterion, vuong, without
from gimbal_pin.diagnosis.engine.discrepancy import lack_of_fit, principal, unit, unseen
from gimbal_pin.diagnosis.engine.noise import exponential, flat, smooth, whitened
from gimbal_pin.diagnosis.evidence import later
from gimbal_pin.dynamics import nominal, reduce
from gimbal_pin.effects import CAUSES, Cause, Delay
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier

RIG = "turret"
DT = 4e-3
PHI = 0.97
"""Of noise with a corner of 1.2 Hz at 250 samples a second: all of it within the motion's band."""
KINDS = {name: CAUSES[name] for name in ("cogging", "torque-bias", "asymmetric-friction", "stribeck", "actuator-lag")}


def coloured_noise(shape: tuple[int, int], seed: int) -> Array:
    """AR(1) noise of unit power."""
    white = np.random.default_rng(seed).standard_normal(shape)
    return np.asarray(lfilter([np.sqrt(1 - PHI**2)], [1, -PHI], white, axis=0))


def log_of(size: float = 0.0, seed: int = 1, noise: float = 0.02, seconds: float = 24.0) -> Log:
    """A motion with the torque that it takes, coloured noise, and cogging of that size at the first joint."""
    rig = Rig.load(RIG)
    motion = fourier(rig, seed, seconds, DT)
    tau = nominal(rig).inverse(motion.q, motion.v, motion.a)
    tau = tau + noise * np.std(tau, axis=0) * coloured_noise(tau.shape, seed)
    tau[:, 0] += size * np.sin(11 * motion.q[:, 0] + 0.3)
    return Log("log", rig.joints, motion.t, motion.q, motion.v, tau)


def evidence_of(log: Log, alignment: float = 0.0) -> Evidence:
    return gather(Rig.load(RIG), [log], replace(BAND, alignment=alignment), {"log": 0.0})


def explain_log(log: Log, kinds: Mapping[str, type[Cause]] = KINDS) -> Explained:
    return explain(evidence_of(log), reduce(Rig.load(RIG)), kinds)


@cache
def explained(size: float = 0.0, seed: int = 1) -> Explained:
    return explain_log(log_of(size, seed))


def test_rows_are_whitened_anew_as_from_the_log() -> None:
    """What `rewhiten` makes of another whitener's rows is what its own makes of the log: one joint's or all."""
    plain = flat(evidence_of(log_of()))
    shape = plain.parts[0].whitener.shape
    other = whitened(plain, [np.random.default_rng(0).uniform(0.1, 10.0, shape) for _ in plain.parts])
    signals = [part.channels.tau[:, 1] for part in plain.parts]
    assert np.allclose(other.rewhiten(plain.whiten(signals, 1), plain, 1), other.whiten(signals, 1))
    every = [part.channels.tau for part in plain.parts]
    assert np.allclose(other.rewhiten(plain.whiten_all(every), plain, None), other.whiten_all(every))


@pytest.mark.parametrize("columns", [30, 300])
def test_a_ridge_predicts_each_fold_from_the_others(columns: int) -> None:
    """As a ridge over the columns themselves, fold by fold, by least squares on more rows; narrow and wide."""
    rng = np.random.default_rng(3)
    A, X, y = rng.standard_normal((200, 3)), rng.standard_normal((200, columns)), rng.standard_normal(200)
    block, ridge = np.arange(200) // 10, 0.1
    found = unseen(A, X, y, block, (ridge,))
    Z = np.hstack([unit(A), unit(X)])
    root = np.sqrt(np.repeat([1e-9, ridge], [3, columns]) * 200)
    for k in range(10):
        rows = block % 10 == k
        stacked, target = np.vstack([Z[~rows], np.diag(root)]), np.concatenate([y[~rows], np.zeros(len(root))])
        by_hand = y[rows] - Z[rows] @ np.linalg.lstsq(stacked, target, rcond=None)[0]
        assert np.allclose(found[rows], by_hand, atol=1e-2 * np.std(y))
    directions, power = principal(X, 1e-9)
    assert np.allclose((directions * power) @ directions.T, X @ X.T)
    assert np.allclose(directions.T @ directions, np.eye(len(power)))


@pytest.mark.parametrize("seed", [0, 1])
def test_what_a_spring_takes_off_the_noise_of_an_acceleration_is_no_spring(seed: int) -> None:
    """A slow motion whose rates are noisy, and nothing in it: a spring would smooth what is known of the motion."""
    rig, rng, t = Rig.load(RIG), np.random.default_rng(seed), DT * np.arange(5000)
    w, size = np.array([[1.38, 2.28], [2.62, 3.2]])[:, None], np.array([0.125, 0.0875])
    phase = t[:, None] * w
    q, v, a = (np.sum(size * x, axis=0) for x in (np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)))
    tau = nominal(rig).inverse(q, v, a) + 3e-3 * rng.standard_normal(q.shape)
    q, v = (x + std * rng.standard_normal(x.shape) for x, std in ((q, 1e-5), (v, 1e-3)))
    assert not explain_log(
        Log("log", rig.joints, t, q, v, tau), {"joint-flexibility": CAUSES["joint-flexibility"]}
    ).state.causes


def test_a_noise_is_smoothed_to_its_spectrum_and_a_line_stays_out() -> None:
    rng = np.random.default_rng(5)
    true = 1.0 / (1.0 + (np.arange(2000) / 300.0) ** 2)
    power = true * rng.exponential(size=2000)
    found = smooth(power, exponential)
    assert np.sqrt(np.mean(np.log(found[20:] / true[20:]) ** 2)) < 0.2
    power[700] *= 1e4
    assert abs(np.log(smooth(power, exponential)[700] / found[700])) < 0.1


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_within_the_motions_band_is_no_cause(seed: int) -> None:
    """It is whitened to about one, nothing is named, and δ predicts nothing of it."""
    found = explained(seed=seed)
    assert not found.state.causes
    assert np.all((found.first.fit.dispersion > 0.5) & (found.first.fit.dispersion < 1.3))
    assert all(lack.share < 0.1 for lack in found.before)


def test_what_is_planted_is_found_and_explains_what_was_there() -> None:
    found = explained(0.01)
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("cogging", Rig.load(RIG).joints[0])
    assert found.before[0].share > 0.3 and found.after[0].share < 0.1 and found.left(0) < 0.1
    less = without(found.state, cause)
    assert criterion(less) - criterion(found.state) > found.search.threshold
    assert vuong(by_block(found.state, less)) > 2.0 and vuong(by_block(found.state, found.state)) == 0.0
    assert all(rival.parted(found.search.threshold) for rival in found.rivals[0])
    assert found.final.causes == (cause,) and not any(found.structured)


def test_what_no_candidate_explains_is_left_and_seen() -> None:
    """Cogging, where nobody looks for it: nothing is named for most of it, and δ says that there is structure."""
    kinds = {name: kind for name, kind in KINDS.items() if name != "cogging"}
    found = explain_log(log_of(0.01), kinds)
    assert found.after[0].share > 0.3 and found.left(0) > 0.5
    assert found.structured == (True, False)
    assert all(cause.place != Rig.load(RIG).joints[0] for cause in found.final.causes)


def test_lack_of_fit_is_of_each_joint() -> None:
    found = explained(0.01)
    assert lack_of_fit(found.first, 1).share < 0.1 < lack_of_fit(found.first, 0).share


def retimed_log(log: Log, late: Sequence[float]) -> Log:
    """Return a log whose torques were reported so much later than they acted."""
    assert log.tau is not None
    shifted = [np.interp(log.t - by, log.t, tau) for by, tau in zip(late, log.tau.T)]
    return replace(log, tau=np.stack(shifted, axis=1))


@pytest.mark.parametrize("late", [(-4e-3, -4e-3), (3e-3, -1e-3)])
def test_each_torques_time_is_estimated_and_is_no_finding(late: tuple[float, float]) -> None:
    """Torques that are reported some milliseconds apart are aligned to a fifth of one, and cogging stays cogging."""
    found = explain_log(retimed_log(log_of(0.01, 3, noise=0.002), late))
    assert found.alignment == pytest.approx(-np.array(late), abs=2e-4)
    assert [cause.name for cause in found.state.causes] == ["cogging"]


def test_a_drives_delay_is_a_cause_with_all_of_its_time() -> None:
    """15 ms are no shift of channels: they are named, and not 5 ms less than they are."""
    found = explain_log(retimed_log(log_of(0.0, 3, noise=0.002), (0.0, -15e-3)), {**KINDS, "delay": CAUSES["delay"]})
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("delay", Rig.load(RIG).joints[1])
    assert isinstance(cause, Delay) and cause.time == pytest.approx(15e-3, abs=5e-4)
    assert found.alignment[1] == 0.0


@given(by=st.floats(-5e-3, 5e-3), slope=st.floats(-5, 5), level=st.floats(-5, 5))
def test_a_signal_acts_later(by: float, slope: float, level: float) -> None:
    """A line exactly, and a wave within the band."""
    t = 8e-3 * np.arange(600)
    np.testing.assert_allclose(later(slope * t + level, by, 8e-3), slope * (t - by) + level, atol=1e-9)
    wave = np.sin(2 * np.pi * 7.0 * t)
    np.testing.assert_allclose(later(wave, by, 8e-3)[60:-60], np.sin(2 * np.pi * 7.0 * (t - by))[60:-60], atol=5e-3)
