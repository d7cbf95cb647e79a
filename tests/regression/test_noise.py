"""Coloured residuals: planted processes are found, and stated deviations are those of repetition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.log import Array
from gimbal_pin.regression import (
    Autoregression,
    Block,
    bound_deviations,
    count_independent_rows,
    fit_autoregression,
    fit_weighted,
)
from tests.regression.blocks import make_block

THETA = np.arange(1.0, 7.0)


def colour(rng: np.random.Generator, rows: int, pole: float) -> Array:
    """Return noise of one pole without its beginning."""
    return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(rows + 200))[200:])


def test_planted_process_is_found() -> None:
    rng = np.random.default_rng(0)
    polynomial = np.array([1.0, -1.2, 0.5])
    noise = lfilter([1.0], polynomial, rng.standard_normal(100_000))[500:]
    gamma = np.array([np.mean(noise[: len(noise) - k] * noise[k:]) for k in range(9)])
    found = fit_autoregression(gamma, len(noise))
    np.testing.assert_allclose(found.polynomial[:3], polynomial, atol=0.02)
    np.testing.assert_allclose(found.polynomial[3:], 0.0, atol=0.02)
    assert found.power == pytest.approx(1.0, rel=0.02)


def test_whitening_undoes_colouring() -> None:
    x = np.random.default_rng(0).standard_normal((50, 2))
    process = Autoregression(np.array([1.0, -0.9, 0.2]), 2.0)
    np.testing.assert_allclose(process.whiten(process.colour(x)), x, atol=1e-12)


def test_correlated_rows_count_as_fewer_independent_ones() -> None:
    pole = 0.8
    gamma = np.stack([np.eye(1, 200)[0], pole ** np.arange(200)], axis=1)
    expected = [100.0, 100 * (1 - pole**2) / (1 + pole**2)]
    found = count_independent_rows(gamma, np.full(2, 100.0))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_bound_is_that_of_generalised_least_squares(memory: float) -> None:
    """``(Aᵀ Γ⁻¹ A)⁻¹`` written out for noise of one pole; ordinary least squares is not below it."""
    rng = np.random.default_rng(4)
    m = 1500
    A = lfilter([1.0], [1.0, -0.9], rng.standard_normal((m, 3)), axis=0)
    b = A @ [1.0, -2.0, 0.5] + colour(rng, m, memory)
    block = make_block(A[:, None], b[:, None])
    gamma = memory ** np.abs(np.subtract.outer(np.arange(m), np.arange(m))) / (1 - memory**2)
    exact = np.sqrt(np.diag(np.linalg.inv(A.T @ np.linalg.solve(gamma, A))))
    bound = bound_deviations([block], fit_weighted([block]).theta)
    np.testing.assert_allclose(bound, exact, rtol=0.08)
    plain = np.linalg.pinv(A)
    assert np.all(np.sqrt(np.diag(plain @ gamma @ plain.T)) >= 0.999 * exact)


def draw_short(rng: np.random.Generator, rows: int, poles: tuple[float, float]) -> Block:
    """Return rows of two joints that share six parameters, and that count in part."""
    t = 0.125 * np.arange(rows)[:, None]
    rates = (0.0, 0.3, 0.7, 1.6, 3.1, 6.0)
    A = np.stack([np.sin(rate * t + [0.0, 1.0]) for rate in rates], axis=2)
    share = np.clip(1.5 + np.sin(0.5 * t + [0.0, 2.0]), 0.0, 1.0)
    noise = np.stack([colour(rng, rows, pole) for pole in poles], axis=1)
    return make_block(A, A @ THETA + noise, share)


@pytest.mark.parametrize(
    ("rows", "poles"), [(60, (-0.5, 0.3)), (120, (0.0, 0.5)), (200, (0.8, 0.8))]
)
def test_intervals_hold_on_few_rows(rows: int, poles: tuple[float, float]) -> None:
    """Intervals of 95 % from rows that show the noise to a fifth; to three binomial deviations."""
    rng = np.random.default_rng(0)
    found = [fit_weighted([draw_short(rng, rows, poles)]) for _ in range(100)]
    z = np.array([(each.theta - THETA) / each.std for each in found])
    assert abs(np.mean(np.abs(z) < 1.96) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / z.size)
