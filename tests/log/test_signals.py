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


def wander(seed: int, samples: int = 1500, columns: int = 3) -> np.ndarray:
    """Anything at all: white noise on a random walk."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(samples, columns)) + np.cumsum(
        rng.normal(size=(samples, columns)), axis=0
    )


def inside(signal: np.ndarray, cutoff: float, times: float = 2.0) -> np.ndarray:
    """The samples that no edge reaches."""
    edge = int(times * compute_lowpass_settling(cutoff) * RATE) + 1
    return signal[edge:-edge]


# --- the filter -----------------------------------------------------------------------------------------------------


@given(SEED, CUTOFF, st.floats(-5, 5), st.floats(-5, 5))
def test_filter_is_linear(seed: int, cutoff: float, a: float, b: float) -> None:
    x = wander(seed)
    y = wander(seed + 1)
    sections = lowpass(cutoff, RATE)
    mixed = zero_phase(a * x + b * y, sections)
    parts = a * zero_phase(x, sections) + b * zero_phase(y, sections)
    np.testing.assert_allclose(
        mixed, parts, rtol=0, atol=1e-9 * (1 + np.abs(x).max() + np.abs(y).max())
    )


@given(SEED, CUTOFF)
def test_filter_takes_each_column_by_itself(seed: int, cutoff: float) -> None:
    x = wander(seed)
    sections = lowpass(cutoff, RATE)
    for j in range(3):
        np.testing.assert_array_equal(
            zero_phase(x, sections)[:, j], zero_phase(x[:, [j]], sections)[:, 0]
        )


@given(SEED, st.floats(10, 80))
def test_filter_does_not_know_which_way_time_runs(seed: int, cutoff: float) -> None:
    x = wander(seed)
    sections = lowpass(cutoff, RATE)
    there = zero_phase(x, sections)
    back = zero_phase(x[::-1], sections)[::-1]
    np.testing.assert_allclose(
        inside(there, cutoff), inside(back, cutoff), rtol=0, atol=1e-7 * np.abs(x).max()
    )


@given(CUTOFF)
def test_impulse_response_is_even_and_sums_to_one(cutoff: float) -> None:
    impulse = np.zeros((4001, 1))
    impulse[2000] = 1.0
    response = zero_phase(impulse, lowpass(cutoff, RATE))[:, 0]
    np.testing.assert_allclose(response, response[::-1], atol=1e-12)
    assert response.sum() == pytest.approx(1.0, abs=1e-9)


@given(CUTOFF, st.floats(-1e3, 1e3), st.integers(2, 1500))
def test_constants_pass_whole(cutoff: float, level: float, samples: int) -> None:
    constant = np.full((samples, 2), level)
    np.testing.assert_allclose(
        zero_phase(constant, lowpass(cutoff, RATE)), constant, rtol=1e-9, atol=1e-9
    )


@given(st.floats(10, 80), st.floats(-10, 10), st.floats(-100, 100))
def test_straight_lines_pass_whole_away_from_the_ends(
    cutoff: float, level: float, slope: float
) -> None:
    line = (level + slope * np.arange(1500) / RATE)[:, None]
    error = zero_phase(line, lowpass(cutoff, RATE)) - line
    np.testing.assert_allclose(inside(error, cutoff), 0, atol=1e-7 * (1 + abs(slope)))


@given(st.floats(10, 80), st.floats(1, 200))
def test_gain_of_a_sine_is_butterworths_twice_and_its_phase_none(
    cutoff: float, frequency: float
) -> None:
    """|H|² = 1 / (1 + (tan(πf/r) / tan(πf_c/r))⁶): a half, -6 dB, at the cutoff."""
    t = np.arange(3000) / RATE
    sine = np.sin(2 * np.pi * frequency * t + 0.7)[:, None]
    gain = 1 / (1 + (np.tan(np.pi * frequency / RATE) / np.tan(np.pi * cutoff / RATE)) ** 6)
    error = zero_phase(sine, lowpass(cutoff, RATE)) - gain * sine
    np.testing.assert_allclose(inside(error, cutoff), 0, atol=1e-6)


@pytest.mark.parametrize(
    ("cutoff", "rate"), [(5.0, 200.0), (15.0, 200.0), (5.0, 1e3), (15.0, 1e3), (90.0, 1e3)]
)
def test_an_edge_is_forgotten_after_the_settling_time(cutoff: float, rate: float) -> None:
    """To 1e-4 of its size, on both sides of it, and not much sooner, for cutoffs up to a tenth of the rate."""
    away = compute_lowpass_settling(cutoff) * rate
    half = int(3 * compute_lowpass_settling(cutoff) * rate)
    edge = (np.arange(2 * half) >= half).astype(float)[:, None]
    error = np.abs(zero_phase(edge, lowpass(cutoff, rate)) - edge)[:, 0]
    distance = np.abs(np.arange(2 * half) - half + 0.5)
    assert error[distance > away].max() < 1e-4
    assert error[distance > 0.6 * away].max() > 1e-4


def test_a_cutoff_beyond_the_samples_is_held_below_nyquist() -> None:
    np.testing.assert_array_equal(lowpass(1e6, RATE), lowpass(0.45 * RATE, RATE))


# --- derivative and interpolation -----------------------------------------------------------------------------------


@given(COEFFICIENTS, st.floats(1e-3, 0.1), st.integers(5, 40))
def test_derivative_of_a_quartic_is_exact_inside(
    coefficients: np.ndarray, dt: float, samples: int
) -> None:
    t = dt * np.arange(samples)
    polynomial = np.polynomial.Polynomial(coefficients)
    slope = differentiate(polynomial(t)[:, None], dt)[:, 0]
    scale = 1 + np.abs(polynomial(t)).max()
    np.testing.assert_allclose(
        slope[2:-2], polynomial.deriv()(t)[2:-2], rtol=0, atol=1e-13 * scale / dt
    )


@given(COEFFICIENTS, st.floats(1e-3, 0.1), st.integers(3, 40))
def test_derivative_next_to_the_ends(coefficients: np.ndarray, dt: float, samples: int) -> None:
    """Straight lines to the last sample, parabolas to the last but one."""
    t = dt * np.arange(samples)
    for degree, rows in ((1, slice(None)), (2, slice(1, -1))):
        polynomial = np.polynomial.Polynomial(coefficients[: degree + 1])
        slope = differentiate(polynomial(t)[:, None], dt)[:, 0]
        scale = 1 + np.abs(polynomial(t)).max()
        np.testing.assert_allclose(
            slope[rows], polynomial.deriv()(t)[rows], rtol=0, atol=1e-13 * scale / dt
        )


@given(st.floats(1, 40))
def test_derivative_of_a_sine_errs_as_stated(frequency: float) -> None:
    """By (ω dt)⁴/30 of itself, to leading order."""
    dt = 1e-3
    omega = 2 * np.pi * frequency
    t = np.arange(2000) * dt
    error = differentiate(np.sin(omega * t)[:, None], dt)[2:-2, 0] - omega * np.cos(omega * t)[2:-2]
    stated = (omega * dt) ** 4 / 30 * omega
    assert np.abs(error).max() == pytest.approx(stated, rel=0.06, abs=1e-11)


@st.composite
def grids(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Uneven times and a finer, shifted grid within them."""
    rng = np.random.default_rng(draw(SEED))
    t = np.cumsum(rng.uniform(0.2, 1, draw(st.integers(4, 40))))
    return t, np.sort(rng.uniform(t[0], t[-1], draw(st.integers(1, 60))))


@given(grids(), COEFFICIENTS)
def test_interpolation_is_exact_at_the_samples_and_on_parabolas(
    case: tuple[np.ndarray, np.ndarray], coefficients: np.ndarray
) -> None:
    t, grid = case
    anything = np.random.default_rng(len(t)).normal(size=(len(t), 2))
    np.testing.assert_allclose(
        resample(t, anything, np.repeat(t, 2)), np.repeat(anything, 2, axis=0), atol=1e-14
    )
    within = grid[(grid > t[1]) & (grid < t[-2])]
    for degree, at in ((1, grid), (2, within)):
        polynomial = np.polynomial.Polynomial(coefficients[: degree + 1])
        scale = 1 + np.abs(polynomial(t)).max()
        np.testing.assert_allclose(
            resample(t, polynomial(t)[:, None], at)[:, 0],
            polynomial(at),
            rtol=0,
            atol=1e-12 * scale,
        )


@given(st.floats(-5, 5), st.floats(0.01, 1))
def test_interpolation_of_a_cubic_errs_by_a_sixtieth_of_its_third_difference(
    third: float, h: float
) -> None:
    """Central slopes err by h² f‴/6, so the curve by h³ f‴/6 · s (1 - s) (1 - 2s): at most 0.016 h³ f‴."""
    t = h * np.arange(12)
    s = np.linspace(0, 1, 21)[:-1]
    grid = (h * (np.arange(2, 8)[:, None] + s)).ravel()
    error = resample(t, third * t[:, None] ** 3 / 6, grid)[:, 0] - third * grid**3 / 6
    expected = np.tile(third * h**3 / 6 * s * (1 - s) * (1 - 2 * s), 6)
    np.testing.assert_allclose(error, expected, rtol=0, atol=1e-12 * (1 + abs(third) * t[-1] ** 3))


def test_interpolation_holds_the_ends() -> None:
    t = np.arange(5.0)
    signal = np.random.default_rng(1).normal(size=(5, 2))
    ends = resample(t, signal, np.array([-3.0, -1e-9, 4.0 + 1e-9, 99.0]))
    np.testing.assert_allclose(ends, signal[[0, 0, -1, -1]], atol=1e-14)


def test_times_that_are_the_grid_change_nothing() -> None:
    t = np.arange(5.0)
    signal = np.random.default_rng(2).normal(size=(5, 2))
    np.testing.assert_array_equal(resample(t, signal, t + 1e-12), signal)


# --- noise ----------------------------------------------------------------------------------------------------------


def smooth(seed: int, samples: int = 20_000) -> np.ndarray:
    """A few sines of up to 3 Hz, sampled at 1 kHz."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples)[:, None] * 1e-3
    frequency = rng.uniform(0.2, 3, (2, 5))
    phase = rng.uniform(0, 6, (2, 5))
    return np.stack(
        [np.sin(2 * np.pi * f * t + p).sum(axis=1) for f, p in zip(frequency, phase)], axis=1
    )


@given(SEED, st.floats(-5, 1))
def test_white_noise_on_a_smooth_signal_is_measured(seed: int, exponent: float) -> None:
    std = 10.0**exponent * np.array([1.0, 3.0])
    noise = std * np.random.default_rng(seed).standard_normal((20_000, 2))
    np.testing.assert_allclose(noise_std(smooth(seed) + noise), std, rtol=0.1)


@pytest.mark.parametrize("step", [3e-4, 1e-3, 3e-3])
def test_quantisation_counts_as_its_step_over_root_twelve(step: float) -> None:
    quantised = np.round(smooth(1) / step) * step
    np.testing.assert_allclose(noise_std(quantised), step / np.sqrt(12), rtol=0.1)


def test_a_smooth_signal_has_no_noise() -> None:
    """The third difference of 3 Hz at 1 kHz is 7e-6 of its size."""
    assert (noise_std(smooth(2)) < 1e-5).all()
    np.testing.assert_array_equal(noise_std(np.ones((7, 2))), [0, 0])


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


@pytest.mark.parametrize("cutoff", [5.0, 15.0, 45.0])
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_gain_of_noise_is_parsevals(cutoff: float, derivatives: int) -> None:
    """gain² = mean over all frequencies of |H|⁴ |D|²ᵈ, D = i (8 sin w - sin 2w) / (6 dt)."""
    w = (np.arange(200_000) + 0.5) * np.pi / 200_000
    power = 1 / (1 + (np.tan(w / 2) / np.tan(np.pi * cutoff / 1000)) ** 6) ** 2
    slope = (8 * np.sin(w) - np.sin(2 * w)) / 6 * 1000
    expected = np.sqrt((power * slope ** (2 * derivatives)).mean())
    assert signals.compute_noise_gain(
        lowpass(cutoff, 1000.0), 1000.0, derivatives
    ) == pytest.approx(expected, rel=1e-6)
