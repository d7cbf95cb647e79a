"""Factors of past rows: they count as the rows do, and loosening forgets along its directions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.regression import (
    Block,
    PastRows,
    fit_residual_noise,
    fit_weighted,
    loosen_prior,
    solve,
)
from tests.regression.blocks import cut, draw_block, select

NONE = PastRows.empty(2, 4)


def draw_rows(seed: int, rows: int = 120) -> Block:
    """Return rows of two joints with four parameters of one, which count in part."""
    return draw_block(np.random.default_rng(seed), rows, np.ones(4), noise=0.1, shared=True)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 79), max_size=6))
def test_past_in_any_portions_is_the_batch(seed: int, cuts: list[int]) -> None:
    rows = draw_rows(seed)
    past = NONE
    for begin, end in pairwise(sorted({0, *cuts, 80})):
        past = past.add([select(rows, slice(begin, end))])
    stream = solve([select(rows, slice(80, None))], past=past)
    batch = fit_weighted([rows])
    np.testing.assert_allclose(stream.theta, batch.theta, rtol=1e-9)
    np.testing.assert_allclose(stream.residual_std, batch.residual_std, rtol=1e-9)
    np.testing.assert_allclose(past.count, np.sum(rows.share[:80] ** 2, axis=0))
    assert stream.rows == len(rows.t)


def test_past_brings_its_own_covariance_of_the_score() -> None:
    """The covariance is that of all white rows, however few of them are still held."""
    rows = draw_rows(1, 4000)
    early = select(rows, slice(0, 3000))
    batch = fit_weighted([rows])
    noise = fit_residual_noise([early], [early.A], batch.theta, np.zeros((4, 4)), np.ones(2))
    past = NONE
    for portion in cut(early, 2):
        past = past.add([portion], noise.processes)
    np.testing.assert_allclose(past.fade(np.array([0.5, 0.9])).score[0], 0.5**2 * past.score[0])
    stream = solve([select(rows, slice(3000, None))], past=past)
    np.testing.assert_allclose(stream.std, batch.std, rtol=0.05)


def test_forgetting_weighs_each_row_by_those_after_it() -> None:
    rows = draw_rows(1)
    fade = np.array([0.5, 0.9])
    early = NONE.add([select(rows, slice(0, 60))])
    faded = early.fade(fade).add([select(rows, slice(60, None))])
    weights = np.sqrt(np.where(np.arange(120)[:, None] < 60, fade, 1.0))
    x = (np.dstack([rows.A, rows.b, rows.share]) * weights[:, :, None]).swapaxes(0, 1)
    R = faded.factors
    np.testing.assert_allclose(R.swapaxes(1, 2) @ R, x.swapaxes(1, 2) @ x, rtol=1e-9, atol=1e-12)


def test_loosening_forgets_along_its_directions_only() -> None:
    """Combinations orthogonal to them in the metric of the information keep their covariance."""
    D = np.random.default_rng(1).standard_normal((4, 2))
    known = fit_weighted([draw_rows(4)])
    U, z = np.split(loosen_prior(known.theta, known.covariance, D), [4], axis=1)
    np.testing.assert_allclose(U @ D, 0.0, atol=1e-9)
    np.testing.assert_allclose(U @ known.theta, z[:, 0], atol=1e-9)
    kept = np.linalg.svd(D.T)[2][2:]
    expected = kept @ known.covariance @ kept.T
    np.testing.assert_allclose(kept @ np.linalg.pinv(U.T @ U) @ kept.T, expected, rtol=1e-6)
