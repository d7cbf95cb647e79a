"""Laws of a log's holes: closed where the motion shows what was there, and fitted nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import nominal
from gimbal_pin.log import Array, Log
from gimbal_pin.regression import (
    Filtering,
    fill_gaps,
    find_standstill,
    holes,
    inside,
    resolution,
    smooth_samples,
    split_segments,
)
from tests.bench_logs import fourier, prescribed
from tests.rigs import bundled

CUTOFF = 4.0
DT = 2e-3
STEP = 2 * np.pi / 2**14
RIG = bundled("turret")
MOTION = fourier(RIG, 3, 20.0, DT)
CLEAN = prescribed(nominal(RIG), 3, 20.0, torque_noise=0.01, dt=DT)
LOG = replace(
    CLEAN,
    q=STEP * np.round(CLEAN.q / STEP + [0.2, 0.7]),
    v=MOTION.v + 1e-3 * np.random.default_rng(0).standard_normal(MOTION.v.shape),
)
"""Encoders of 14 bits and torque noise of one per cent."""
SEEDS = st.integers(0, 2**32 - 1)


def pierce(log: Log, seed: int) -> Log:
    """Return the log without some runs of samples, of 6 to 120 ms, anywhere."""
    rng = np.random.default_rng(seed)
    kept = np.ones(len(log), bool)
    longest = rng.uniform(5, 60)
    for start in rng.integers(10, len(log) - 10, rng.integers(1, 25)):
        kept[start : start + int(rng.uniform(3, longest))] = False
    kept[[0, -1]] = True
    return log.part(np.flatnonzero(kept))


def find_truth(t: Array, channel: Array) -> Array:
    """Return what the motion was at some times."""
    return np.stack([np.interp(t, MOTION.t, x) for x in channel.T], axis=1)


def test_resolution_is_the_noise_whatever_the_spacing() -> None:
    rng = np.random.default_rng(0)
    size = np.array([1e-5, 1e-2])
    t = DT * (np.arange(4000) + 0.3 * rng.uniform(-1, 1, 4000))
    q = np.sin(3 * t)[:, None] * [1.0, 0.2] + size * rng.standard_normal((4000, 2))
    np.testing.assert_allclose(resolution(Log("noise", ("a", "b"), t, q)), size, rtol=0.15)


@given(SEEDS)
def test_closed_holes_hold_the_true_motion_and_the_others_stay(seed: int) -> None:
    """No chord over a closed hole is further from the motion than some resolutions."""
    log = pierce(LOG, seed)
    whole, closed = fill_gaps(log, CUTOFF)
    there = inside(closed, whole.t)
    np.testing.assert_array_equal(whole.q[~there], log.q)
    np.testing.assert_array_equal(np.asarray(whole.tau)[~there], log.tau)
    offset = np.median(log.q - find_truth(log.t, MOTION.q), axis=0)
    error = np.abs(whole.q[there] - offset - find_truth(whole.t[there], MOTION.q))
    assert np.all(error < 5 * resolution(log))
    np.testing.assert_allclose(whole.v[there], find_truth(whole.t[there], MOTION.v), atol=0.05)
    assert len(holes(whole, CUTOFF)) + len(closed) == len(holes(log, CUTOFF))
    for begin, end in closed:
        a = np.abs(MOTION.a[(MOTION.t >= begin) & (MOTION.t <= end)]).max(axis=0)
        assert np.all((end - begin) ** 2 / 8 * a < 3 * resolution(log))


@given(SEEDS)
def test_nothing_is_fitted_in_a_hole(seed: int) -> None:
    log = pierce(LOG, seed)
    for segment in split_segments(log, CUTOFF, across=0.05):
        channels = smooth_samples(segment, Filtering(), 0, segment.length)
        if channels.lost is None:
            continue
        still = find_standstill(channels, Filtering())
        assert np.all(still[:-1][channels.lost[1:]])
        assert np.all(still[1:][channels.lost[:-1]])
        k = np.clip(np.searchsorted(log.t, channels.t, side="right") - 1, 0, len(log) - 2)
        between = np.minimum(channels.t - log.t[k], log.t[k + 1] - channels.t) > 1e-9
        in_hole = np.isin(k, holes(log, CUTOFF))
        np.testing.assert_array_equal(channels.lost[between], in_hole[between])


def test_logs_without_noise_or_without_holes_stay_as_they_are() -> None:
    for log in (LOG, pierce(replace(LOG, q=MOTION.q, v=MOTION.v), 1)):
        assert fill_gaps(log, CUTOFF).log is log
