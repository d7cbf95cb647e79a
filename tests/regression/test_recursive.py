"""Rows that are not held any longer count as if they were, and what is loosened is forgotten alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.regression import (
    Block,
    PastRows,
    fit_residual_noise,
    fit_weighted,
    loosen_prior,
    solve,
)


def draw_rows(seed: int, rows: int = 120) -> Block:
    """Rows of two joints with four parameters of one and noise."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((rows, 2, 4))
    share = rng.uniform(0.2, 1.0, (rows, 2))
    b = A.sum(axis=2) + 0.1 * rng.standard_normal((rows, 2))
    nowhere = np.zeros((rows, 2))
    return Block(
        0.1 * np.arange(rows),
        A * share[:, :, None],
        b * share,
        nowhere,
        nowhere,
        share,
        nowhere,
        nowhere,
    )


def select(block: Block, rows: slice) -> Block:
    return Block(*(x[rows] for x in block))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 79), max_size=6))
def test_a_past_in_any_portions_is_the_batch(seed: int, cuts: list[int]) -> None:
    rows = draw_rows(seed)
    past = PastRows.empty(2, 4)
    edges = sorted({0, *cuts, 80})
    for begin, end in pairwise(edges):
        past = past.add([select(rows, slice(begin, end))])
    stream = solve([select(rows, slice(80, None))], past=past)
    batch = fit_weighted([rows])
    np.testing.assert_allclose(stream.theta, batch.theta, rtol=1e-9)
    np.testing.assert_allclose(stream.residual_std, batch.residual_std, rtol=1e-9)
    assert stream.rows == len(rows.t) and np.allclose(
        past.count, np.sum(rows.share[:80] ** 2, axis=0)
    )


def test_the_past_brings_its_own_covariance_of_the_score() -> None:
    """Of white rows, the covariance is that of all of them, to what the noise is told from some of them."""
    rows = draw_rows(1, 4000)
    early = select(rows, slice(0, 3000))
    late = select(rows, slice(3000, None))
    batch = fit_weighted([rows])
    noise = fit_residual_noise([early], [early.A], batch.theta, np.zeros((4, 4)), np.ones(2))
    past = PastRows.empty(2, 4).add([early], noise.processes)
    np.testing.assert_allclose(solve([late], past=past).std, batch.std, rtol=0.05)


def test_forgetting_weighs_each_row_by_those_after_it() -> None:
    rows = draw_rows(1)
    fade = np.array([0.5, 0.9])
    whole = (
        PastRows.empty(2, 4)
        .add([select(rows, slice(0, 60))])
        .fade(fade)
        .add([select(rows, slice(60, None))])
    )
    weights = np.sqrt(np.where(np.arange(120)[:, None] < 60, fade, 1.0))
    for j, R in enumerate(whole.factors):
        x = np.column_stack([rows.A[:, j], rows.b[:, j], rows.share[:, j]]) * weights[:, [j]]
        np.testing.assert_allclose(R.T @ R, x.T @ x, rtol=1e-9, atol=1e-12)


def test_the_past_as_rows_has_their_mean_squares() -> None:
    rows = draw_rows(2)
    block = PastRows.empty(2, 4).add([rows]).to_block()
    np.testing.assert_allclose(np.mean(block.b**2, axis=0), np.mean(rows.b**2, axis=0), rtol=1e-9)
    np.testing.assert_allclose(np.mean(block.A**2, axis=0), np.mean(rows.A**2, axis=0), rtol=1e-9)


def test_loosening_forgets_along_its_directions_only() -> None:
    """What is orthogonal to them in the metric of the information keeps value and covariance."""
    rng = np.random.default_rng(1)
    known = fit_weighted([draw_rows(4)])
    D = rng.standard_normal((4, 2))
    U, z = np.split(loosen_prior(known.theta, known.covariance, D), [4], axis=1)
    np.testing.assert_allclose(U @ D, 0.0, atol=1e-9)
    np.testing.assert_allclose(U @ known.theta, z[:, 0], atol=1e-9)
    kept = np.linalg.svd(D.T)[2][2:]  # combinations that the change does not move
    expected = kept @ known.covariance @ kept.T
    np.testing.assert_allclose(kept @ np.linalg.pinv(U.T @ U) @ kept.T, expected, rtol=1e-6)
