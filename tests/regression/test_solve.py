"""Least squares by factors: what is planted comes back, blocks add up, and no unit and no order matters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.log import Array
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

ONE = np.ones(2)
SEEDS = st.integers(0, 2**32 - 1)


def draw_block(
    rng: np.random.Generator, rows: int = 40, width: int = 5, theta: Array | None = None
) -> Block:
    """Rows of two joints; with theta their torque is that and noise of a hundredth."""
    A = rng.standard_normal((rows, 2, width))
    b = rng.standard_normal((rows, 2))
    b = b if theta is None else A @ theta + 0.01 * b
    return Block(
        np.arange(rows) * 0.1,
        A,
        b,
        A[:, :, 0],
        A[:, :, 1],
        np.ones((rows, 2)),
        A[:, :, 1],
        np.zeros((rows, 2)),
    )


def cut(whole: Block, parts: int) -> list[Block]:
    return [
        Block(*(x[rows] for x in whole)) for rows in np.array_split(np.arange(len(whole.t)), parts)
    ]


@given(SEEDS, st.integers(1, 7))
def test_the_factor_is_that_of_the_stack_however_it_is_cut(seed: int, parts: int) -> None:
    whole = draw_block(np.random.default_rng(seed))
    rows = np.concatenate([whole.A, whole.b[:, :, None]], axis=2)
    for j, R in enumerate(factor_rows(cut(whole, parts))):
        assert np.allclose(R.T @ R, rows[:, j].T @ rows[:, j], atol=1e-9)


@given(SEEDS, st.integers(0, 3))
def test_leaving_a_block_out_is_the_fit_without_it(seed: int, left_out: int) -> None:
    blocks = cut(draw_block(np.random.default_rng(seed)), 4)
    factors = list(factor_each_block(blocks))
    others = merge_factors(factors[:left_out] + factors[left_out + 1 :])
    again = factor_rows(blocks[:left_out] + blocks[left_out + 1 :])
    assert np.allclose(solve_factors(others, ONE).theta, solve_factors(again, ONE).theta, rtol=1e-9)


@given(SEEDS)
def test_a_stream_of_blocks_is_the_batch(seed: int) -> None:
    blocks = cut(draw_block(np.random.default_rng(seed), 200), 9)
    kept = next(each := factor_each_block(blocks))
    for newer in each:
        kept = merge_factors([kept, newer])
    stream = solve_factors(kept, ONE)
    batch = solve_factors(factor_rows(blocks), ONE)
    assert np.allclose(stream.theta, batch.theta, rtol=1e-9)
    assert np.allclose(stream.information, batch.information, rtol=1e-9)


@given(SEEDS)
def test_groups_of_columns_are_chosen_without_the_rows(seed: int) -> None:
    block = draw_block(np.random.default_rng(seed))
    places = [3, 0, 4]
    chosen = solve_factors(choose_columns(factor_rows([block]), places), ONE)
    again = solve_factors(factor_rows([block._replace(A=block.A[:, :, places])]), ONE)
    assert np.allclose(chosen.theta, again.theta, rtol=1e-9)


def test_columns_that_a_joint_does_not_feel_change_nothing() -> None:
    block = draw_block(np.random.default_rng(0))
    A = block.A.copy()
    A[:, 0, 1:3] = 0.0
    rows = np.concatenate([A, block.b[:, :, None]], axis=2)
    for j, R in enumerate(factor_rows(cut(block._replace(A=A), 3))):
        assert np.allclose(R.T @ R, rows[:, j].T @ rows[:, j], atol=1e-9)


@pytest.mark.parametrize("fit", [fit_ordinary, fit_weighted, fit_robust])
def test_a_planted_model_is_recovered_within_its_deviations(fit: object) -> None:
    assert callable(fit)
    rng = np.random.default_rng(2)
    theta = rng.standard_normal(5)
    found: Estimate = fit(cut(draw_block(rng, 400, theta=theta), 3))
    assert np.all(np.abs(found.theta - theta) < 4 * found.std) and np.all(found.std < 2e-3)
    assert found.rows == 400 and np.allclose(found.residual_std, 0.01, rtol=0.1)


@given(SEEDS, st.floats(1e-3, 1e3))
def test_units_of_parameters_and_the_order_of_joints_do_not_matter(seed: int, unit: float) -> None:
    rng = np.random.default_rng(seed)
    block = draw_block(rng, 200, theta=np.ones(5))
    scale = unit ** np.arange(5)
    found = fit_weighted([block])
    scaled = fit_weighted([block._replace(A=block.A * scale)])
    assert np.allclose(scaled.theta * scale, found.theta, rtol=1e-6)
    assert np.allclose(scaled.std * scale, found.std, rtol=1e-6)
    turned = fit_weighted([Block(block.t, *(x[:, ::-1] for x in block[1:]))])
    assert np.allclose(turned.theta, found.theta, rtol=1e-9) and np.allclose(
        turned.std, found.std, rtol=1e-9
    )


@settings(max_examples=6)
@given(SEEDS, st.floats(1e-2, 1e2))
def test_weighting_does_not_depend_on_a_joints_unit(seed: int, unit: float) -> None:
    """Torque of one joint in another unit: the weights undo it, plain least squares does not."""
    made = draw_block(np.random.default_rng(seed), rows=200)
    scale = np.array([unit, 1.0])
    scaled = made._replace(A=made.A * scale[:, None], b=made.b * scale)
    assert np.allclose(
        fit_weighted([made]).theta, fit_weighted([scaled]).theta, rtol=1e-3, atol=1e-4
    )


def test_outliers_do_not_move_the_robust_estimate() -> None:
    rng = np.random.default_rng(5)
    theta = rng.standard_normal(5)
    made = draw_block(rng, rows=400, theta=theta)
    b = made.b.copy()
    b[::25] += 5.0
    made = made._replace(b=b)
    assert (
        np.abs(fit_robust([made]).theta - theta).max()
        < 0.01
        < np.abs(fit_ordinary([made]).theta - theta).max()
    )


def test_a_prior_counts_as_rows_do() -> None:
    """Rows of unit noise in the prior, or as data of unit weight: the same estimate; a sure one decides."""
    rng = np.random.default_rng(3)
    block = draw_block(rng)
    U = rng.standard_normal((6, 5))
    z = rng.standard_normal(6)
    stacked = solve_factors(factor_rows([block]), ONE, np.column_stack([U, z]))
    rows = np.vstack([block.A.reshape(-1, 5), U])
    assert np.allclose(
        stacked.theta, np.linalg.lstsq(rows, np.append(block.b.ravel(), z), rcond=None)[0]
    )
    sure = solve([block], np.column_stack([1e6 * np.eye(5), 1e6 * np.ones(5)]))
    assert np.allclose(sure.theta, 1.0, atol=1e-6) and np.all(sure.std < 1e-5)


def test_what_the_rows_do_not_show_has_no_deviation() -> None:
    block = draw_block(np.random.default_rng(4))
    A = block.A.copy()
    A[:, :, 2] = A[:, :, 0] - A[:, :, 1]
    found = fit_weighted([block._replace(A=A)])
    assert np.all(np.isinf(found.std[:3])) and np.all(np.isfinite(found.std[3:]))


def test_noise_added_never_narrows_an_interval() -> None:
    rng = np.random.default_rng(6)
    quiet = draw_block(rng, 400, theta=np.ones(5))
    noise = rng.standard_normal(quiet.b.shape)
    stds = [
        fit_weighted([quiet._replace(b=quiet.b + size * noise)]).std
        for size in (0.0, 0.03, 0.1, 0.3)
    ]
    assert np.all(np.diff(stds, axis=0) > 0)


@given(SEEDS, st.floats(-8.0, 8.0))
def test_what_is_projected_off_is_orthogonal_whatever_the_columns_scales(
    seed: int, power: float
) -> None:
    """Columns that depend on each other, and one of nothing, take off no more than their span."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((30, 4))
    columns = rng.standard_normal((30, 3))
    dependent = np.column_stack(
        [columns * 10.0 ** np.array([power, 0.0, -power]), columns.sum(axis=1), np.zeros(30)]
    )
    left = project_rows(rows, dependent)
    np.testing.assert_allclose(columns.T @ left, 0.0, atol=1e-9)
    np.testing.assert_allclose(project_rows(left, dependent), left, atol=1e-9)
    np.testing.assert_allclose(
        left, rows - columns @ np.linalg.lstsq(columns, rows, rcond=None)[0], atol=1e-9
    )
