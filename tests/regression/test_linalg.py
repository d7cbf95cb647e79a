"""Laws of the linear algebra that the estimators share."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.regression.linalg import (
    compute_wald,
    decompose,
    solve_moments,
    solve_rows,
    triangularise,
    whiten,
)
from gimbal_pin.rig.types import Array

SEEDS = st.integers(0, 2**32 - 1)
SCALES = 10.0 ** np.array([-6.0, 0.0, 3.0, 6.0])


def draw_rows(seed: int) -> Array:
    """Return forty rows whose columns differ by twelve orders of magnitude."""
    return np.asarray(np.random.default_rng(seed).standard_normal((40, 4)) * SCALES)


@given(SEEDS)
def test_inverse_solves_in_any_units(seed: int) -> None:
    A = draw_rows(seed)
    svd = decompose(A)
    np.testing.assert_allclose((svd.U * svd.s) @ svd.Vt * svd.d / SCALES, A / SCALES, atol=1e-9)
    np.testing.assert_allclose(svd.inverse @ A * SCALES[:, None] / SCALES, np.eye(4), atol=1e-9)


@given(SEEDS)
def test_rows_and_moments_have_one_solution(seed: int) -> None:
    A = draw_rows(seed)
    b = np.random.default_rng(seed).standard_normal(40)
    by_rows = solve_rows(np.column_stack([A, b]))
    by_moments = solve_moments(A.T @ A, A.T @ b)
    np.testing.assert_allclose(by_rows.theta * SCALES, by_moments.theta * SCALES, atol=1e-9)
    both = np.outer(SCALES, SCALES)
    np.testing.assert_allclose(by_rows.gain * both, by_moments.gain * both, atol=1e-9)
    np.testing.assert_allclose(
        by_rows.gain * both, np.linalg.inv((A / SCALES).T @ (A / SCALES)), atol=1e-9
    )


def test_dependent_columns_are_not_shown_and_the_others_are() -> None:
    A = draw_rows(0)
    A[:, 1] = A[:, 3]
    found = solve_rows(np.column_stack([A, A[:, 0]]))
    np.testing.assert_array_equal(found.shown, [True, False, True, False])
    assert np.isinf(found.condition)
    variance = np.diag(found.mark_unseen(found.gain))
    np.testing.assert_array_equal(np.isinf(variance), [False, True, False, True])
    np.testing.assert_allclose(found.theta * SCALES, [1e-6, 0.0, 0.0, 0.0], atol=1e-12)


@given(SEEDS)
def test_whitened_noise_has_unit_covariance(seed: int) -> None:
    R = triangularise(draw_rows(seed))
    covariance = R.T @ R
    W = whiten(covariance)
    np.testing.assert_allclose(W @ covariance @ W.T, np.eye(4), atol=1e-8)
    d = SCALES * np.random.default_rng(seed).standard_normal(4)
    assert compute_wald(d, covariance) == (pytest.approx(np.sum((W @ d) ** 2)), 4)


def test_a_direction_without_variance_is_not_judged() -> None:
    root = np.diag([2.0, 3.0, 0.0])
    assert compute_wald(np.array([2.0, 3.0, 7.0]), root @ root) == (pytest.approx(2.0), 2)
