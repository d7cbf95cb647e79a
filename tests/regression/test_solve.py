"""Laws of least squares by factors.

Blocks add up, past rows count as held ones do, planted parameters come back, units do not matter, and stated
deviations are those of repetition, whatever the colour of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gimbal_pin.log import Array
from gimbal_pin.regression import (
    Block,
    Estimate,
    PastRows,
    bound_deviations,
    choose_columns,
    count_independent_rows,
    factor_each_block,
    factor_rows,
    fit_ordinary,
    fit_residual_noise,
    fit_robust,
    fit_weighted,
    loosen_prior,
    merge_factors,
    project_rows,
    solve,
    solve_factors,
)
from tests.regression.blocks import cut, draw_block, make_block, select

ONE = np.ones(2)
THETA = np.array([1.0, -2.0, 0.5, 3.0, -1.5])
NONE = PastRows.empty(2, 5)
SEEDS = st.integers(0, 2**32 - 1)


def draw(seed: int, rows: int = 120, noise: float = 0.1) -> Block:
    """Return rows that count in part, of which the first joint feeds three parameters."""
    block = draw_block(np.random.default_rng(seed), rows, THETA, noise, shared=True)
    fed = np.array([[1.0, 0.0, 0.0, 1.0, 1.0], np.ones(5)])
    return block._replace(A=block.A * fed)


@given(SEEDS, st.integers(1, 7))
def test_factor_is_that_of_the_stack_however_it_is_cut(seed: int, parts: int) -> None:
    whole = draw(seed)
    blocks = cut(whole, parts)
    rows = np.concatenate([whole.A, whole.b[:, :, None]], axis=2).swapaxes(0, 1)
    for factors in (factor_rows(blocks), merge_factors(factor_each_block(blocks))):
        np.testing.assert_allclose(
            factors.swapaxes(1, 2) @ factors, rows.swapaxes(1, 2) @ rows, atol=1e-9
        )
    places = [3, 0, 4]
    chosen = solve_factors(choose_columns(factor_rows(blocks), places), ONE)
    again = solve_factors(factor_rows([whole._replace(A=whole.A[:, :, places])]), ONE)
    np.testing.assert_allclose(chosen.theta, again.theta, rtol=1e-9)


@pytest.mark.parametrize("fit", [fit_ordinary, fit_weighted, fit_robust])
def test_planted_parameters_are_recovered(fit: Callable[[Sequence[Block]], Estimate]) -> None:
    """With the deviations of white noise, and but for the ordinary fit among outliers, too."""
    block = draw_block(np.random.default_rng(2), 1000, THETA)
    found = fit(cut(block, 3))
    assert np.all(np.abs(found.theta - THETA) < 4 * found.std)
    np.testing.assert_allclose(found.std, 0.01 / np.sqrt(2 * 1000), rtol=0.15)
    block.b[::25] += 5.0
    assert (np.abs(fit([block]).theta - THETA).max() < 0.01) == (fit is fit_robust)


@given(SEEDS, st.floats(1e-2, 1e2))
def test_units_of_parameters_and_joints_and_their_order_do_not_matter(
    seed: int, unit: float
) -> None:
    """The weights of the joints follow their units to what is left of their iteration."""
    block = draw_block(np.random.default_rng(seed), 200, THETA)
    found = fit_weighted([block])
    scale = unit ** np.arange(5)
    joint = np.array([unit, 1.0])
    scaled = block._replace(A=block.A * scale * joint[:, None], b=block.b * joint)
    turned = Block(block.t, *(x[:, ::-1] for x in block[1:]))
    for one, factor in ((scaled, scale), (turned, 1.0)):
        estimate = fit_weighted([one])
        np.testing.assert_allclose(estimate.theta * factor, found.theta, rtol=1e-3)
        np.testing.assert_allclose(estimate.std * factor, found.std, rtol=1e-3)


def test_prior_counts_as_rows() -> None:
    """Rows of unit noise in the prior are data of unit weight; a sure prior decides."""
    block = draw(3)
    prior = np.random.default_rng(3).standard_normal((6, 6))
    rows = np.vstack([block.A.reshape(-1, 5), prior[:, :5]])
    torques = np.append(block.b.ravel(), prior[:, 5])
    found = solve_factors(factor_rows([block]), ONE, prior)
    np.testing.assert_allclose(found.theta, np.linalg.lstsq(rows, torques, rcond=None)[0])
    sure = solve([block], np.column_stack([1e6 * np.eye(5), 1e6 * np.ones(5)]))
    np.testing.assert_allclose(sure.theta, 1.0, atol=1e-6)
    np.testing.assert_allclose(sure.std, 1e-6, rtol=1e-3)


def test_dependent_columns_have_infinite_deviation() -> None:
    block = draw(4)
    block.A[:, :, 2] = block.A[:, :, 0] - block.A[:, :, 1]
    np.testing.assert_array_equal(np.isinf(fit_weighted([block]).std), [True] * 3 + [False] * 2)


@given(SEEDS, st.floats(-8.0, 8.0))
def test_projection_is_that_of_least_squares_whatever_the_scales(seed: int, power: float) -> None:
    """Columns that depend on each other, and one of zeros, take off no more than their span."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((30, 4))
    columns = rng.standard_normal((30, 3))
    scaled = columns * 10.0 ** np.array([power, 0.0, -power])
    dependent = np.column_stack([scaled, columns.sum(axis=1), np.zeros(30)])
    fitted = columns @ np.linalg.lstsq(columns, rows, rcond=None)[0]
    np.testing.assert_allclose(project_rows(rows, dependent), rows - fitted, atol=1e-9)


@given(SEEDS, st.lists(st.integers(1, 79), max_size=6))
def test_past_in_any_portions_is_the_batch(seed: int, cuts: list[int]) -> None:
    rows = draw(seed)
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
    rows = draw(1, 4000)
    early = select(rows, slice(0, 3000))
    batch = fit_weighted([rows])
    noise = fit_residual_noise([early], [early.A], batch.theta, np.zeros((5, 5)), ONE)
    past = NONE
    for portion in cut(early, 2):
        past = past.add([portion], noise.processes)
    np.testing.assert_allclose(past.fade(np.array([0.5, 0.9])).score[0], 0.5**2 * past.score[0])
    stream = solve([select(rows, slice(3000, None))], past=past)
    np.testing.assert_allclose(stream.std, batch.std, rtol=0.05)


def test_forgetting_weighs_each_row_by_those_after_it() -> None:
    rows = draw(1)
    fade = np.array([0.5, 0.9])
    early = NONE.add([select(rows, slice(0, 60))])
    R = early.fade(fade).add([select(rows, slice(60, None))]).factors
    weights = np.sqrt(np.where(np.arange(120)[:, None] < 60, fade, 1.0))
    x = (np.dstack([rows.A, rows.b, rows.share]) * weights[:, :, None]).swapaxes(0, 1)
    np.testing.assert_allclose(R.swapaxes(1, 2) @ R, x.swapaxes(1, 2) @ x, rtol=1e-9, atol=1e-12)


def test_loosening_forgets_along_its_directions_only() -> None:
    """Combinations orthogonal to them in the metric of the information keep their covariance."""
    D = np.random.default_rng(1).standard_normal((5, 2))
    known = fit_weighted([draw(4)])
    U, z = np.split(loosen_prior(known.theta, known.covariance, D), [5], axis=1)
    np.testing.assert_allclose(U @ D, 0.0, atol=1e-9)
    np.testing.assert_allclose(U @ known.theta, z[:, 0], atol=1e-9)
    kept = np.linalg.svd(D.T)[2][2:]
    expected = kept @ known.covariance @ kept.T
    np.testing.assert_allclose(kept @ np.linalg.pinv(U.T @ U) @ kept.T, expected, rtol=1e-6)


def colour(rng: np.random.Generator, rows: int, pole: float) -> Array:
    """Return noise of one pole without its beginning."""
    return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(rows + 200))[200:])


def test_correlated_rows_count_as_fewer_independent_ones() -> None:
    pole = 0.8
    gamma = np.stack([np.eye(1, 200)[0], pole ** np.arange(200)], axis=1)
    expected = [100.0, 100 * (1 - pole**2) / (1 + pole**2)]
    found = count_independent_rows(gamma, np.full(2, 100.0))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_bound_is_that_of_generalised_least_squares(memory: float) -> None:
    """``(Aᵀ Γ⁻¹ A)⁻¹`` written out for noise of one pole."""
    rng = np.random.default_rng(4)
    m = 1500
    A = lfilter([1.0], [1.0, -0.9], rng.standard_normal((m, 3)), axis=0)
    b = A @ [1.0, -2.0, 0.5] + colour(rng, m, memory)
    block = make_block(A[:, None], b[:, None])
    gamma = memory ** np.abs(np.subtract.outer(np.arange(m), np.arange(m))) / (1 - memory**2)
    exact = np.sqrt(np.diag(np.linalg.inv(A.T @ np.linalg.solve(gamma, A))))
    bound = bound_deviations([block], fit_weighted([block]).theta)
    np.testing.assert_allclose(bound, exact, rtol=0.08)


@pytest.mark.parametrize(
    ("rows", "poles"), [(60, (-0.5, 0.3)), (120, (0.0, 0.5)), (200, (0.8, 0.8))]
)
def test_intervals_hold_on_few_rows(rows: int, poles: tuple[float, float]) -> None:
    """Intervals of 95 % from rows that show the noise to a fifth; to three binomial deviations."""
    rng = np.random.default_rng(0)
    t = 0.125 * np.arange(rows)[:, None]
    rates = (0.0, 0.3, 0.7, 1.6, 3.1, 6.0)
    A = np.stack([np.sin(rate * t + [0.0, 1.0]) for rate in rates], axis=2)
    share = np.clip(1.5 + np.sin(0.5 * t + [0.0, 2.0]), 0.0, 1.0)
    z = []
    for _ in range(100):
        noise = np.stack([colour(rng, rows, pole) for pole in poles], axis=1)
        found = fit_weighted([make_block(A, A.sum(axis=2) + noise, share)])
        z.append((found.theta - 1.0) / found.std)
    assert abs(np.mean(np.abs(z) < 1.96) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 600)
