"""Deviations under coloured residuals: those of repetition, wide enough for few rows, and never under the bound."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.regression import Block, bound_deviations, compute_coloured_covariance, fit_weighted


def test_coloured_covariance_is_that_of_many_estimates() -> None:
    """Slow noise on slow columns: white deviations are far too small, the coloured ones are those of repetition."""
    rng = np.random.default_rng(1)
    count = 100
    t = np.arange(3000.0)
    A = np.stack([np.ones_like(t), np.sin(0.05 * t), np.sin(0.9 * t)], axis=1)[:, None, :]
    thetas = []
    stated = []
    gain = np.linalg.inv(A[:, 0].T @ A[:, 0])
    for _ in range(count):
        b = lfilter([1.0], [1.0, -0.9], rng.standard_normal(3100))[100:, None]
        block = Block(t, A, b, b, b, np.ones_like(b), b, np.zeros_like(b))
        thetas.append(gain @ A[:, 0].T @ b[:, 0])
        stated.append(
            np.diag(compute_coloured_covariance([block], [A], thetas[-1], gain, np.ones(1)))
        )
    true = np.var(thetas, axis=0)
    white = np.diag(gain) * 1.0 / (1 - 0.81)
    assert np.allclose(np.mean(stated, axis=0), true, rtol=0.25)
    assert true[0] > 5 * white[0] and true[2] < 0.5 * white[2]


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_the_bound_is_the_one_of_the_noises_own_covariance(memory: float) -> None:
    """``(Aᵀ Γ⁻¹ A)⁻¹`` written out for a process of one pole, and no least squares of these rows is below it."""
    rng = np.random.default_rng(4)
    m = 1500
    A = lfilter([1.0], [1.0, -0.9], rng.standard_normal((m, 1, 3)), axis=0)
    noise = lfilter([1.0], [1.0, -memory], rng.standard_normal((m, 1)), axis=0)
    theta = np.array([1.0, -2.0, 0.5])
    ones = np.ones((m, 1))
    block = Block(0.1 * np.arange(m), A, (A @ theta) + noise, ones, ones, ones, ones, 0 * ones)
    gamma = memory ** np.abs(np.subtract.outer(np.arange(m), np.arange(m))) / (1 - memory**2)
    flat = A[:, 0]
    exact = np.sqrt(np.diag(np.linalg.inv(flat.T @ np.linalg.solve(gamma, flat))))
    found = fit_weighted([block])
    np.testing.assert_allclose(bound_deviations([block], found.theta), exact, rtol=0.08)
    plain = np.linalg.pinv(flat)
    assert (np.sqrt(np.diag(plain @ gamma @ plain.T)) >= 0.999 * exact).all()


def draw_short(
    rng: np.random.Generator, rows: int, poles: tuple[float, float], size: float = 1.0
) -> Block:
    """Rows of two joints that share six parameters of 1, 2 ...; noise of one pole each, and rows that count in part."""
    t = 0.125 * np.arange(rows)
    A = np.stack(
        [np.sin(rate * t[:, None] + [0.0, 1.0]) for rate in (0.0, 0.3, 0.7, 1.6, 3.1, 6.0)], axis=2
    )
    share = np.clip(1.5 + np.sin(0.5 * t[:, None] + [0.0, 2.0]), 0.0, 1.0)
    noise = [lfilter([1.0], [1.0, -pole], rng.standard_normal(rows + 200))[200:] for pole in poles]
    b = A @ np.arange(1.0, 7.0) + size * np.transpose(noise)
    return Block(
        t,
        A * share[:, :, None],
        b * share,
        np.ones_like(b),
        np.ones_like(b),
        share,
        b,
        np.zeros_like(b),
    )


@pytest.mark.parametrize(
    ("rows", "poles"), [(60, (-0.5, 0.3)), (120, (0.0, 0.5)), (120, (0.5, 0.7)), (200, (0.8, 0.8))]
)
def test_intervals_hold_on_few_rows_whatever_the_noise(
    rows: int, poles: tuple[float, float]
) -> None:
    """600 intervals of 95 %, from rows so few that the noise is known to a fifth; to three binomial deviations."""
    rng = np.random.default_rng(0)
    found = [fit_weighted([draw_short(rng, rows, poles)]) for _ in range(100)]
    z = np.array([(each.theta - np.arange(1.0, 7.0)) / each.std for each in found])
    assert abs(np.mean(np.abs(z) < 1.96) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / z.size)


def test_torque_without_any_noise_leaves_nothing_uncertain() -> None:
    assert np.all(
        fit_weighted([draw_short(np.random.default_rng(3), 60, (0.0, 0.0), 0.0)]).std < 1e-9
    )
