"""The recursive solve: rows in any portions are the batch, and what is loosened is forgotten alone."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.log import Array
from gimbal_pin.regression import Block, Known, Moments, fit_weighted, loosen_prior, solve_recursive


def draw_rows(seed: int, rows: int = 120) -> Array:
    """``[A b share]`` of two joints with four parameters of one and noise, (m, n, 6)."""
    rng = np.random.default_rng(seed)
    A, share = rng.standard_normal((rows, 2, 4)), rng.uniform(0.2, 1.0, (rows, 2, 1))
    b = A.sum(axis=2, keepdims=True) + 0.1 * rng.standard_normal((rows, 2, 1))
    return np.concatenate([A * share, b * share, share], axis=2)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 119), max_size=6))
def test_rows_in_any_portions_are_the_batch(seed: int, cuts: list[int]) -> None:
    rows, moments = draw_rows(seed), Moments.empty(2, 4)
    for part in np.split(rows, sorted(cuts)):
        moments = moments.with_rows(part)
    stream, whole = solve_recursive(moments), solve_recursive(Moments.empty(2, 4).with_rows(rows))
    nowhere = np.zeros(rows.shape[:2])
    batch = fit_weighted(
        [Block(0.1 * np.arange(len(rows)), rows[..., :4], rows[..., 4], nowhere, nowhere, rows[..., 5])]
    )
    np.testing.assert_allclose(stream.estimate.theta, batch.theta, rtol=1e-9)
    np.testing.assert_allclose(stream.estimate.residual_std, batch.residual_std, rtol=1e-9)
    np.testing.assert_allclose(stream.estimate.covariance, whole.estimate.covariance, rtol=1e-7, atol=1e-12)
    assert moments.rows == len(rows) and np.allclose(moments.count, np.sum(rows[..., 5] ** 2, axis=0))


def test_forgetting_weighs_each_row_by_those_after_it() -> None:
    rows, fade = draw_rows(1), 0.97
    fading = np.full(rows.shape[:2], fade)
    faded = Moments.empty(2, 4).with_rows(rows, fading).of_rows
    weights = np.sqrt(fade ** np.arange(len(rows))[::-1])[:, None]
    for R, x in zip(faded, rows.swapaxes(0, 1)):
        np.testing.assert_allclose(R.T @ R, (weights * x[:, :5]).T @ (weights * x[:, :5]), rtol=1e-9)


def test_the_moments_as_rows_have_their_mean_squares() -> None:
    rows = draw_rows(2)
    block = Moments.empty(2, 4).with_rows(rows).to_block()
    np.testing.assert_allclose(np.mean(block.b**2, axis=0), np.mean(rows[..., 4] ** 2, axis=0), rtol=1e-9)
    np.testing.assert_allclose(np.mean(block.A**2, axis=0), np.mean(rows[..., :4] ** 2, axis=0), rtol=1e-9)


def test_loosening_forgets_along_its_directions_only() -> None:
    """What is orthogonal to them in the metric of the information keeps value and covariance."""
    rng = np.random.default_rng(1)
    moments = Moments.empty(2, 4).with_rows(np.dstack([rng.standard_normal((50, 2, 5)), np.ones((50, 2))]))
    known = solve_recursive(moments)
    D = rng.standard_normal((4, 2))
    U, z = np.split(loosen_prior(known, D).equations, [4], axis=1)
    np.testing.assert_allclose(U @ D, 0.0, atol=1e-9)
    np.testing.assert_allclose(U @ known.estimate.theta, z[:, 0], atol=1e-9)
    kept = np.linalg.svd(D.T)[2][2:]  # combinations that the change does not move
    expected = kept @ known.estimate.covariance @ kept.T
    np.testing.assert_allclose(kept @ np.linalg.pinv(U.T @ U) @ kept.T, expected, rtol=1e-6)
    assert isinstance(known, Known)
