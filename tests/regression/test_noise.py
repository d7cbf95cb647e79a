"""Autoregressive noise: a planted process is found, whitened and coloured again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.regression import Autoregression, count_independent_rows, fit_autoregression


def test_an_autoregressive_colour_is_found() -> None:
    rng = np.random.default_rng(0)
    polynomial = np.array([1.0, -1.2, 0.5])
    noise = lfilter([1.0], polynomial, rng.standard_normal(100_000))[500:]
    gamma = np.array([np.mean(noise[: len(noise) - k] * noise[k:]) for k in range(9)])
    found = fit_autoregression(gamma, len(noise))
    assert np.allclose(
        found.polynomial[:3], polynomial, atol=0.02
    ) and found.power == pytest.approx(1.0, rel=0.02)
    assert np.abs(found.polynomial[3:]).max(initial=0.0) < 0.02


def test_whitening_undoes_colouring() -> None:
    x = np.random.default_rng(0).standard_normal((50, 2))
    process = Autoregression(np.array([1.0, -0.9, 0.2]), 2.0)
    np.testing.assert_allclose(process.whiten(process.colour(x)), x, atol=1e-12)


def test_white_rows_are_independent_and_slow_ones_fewer() -> None:
    rows = np.array([100.0, 100.0])
    pole = 0.8
    gamma = np.stack([np.eye(1, 200)[0], pole ** np.arange(200)], axis=1)
    white, slow = count_independent_rows(gamma, rows)
    assert white == 100.0 and slow == pytest.approx(100 * (1 - pole**2) / (1 + pole**2))
