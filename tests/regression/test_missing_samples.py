"""Laws of a log's holes: what the motion closes is where the motion was, and nothing is ever fitted inside."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.diagnosis import gather
from gimbal_pin.diagnosis.evidence import gather_for_judgement
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import DataError
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.regression import (
    Filled,
    Filtering,
    fill_gaps,
    find_standstill,
    holes,
    inside,
    resolution,
    smooth_samples,
    split_segments,
)
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.checks.corruption import CORRUPTIONS

CUTOFF, DT = 4.0, 2e-3
STEP = 2 * np.pi / 2**12
RIG = Rig.load("turret")
MOTION = fourier(RIG, 3, 20.0, DT)
TORQUE = nominal(RIG).inverse(MOTION.q, MOTION.v, MOTION.a)
PATTERN = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 25), st.floats(0.01, 0.12))


def recorded(seed: int = 0) -> Log:
    """Encoders of twelve bits, torque noise of one per cent."""
    rng = np.random.default_rng(seed)
    noise = 0.01 * np.sqrt(np.mean(TORQUE**2, axis=0)) * rng.standard_normal(TORQUE.shape)
    q = STEP * np.round(MOTION.q / STEP + rng.uniform(size=2))
    return Log(
        "bench.csv",
        RIG.joints,
        MOTION.t,
        q,
        MOTION.v + 1e-3 * rng.standard_normal(q.shape),
        TORQUE + noise,
    )


def holed(log: Log, pattern: tuple[int, int, float]) -> Log:
    """The log without so many runs of samples, up to so many seconds each, anywhere."""
    seed, count, longest = pattern
    rng = np.random.default_rng(seed)
    kept = np.ones(len(log), bool)
    for start in rng.integers(10, len(log) - 10, count):
        kept[start : start + int(rng.uniform(0.006, longest) / DT)] = False
    kept[[0, -1]] = True
    return log.part(np.flatnonzero(kept))


@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-5, 1e-2), jitter=st.floats(0.0, 0.3))
def test_resolution_is_the_noise_whatever_the_spacing(
    seed: int, size: float, jitter: float
) -> None:
    rng = np.random.default_rng(seed)
    t = DT * (np.arange(4000) + jitter * rng.uniform(-1, 1, 4000))
    q = np.sin(3 * t)[:, None] * [1.0, 0.2] + size * rng.standard_normal((4000, 2))
    log = Log("noise", ("a", "b"), t, q)
    # A fiftieth of the samples, the wildest, is left out: of white noise that takes a sixteenth of its deviation.
    np.testing.assert_allclose(resolution(log), size, rtol=0.15)


@given(PATTERN)
def test_what_fills_a_hole_is_where_the_joint_was(pattern: tuple[int, int, float]) -> None:
    log = holed(recorded(), pattern)
    whole, closed = fill_gaps(log, CUTOFF)
    there = inside(closed, whole.t)
    assert len(whole) == len(log) + there.sum()
    np.testing.assert_array_equal(whole.q[~there], log.q)
    np.testing.assert_array_equal(whole.tau[~there], log.tau)  # type: ignore[index]
    truth = np.stack([np.interp(whole.t[there], MOTION.t, x) for x in MOTION.q.T], axis=1)
    offset = np.median(
        log.q - np.stack([np.interp(log.t, MOTION.t, x) for x in MOTION.q.T], axis=1), axis=0
    )
    # Normal noise of some hundreds of samples exceeds five deviations once in some thousand patterns.
    assert np.all(np.abs(whole.q[there] - offset - truth) < 5 * resolution(log))


@given(PATTERN)
def test_holes_that_are_long_or_in_fast_motion_stay(pattern: tuple[int, int, float]) -> None:
    """The true motion's chord misses it by no more than a few times the resolution wherever a hole is closed."""
    log = holed(recorded(), pattern)
    _, closed = fill_gaps(log, CUTOFF)
    for begin, end in closed:
        assert (end - begin) * CUTOFF <= 0.25
        a = MOTION.a[(MOTION.t >= begin) & (MOTION.t <= end)]
        assert np.all((end - begin) ** 2 / 8 * np.abs(a).max(axis=0) < 3 * resolution(log))
    open_ = holes(fill_gaps(log, CUTOFF).log, CUTOFF)
    assert len(open_) + len(closed) == len(holes(log, CUTOFF))


@given(PATTERN)
def test_nothing_is_fitted_in_a_hole(pattern: tuple[int, int, float]) -> None:
    log = holed(recorded(), pattern)
    for stretch in split_segments(log, CUTOFF, across=0.05):
        channels = smooth_samples(stretch, Filtering(), 0, stretch.length)
        if channels.lost is None:
            continue
        assert np.all(find_standstill(channels, Filtering())[channels.lost])
        k = np.clip(np.searchsorted(log.t, channels.t, side="right") - 1, 0, len(log) - 2)
        hole = np.isin(k, holes(log, CUTOFF))
        between = np.minimum(channels.t - log.t[k], log.t[k + 1] - channels.t) > 1e-9
        np.testing.assert_array_equal(channels.lost[between], hole[between])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3)
def test_closed_holes_move_no_estimate_by_more_than_its_deviation(seed: int) -> None:
    """Against a fit to the same rows of a log in which the samples of the closed holes are the true ones."""
    log = recorded(1)
    lossy = holed(log, (seed, 10, 0.045))
    closed = fill_gaps(lossy, CUTOFF).closed
    kept = log.part(np.flatnonzero(np.isin(log.t, lossy.t) | inside(closed, log.t)))
    second = identify(RIG, [lossy], holdout="none").estimate
    with patch("gimbal_pin.regression.samples.fill_gaps", lambda *_: Filled(kept, closed)):
        first = identify(RIG, [kept], holdout="none").estimate
    assert first.rows == second.rows
    assert np.all(np.abs(second.theta - first.theta) < 0.5 * first.std)


def test_a_log_without_noise_and_one_without_holes_are_left_alone() -> None:
    log = recorded()
    assert fill_gaps(log, CUTOFF).log is log
    pure = replace(log, q=MOTION.q, v=MOTION.v)
    lossy = holed(pure, (1, 20, 0.06))
    assert fill_gaps(lossy, CUTOFF).log is lossy


def test_a_log_in_shreds_is_judged_by_its_samples() -> None:
    """Bursts of samples with holes that no motion closes: no stretch to fit, and yet true samples."""
    log = recorded()
    band = Filtering(cutoff=12.0, smoothing=2.5, alignment=0.0)
    shreds = log.part(np.flatnonzero(np.arange(len(log)) % 60 < 35))
    with pytest.raises(DataError):
        gather(RIG, [shreds], band)
    found = gather_for_judgement(RIG, [shreds], band)
    for part in found.parts:
        assert part.channels.lost is not None and np.all(part.gate[part.channels.lost] == 0.0)
    assert np.all(found.used > 0.1)
    assert gather_for_judgement(RIG, [log], band).seconds == gather(RIG, [log], band).seconds


def test_lone_holes_of_a_tenth_of_a_second_still_part_a_log() -> None:
    log = CORRUPTIONS["clock"](recorded(), np.random.default_rng(0), jitter=0.0, holes=3)
    assert len(list(split_segments(log, CUTOFF))) == len(holes(log, CUTOFF)) + 1
