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
    Estimate,
    MotionNoise,
    compare_instruments,
    fit_instrumental,
    fit_ordinary,
    fit_repeated,
    fit_weighted,
)


def regression(
    rng: np.random.Generator, rows: int = 400, noise: float = 0.0
) -> tuple[Block, Block, Array]:
    """One block twice with independent noise in A, and theta."""
    theta = rng.uniform(0.5, 2.0, 4)
    A = rng.standard_normal((rows, 2, 4))
    b = A @ theta + 0.05 * rng.standard_normal((rows, 2))
    t = np.arange(rows) / 8.0
    share = np.ones((rows, 2))
    ones = np.ones((rows, 2))
    twins = [
        Block(t, A + noise * rng.standard_normal(A.shape), b, ones, ones, share, ones, 0 * ones)
        for _ in range(2)
    ]
    return twins[0], twins[1], theta


@given(st.integers(0, 2**32 - 1))
def test_repeated_readings_do_not_care_which_comes_first(seed: int) -> None:
    first, second, _ = regression(np.random.default_rng(seed), noise=0.3)
    one = fit_repeated([first], [second])
    other = fit_repeated([second], [first])
    assert np.allclose(one.theta, other.theta) and np.allclose(one.covariance, other.covariance)


@given(st.integers(0, 2**32 - 1))
def test_the_regressor_as_its_own_instrument_is_least_squares(seed: int) -> None:
    block, _, _ = regression(np.random.default_rng(seed))
    plain = fit_weighted([block])
    for found in (fit_instrumental([block], [block.A]), fit_repeated([block], [block])):
        assert np.allclose(found.theta, plain.theta, atol=1e-6)
        assert np.allclose(found.std, plain.std, rtol=0.05)


@given(st.integers(0, 2**32 - 1))
def test_with_one_joint_the_regressor_as_instrument_is_ordinary_least_squares(seed: int) -> None:
    block, _, _ = regression(np.random.default_rng(seed))
    one = Block(block.t, *(x[:, :1] for x in block[1:]))
    assert np.allclose(fit_instrumental([one], [one.A]).theta, fit_ordinary([one]).theta, rtol=1e-9)


def test_the_error_falls_with_the_rows_where_that_of_least_squares_stays() -> None:
    """Attenuation by 1 / (1 + 0.5²) for white columns, however many rows; without bias the error falls as 1/√N."""
    errors: dict[int, tuple[float, float]] = {}
    for rows in (400, 40_000):
        first, second, theta = regression(np.random.default_rng(3), rows, noise=0.5)
        plain = fit_weighted([first]).theta
        found = fit_instrumental([first], [second.A]).theta
        errors[rows] = (
            float(np.abs(plain / theta - 1).max()),
            float(np.abs(found / theta - 1).max()),
        )
    assert errors[40_000][0] == pytest.approx(1 - 1 / 1.25, abs=0.01)
    assert errors[40_000][1] < 0.2 * errors[400][1] and errors[40_000][1] < 0.02


def test_blocks_of_a_log_are_one_regression() -> None:
    first, second, _ = regression(np.random.default_rng(8), noise=0.4)
    parts = [slice(0, 150), slice(150, 400)]
    cut = [Block(*(x[part] for x in first)) for part in parts]
    whole = fit_instrumental([first], [second.A])
    assert np.allclose(fit_instrumental(cut, [second.A[part] for part in parts]).theta, whole.theta)


def test_instrumental_estimates_are_consistent_and_their_deviations_honest() -> None:
    errors: dict[str, list[Array]] = {"plain": [], "instrumental": [], "repeated": []}
    for seed in range(60):
        first, second, theta = regression(np.random.default_rng(seed), noise=0.5)
        for name, found in (
            ("plain", fit_weighted([first])),
            ("instrumental", fit_instrumental([first], [second.A])),
            ("repeated", fit_repeated([first], [second])),
        ):
            errors[name].append((found.theta - theta) / found.std)
    scores = {name: np.array(each) for name, each in errors.items()}
    assert np.mean(scores["plain"]) < -5
    for name in ("instrumental", "repeated"):
        assert abs(np.mean(scores[name])) < 0.35
        assert 0.7 < np.std(scores[name]) < 1.3


def test_deviations_of_repeated_readings_count_noise_times_noise() -> None:
    """With noise as large as the columns its products are half of the variance."""
    scores = []
    for seed in range(60):
        first, second, theta = regression(np.random.default_rng(seed), noise=1.0)
        found = fit_repeated([first], [second])
        scores.append((found.theta - theta) / found.std)
    assert 0.85 < np.sqrt(np.mean(np.square(scores))) < 1.15
    assert 0.93 < np.mean(np.abs(scores) < 1.96) < 0.98


def test_instruments_must_fit_the_rows() -> None:
    block, other, _ = regression(np.random.default_rng(0))
    for wrong in ([], [other.A[:-1]]):
        with pytest.raises(UsageError, match="instruments"):
            fit_instrumental([block], wrong)
    with pytest.raises(UsageError, match="twins"):
        fit_repeated([block], [])


def test_a_direction_without_instrument_has_infinite_deviation() -> None:
    block, other, _ = regression(np.random.default_rng(0))
    blind = block._replace(A=block.A * [1.0, 1.0, 1.0, 0.0])
    found: Estimate = fit_instrumental([blind], [other.A * [1.0, 1.0, 1.0, 0.0]])
    assert np.isinf(found.std).tolist() == [False, False, False, True]


def compare_shaken(seed: int, noise: float, answer: float = 0.0) -> MotionNoise:
    """Compare where a column that multiplies 2 has noise, of which `answer` times as much stands in the torque."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(40), 500)
    slow = rng.standard_normal((20_000, 2))
    shaken = noise * rng.standard_normal(20_000)
    A = slow + shaken[:, None] * [1.0, 0.0]
    b = slow @ [2.0, 1.0] + answer * shaken + 0.1 * rng.standard_normal(20_000)
    return compare_instruments(A, slow, b, block, np.array([[1.0, 0.0], [0.0, 1.0]]))


def test_without_noise_in_the_motion_instruments_say_what_least_squares_does() -> None:
    found = compare_shaken(0, noise=0.0)
    assert np.allclose(found.plain, found.instrumental, rtol=1e-9) and not found.is_hiding.any()
    assert np.allclose(found.instrumental, found.theta)


@pytest.mark.parametrize("answer", [0.0, -0.5])
def test_the_slow_motion_recovers_what_growing_noise_takes_from_least_squares(
    answer: float,
) -> None:
    """``plain → (2 + answer σ²) / (1 + σ²)``, whether a controller answers to the noise or not."""
    before = 0.0
    for noise in (0.1, 0.5, 1.0, 2.0):
        found = compare_shaken(1, noise, answer)
        lost = 1.0 - (2.0 + answer * noise**2) / (1.0 + noise**2) / 2.0
        assert found.attenuation[0] == pytest.approx(lost, abs=0.06)
        assert found.instrumental == pytest.approx([2.0, 1.0], rel=0.15)
        assert found.attenuation[0] > before and bool(found.is_hiding[0]) is (lost > 0.1)
        assert not found.is_hiding[1]
        before = float(found.attenuation[0])


def test_the_deviation_of_what_noise_takes_is_its_scatter_from_log_to_log() -> None:
    each = [compare_shaken(seed, noise=1.0) for seed in range(60)]
    scatter = np.std([one.instrumental - one.plain for one in each], axis=0)
    assert np.mean([one.std for one in each], axis=0) == pytest.approx(scatter, rel=0.3)


def test_more_inertia_in_fast_motion_than_in_slow_is_no_noise() -> None:
    found = compare_shaken(2, noise=1.0, answer=4.0)
    assert found.plain[0] > found.instrumental[0] and not found.is_hiding[0]
