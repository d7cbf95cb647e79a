"""Signals: filter, derivative, interpolation and noise obey the formulas that they are named after."""

from __future__ import annotations

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
CUTOFF = st.floats(3, 80)
SEED = st.integers(0, 2**32 - 1)
COEFFICIENTS = hnp.arrays(float, 5, elements=st.floats(-3, 3, allow_subnormal=False))


@given(SEED, CUTOFF, st.floats(-5, 5), st.floats(-5, 5))
def test_filter_is_linear_and_takes_each_column_by_itself(
    seed: int, cutoff: float, a: float, b: float
) -> None:
    x, y = np.cumsum(np.random.default_rng(seed).normal(size=(2, 1500, 3)), axis=1)
    sections = lowpass(cutoff, RATE)
    mixed = zero_phase(a * x + b * y, sections)
    parts = a * zero_phase(x, sections) + b * zero_phase(y, sections)
    scale = 1 + np.abs(x).max() + np.abs(y).max()
    np.testing.assert_allclose(mixed, parts, rtol=0, atol=1e-9 * scale)
    alone = zero_phase(x[:, [1]], sections)
    np.testing.assert_array_equal(zero_phase(x, sections)[:, [1]], alone)


@given(st.floats(10, 80), st.floats(1, 200))
def test_gain_of_a_sine_is_butterworths_twice_and_its_phase_none(
    cutoff: float, frequency: float
) -> None:
    """|H|² = 1 / (1 + (tan(πf/r) / tan(πf_c/r))⁶): a half, -6 dB, at the cutoff."""
    t = np.arange(3000) / RATE
    sine = np.sin(2 * np.pi * frequency * t + 0.7)[:, None]
    gain = 1 / (1 + (np.tan(np.pi * frequency / RATE) / np.tan(np.pi * cutoff / RATE)) ** 6)
    error = zero_phase(sine, lowpass(cutoff, RATE)) - gain * sine
    edge = int(2 * compute_lowpass_settling(cutoff) * RATE) + 1
    np.testing.assert_allclose(error[edge:-edge], 0, atol=1e-6)


@pytest.mark.parametrize(("cutoff", "rate"), [(5.0, 200.0), (15.0, 1e3), (90.0, 1e3)])
def test_an_edge_is_forgotten_after_the_settling_time(cutoff: float, rate: float) -> None:
    """To 1e-4 of its size, on both sides of it, and not much sooner."""
    away = compute_lowpass_settling(cutoff) * rate
    half = int(3 * away)
    edge = (np.arange(2 * half) >= half).astype(float)[:, None]
    error = np.abs(zero_phase(edge, lowpass(cutoff, rate)) - edge)[:, 0]
    distance = np.abs(np.arange(2 * half) - half + 0.5)
    assert error[distance > away].max() < 1e-4
    assert error[distance > 0.6 * away].max() > 1e-4


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
        polynomial = np.polynomial.Polynomial(coefficients[: degree + 1])
        slope = differentiate(polynomial(t)[:, None], dt)[:, 0]
        error = (slope - polynomial.deriv()(t))[edge : samples - edge]
        scale = 1 + np.abs(polynomial(t)).max()
        np.testing.assert_allclose(error, 0, atol=1e-13 * scale / dt)


@given(SEED, st.integers(4, 40), COEFFICIENTS)
def test_interpolation_is_exact_at_the_samples_and_on_parabolas_and_held_beyond(
    seed: int, samples: int, coefficients: np.ndarray
) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.2, 1, samples))
    anything = rng.normal(size=(samples, 2))
    twice = resample(t, anything, np.repeat(t, 2))
    np.testing.assert_allclose(twice, np.repeat(anything, 2, axis=0), atol=1e-14)
    beyond = resample(t, anything, t[[0, -1]] + [-1.0, 1.0])
    np.testing.assert_allclose(beyond, anything[[0, -1]], atol=1e-14)
    for degree, (start, end) in ((1, t[[0, -1]]), (2, t[[1, -2]])):
        at = np.linspace(start, end, 60)
        polynomial = np.polynomial.Polynomial(coefficients[: degree + 1])
        error = resample(t, polynomial(t)[:, None], at)[:, 0] - polynomial(at)
        np.testing.assert_allclose(error, 0, atol=1e-12 * (1 + np.abs(polynomial(t)).max()))


# --- Noise --------------------------------------------------------------------------------------

SMOOTH = np.column_stack([np.sin(w * np.arange(20_000) * 1e-3 + w) for w in (2.0, 9.0, 18.0)])
"""Sines of up to 3 Hz, sampled at 1 kHz."""


@given(SEED, st.floats(-5, 1))
def test_white_noise_on_a_smooth_signal_is_measured(seed: int, exponent: float) -> None:
    std = 10.0**exponent * np.array([1.0, 3.0, 1.0])
    noise = std * np.random.default_rng(seed).standard_normal(SMOOTH.shape)
    np.testing.assert_allclose(noise_std(SMOOTH + noise), std, rtol=0.1)


@given(SEED, st.floats(1e-3, 1e3), hnp.arrays(float, 3, elements=st.floats(-5, 5)))
def test_noise_follows_the_unit_and_ignores_parabolas_and_jumps(
    seed: int, unit: float, curve: np.ndarray
) -> None:
    noise = np.random.default_rng(seed).standard_normal((1000, 1))
    parabola = np.polynomial.Polynomial(curve)(np.linspace(-1, 1, 1000))[:, None]
    plain = noise_std(noise)
    np.testing.assert_allclose(noise_std(unit * (noise + parabola)), unit * plain, rtol=1e-6)
    jumping = noise + 1e3 * (np.arange(1000) > 500)[:, None]
    np.testing.assert_allclose(noise_std(jumping), plain, rtol=0.05)


@given(SEED, st.floats(0.003, 0.05), st.integers(12, 40))
def test_jumps_of_a_torque_that_chatters_are_none_of_its_noise(
    seed: int, std: float, every: int
) -> None:
    """However often its sign changes; of a torque that does not chatter nothing is left out."""
    noise = std * np.random.default_rng(seed).normal(size=(4000, 1))
    chatter = np.where(np.arange(4000) // every % 2, 1.0, -1.0)[:, None]
    np.testing.assert_allclose(signals.jumping_noise_std(chatter + noise), std, rtol=0.1)
    calm = np.sin(np.arange(4000) / 300)[:, None] + noise
    np.testing.assert_array_equal(signals.jumping_noise_std(calm), noise_std(calm))


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_gain_of_noise_is_parsevals(derivatives: int) -> None:
    """gain² = mean over all frequencies of |H|⁴ |D|²ᵈ, D = i (8 sin w - sin 2w) / (6 dt)."""
    w = (np.arange(200_000) + 0.5) * np.pi / 200_000
    power = 1 / (1 + (np.tan(w / 2) / np.tan(np.pi * 15.0 / 1000)) ** 6) ** 2
    slope = (8 * np.sin(w) - np.sin(2 * w)) / 6 * 1000
    expected = np.sqrt((power * slope ** (2 * derivatives)).mean())
    gain = signals.compute_noise_gain(lowpass(15.0, 1000.0), 1000.0, derivatives)
    assert gain == pytest.approx(expected, rel=1e-6)
