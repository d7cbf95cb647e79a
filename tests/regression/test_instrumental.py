"""Instrumental variables: consistent where the regressor is noisy, least squares where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.regression import (
    Block,
    fit_instrumental,
    fit_repeated,
    fit_weighted,
)
from tests.regression.blocks import make_block

SEEDS = st.integers(0, 2**32 - 1)


def draw_twins(seed: int, noise: float) -> tuple[Block, Block, Array]:
    """Return rows twice with independent noise in A, and their parameters."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(0.5, 2.0, 4)
    A = rng.standard_normal((400, 2, 4))
    b = A @ theta + 0.05 * rng.standard_normal((400, 2))
    first, second = (make_block(A + noise * rng.standard_normal(A.shape), b) for _ in range(2))
    return first, second, theta


@given(SEEDS)
def test_regressor_as_its_own_instrument_is_least_squares(seed: int) -> None:
    block, _, _ = draw_twins(seed, 0.0)
    plain = fit_weighted([block])
    for found in (fit_instrumental([block], [block.A]), fit_repeated([block], [block])):
        np.testing.assert_allclose(found.theta, plain.theta, atol=1e-6)
        np.testing.assert_allclose(found.std, plain.std, rtol=0.05)


@pytest.mark.parametrize(("repeats", "noise"), [(False, 0.5), (True, 0.5), (True, 1.0)])
def test_estimates_are_consistent_and_their_deviations_calibrated(
    repeats: bool, noise: float
) -> None:
    """Noise as large as the columns: its products are half of the variance of `fit_repeated`."""
    z = []
    for seed in range(60):
        first, second, theta = draw_twins(seed, noise)
        found = (
            fit_repeated([first], [second]) if repeats else fit_instrumental([first], [second.A])
        )
        z.append((found.theta - theta) / found.std)
    assert abs(np.mean(z)) < 0.35
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.2)


def test_instruments_must_fit_the_rows() -> None:
    block, other, _ = draw_twins(0, 0.0)
    for wrong in ([], [other.A[:-1]]):
        with pytest.raises(UsageError, match="instruments"):
            fit_instrumental([block], wrong)
    with pytest.raises(UsageError, match="twins"):
        fit_repeated([block], [])


def test_direction_without_instrument_has_infinite_deviation() -> None:
    block, other, _ = draw_twins(0, 0.0)
    seen = np.array([1.0, 1.0, 1.0, 0.0])
    found = fit_instrumental([block._replace(A=block.A * seen)], [other.A * seen])
    np.testing.assert_array_equal(np.isinf(found.std), seen == 0.0)
