"""Least squares by factors: blocks add up, planted parameters come back, units do not matter."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.regression import (
    Block,
    Estimate,
    choose_columns,
    factor_each_block,
    factor_rows,
    fit_ordinary,
    fit_robust,
    fit_weighted,
    merge_factors,
    project_rows,
    solve,
    solve_factors,
)
from tests.regression.blocks import cut, draw_block

ONE = np.ones(2)
THETA = np.array([1.0, -2.0, 0.5, 3.0, -1.5])
SEEDS = st.integers(0, 2**32 - 1)


def draw(seed: int, rows: int = 40) -> Block:
    """Return rows of five parameters with much noise, of which the first joint feeds three."""
    block = draw_block(np.random.default_rng(seed), rows, THETA, noise=1.0)
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
    found = fit(cut(draw_block(np.random.default_rng(2), 1000, THETA), 3))
    assert np.all(np.abs(found.theta - THETA) < 4 * found.std)
    assert found.rows == 1000
    np.testing.assert_allclose(found.std, 0.01 / np.sqrt(2 * 1000), rtol=0.15)


def test_outliers_do_not_move_the_robust_estimate() -> None:
    block = draw_block(np.random.default_rng(5), 400, THETA)
    block.b[::25] += 5.0
    assert np.abs(fit_robust([block]).theta - THETA).max() < 0.01
    assert np.abs(fit_ordinary([block]).theta - THETA).max() > 0.01


@given(SEEDS, st.floats(1e-3, 1e3))
def test_units_of_parameters_and_order_of_joints_do_not_matter(seed: int, unit: float) -> None:
    block = draw_block(np.random.default_rng(seed), 200, THETA)
    scale = unit ** np.arange(5)
    found = fit_weighted([block])
    scaled = fit_weighted([block._replace(A=block.A * scale)])
    turned = fit_weighted([Block(block.t, *(x[:, ::-1] for x in block[1:]))])
    for one, factor in ((scaled, scale), (turned, 1.0)):
        np.testing.assert_allclose(one.theta * factor, found.theta, rtol=1e-6)
        np.testing.assert_allclose(one.std * factor, found.std, rtol=1e-6)


@settings(max_examples=6)
@given(SEEDS, st.floats(1e-2, 1e2))
def test_weights_undo_the_unit_of_a_joint(seed: int, unit: float) -> None:
    block = draw(seed, rows=200)
    scale = np.array([unit, 1.0])
    scaled = block._replace(A=block.A * scale[:, None], b=block.b * scale)
    np.testing.assert_allclose(
        fit_weighted([scaled]).theta, fit_weighted([block]).theta, rtol=1e-3, atol=1e-4
    )


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
    block = draw_block(np.random.default_rng(4), 40, THETA)
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
