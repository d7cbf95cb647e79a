"""Signals: filter, derivative, interpolation and noise obey the formulas that they are named after."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gimbal_pin.log import (
    compute_lowpass_settling,
    differentiate,
    lowpass,
    noise_std,
    resample,
    signals,
    zero_phase,
)

RATE = 500.0
SEED = st.integers(0, 2**32 - 1)
COEFFICIENTS = hnp.arrays(float, 5, elements=st.floats(-3, 3, allow_subnormal=False))


def power(frequency: Any, cutoff: float) -> Any:
    """|H|² = 1 / (1 + (tan πf / tan πf_c)⁶), frequencies as shares of the rate."""
    return 1 / (1 + (np.tan(np.pi * frequency) / np.tan(np.pi * cutoff)) ** 6)


@given(SEED, st.floats(3, 80), st.floats(-5, 5))
def test_filter_is_linear_and_takes_each_column_by_itself(
    seed: int, cutoff: float, a: float
) -> None:
    x, y = np.cumsum(np.random.default_rng(seed).normal(size=(2, 1500, 2)), axis=1)
    sections = lowpass(cutoff, RATE)
    both, one, other = (zero_phase(z, sections) for z in (a * x + y, x, y))
    np.testing.assert_allclose(both, a * one + other, rtol=0, atol=1e-9 * (1 + np.abs(x).max()))
    np.testing.assert_array_equal(zero_phase(x[:, [1]], sections), one[:, [1]])


@given(st.floats(10, 80), st.floats(1, 200))
def test_gain_of_a_sine_is_butterworths_twice_and_its_phase_none(
    cutoff: float, frequency: float
) -> None:
    """A half, -6 dB, at the cutoff."""
    t = np.arange(3000) / RATE
    sine = np.sin(2 * np.pi * frequency * t + 0.7)[:, None]
    error = zero_phase(sine, lowpass(cutoff, RATE)) - power(frequency / RATE, cutoff / RATE) * sine
    edge = int(2 * compute_lowpass_settling(cutoff) * RATE) + 1
    np.testing.assert_allclose(error[edge:-edge], 0, atol=1e-6)


@pytest.mark.parametrize(("cutoff", "rate"), [(5.0, 200.0), (15.0, 1e3), (90.0, 1e3)])
def test_an_edge_is_forgotten_after_the_settling_time(cutoff: float, rate: float) -> None:
    """To 1e-4 of its size, on both sides of it, and not much sooner."""
    away = compute_lowpass_settling(cutoff) * rate
    distance = np.abs(np.arange(-3 * int(away), 3 * int(away)) + 0.5)
    edge = np.repeat([0.0, 1.0], len(distance) // 2)
    error = np.abs(zero_phase(edge[:, None], lowpass(cutoff, rate))[:, 0] - edge)
    assert error[distance > away].max() < 1e-4 < error[distance > 0.6 * away].max()


def test_a_cutoff_beyond_nyquist_is_held_below_it_and_two_constant_samples_pass() -> None:
    np.testing.assert_array_equal(lowpass(1e6, RATE), lowpass(0.45 * RATE, RATE))
    np.testing.assert_allclose(zero_phase(np.full((2, 1), 7.0), lowpass(5.0, RATE)), 7.0)


# --- Derivative and interpolation ---------------------------------------------------------------


@given(COEFFICIENTS, st.floats(1e-3, 0.1), st.integers(5, 40))
def test_derivative_of_polynomials_is_exact(
    coefficients: np.ndarray, dt: float, samples: int
) -> None:
    """Of quartics inside, of parabolas to the last sample but one, of straight lines to the last."""
    t = dt * np.arange(samples)
    for degree, edge in ((4, 2), (2, 1), (1, 0)):
        x = np.polynomial.Polynomial(coefficients[: degree + 1])
        error = differentiate(x(t)[:, None], dt)[:, 0] - x.deriv()(t)
        atol = 1e-13 * (1 + np.abs(x(t)).max()) / dt
        np.testing.assert_allclose(error[edge : samples - edge], 0, atol=atol)


@given(SEED, st.integers(4, 40), COEFFICIENTS)
def test_interpolation_is_exact_at_the_samples_and_on_parabolas_and_held_beyond(
    seed: int, samples: int, coefficients: np.ndarray
) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.2, 1, samples))
    x = rng.normal(size=(samples, 2))
    held = resample(t, x, np.array([t[0] - 1, *np.repeat(t, 2), t[-1] + 1]))
    np.testing.assert_allclose(held, x[[0, *np.repeat(np.arange(samples), 2), -1]], atol=1e-14)
    for degree, (start, end) in ((1, t[[0, -1]]), (2, t[[1, -2]])):
        at = np.linspace(start, end, 60)
        polynomial = np.polynomial.Polynomial(coefficients[: degree + 1])
        found = resample(t, polynomial(t)[:, None], at)[:, 0]
        atol = 1e-12 * (1 + np.abs(polynomial(t)).max())
        np.testing.assert_allclose(found, polynomial(at), rtol=0, atol=atol)


# --- Noise --------------------------------------------------------------------------------------


@given(SEED, st.floats(1e-3, 1e3))
def test_white_noise_is_measured_beneath_smooth_signals_and_jumps(seed: int, unit: float) -> None:
    """Sines of up to 3 Hz at 1 kHz."""
    smooth = np.sin(np.outer(np.arange(20_000) * 1e-3, [2.0, 9.0, 18.0]))
    noise = 0.1 * np.random.default_rng(seed).standard_normal(smooth.shape)
    plain = noise_std(smooth + noise)
    np.testing.assert_allclose(plain, 0.1, rtol=0.1)
    np.testing.assert_allclose(noise_std(unit * (smooth + noise)), unit * plain, rtol=1e-6)
    jumping = 100 * (smooth > 0.5) + noise
    np.testing.assert_allclose(noise_std(jumping), 0.1, rtol=0.1)


@given(SEED, st.floats(0.003, 0.05), st.integers(12, 40))
def test_jumps_of_a_torque_that_chatters_are_none_of_its_noise(
    seed: int, std: float, every: int
) -> None:
    """However often its sign changes; of a torque that does not chatter nothing is left out."""
    k = np.arange(4000)[:, None]
    noise = std * np.random.default_rng(seed).normal(size=k.shape)
    chatter = 2.0 * (k // every % 2) - 1.0
    np.testing.assert_allclose(signals.jumping_noise_std(chatter + noise), std, rtol=0.1)
    calm = np.sin(k / 300) + noise
    np.testing.assert_array_equal(signals.jumping_noise_std(calm), noise_std(calm))


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_gain_of_noise_is_parsevals(derivatives: int) -> None:
    """gain² = mean over all frequencies of |H|⁴ |D|²ᵈ, D = i (8 sin w - sin 2w) / (6 dt)."""
    w = (np.arange(200_000) + 0.5) * np.pi / 200_000
    slope = (8 * np.sin(w) - np.sin(2 * w)) / 6 * 1000
    squares = power(w / (2 * np.pi), 0.015) ** 2 * slope ** (2 * derivatives)
    gain = signals.compute_noise_gain(lowpass(15.0, 1000.0), 1000.0, derivatives)
    assert gain == pytest.approx(np.sqrt(squares.mean()), rel=1e-6)
