"""Zero-phase low-pass, differentiation and resampling of a log's channels."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.log.log import Array

KEPT_SHARE, _KEPT_POWER = 0.98, 0.8735
"""Share of the samples that a noise estimate keeps, and the mean square of that share of a unit Gaussian."""


def lowpass(cutoff: float, rate: float) -> Array:
    """Return the second-order sections of a Butterworth low-pass at `cutoff` Hz for samples at `rate` Hz.

    It is of third order; run forwards and backwards it falls by 6 dB at the cutoff.
    """
    return _design_lowpass(cutoff, rate).copy()


@lru_cache(maxsize=64)
def _design_lowpass(cutoff: float, rate: float) -> Array:
    """Design it once: a stream asks for the same several times a second."""
    return butter(3, min(cutoff, 0.45 * rate), fs=rate, output="sos")


def compute_lowpass_settling(cutoff: float) -> float:
    """Time after which the low-pass has forgotten an edge to about 1e-4, s: its slowest pole has half the cutoff."""
    return float(np.log(1e4) / (np.pi * cutoff))


def zero_phase(signal: Array, sections: Array) -> Array:
    """Run the sections forwards and backwards along the first axis."""
    pad = min(len(signal) - 1, 3 * 2 * len(sections) + 60)
    return sosfiltfilt(sections, signal, axis=0, padlen=pad)


def differentiate(signal: Array, dt: float) -> Array:
    """d/dt along the first axis: five-point central differences, error (ω dt)⁴/30; second order at the two ends."""
    out = np.gradient(signal, dt, axis=0, edge_order=2 if len(signal) > 2 else 1)
    if len(signal) >= 5:
        out[2:-2] = differentiate_centrally(signal, dt)
    return out


def differentiate_centrally(signal: Array, dt: float) -> Array:
    """d/dt along the first axis by five-point central differences, for all but the two samples at either end."""
    return np.asarray((8 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (12 * dt))


def resample(t: Array, signal: Array, grid: Array) -> Array:
    """Cubic (Catmull-Rom) interpolation of (t, signal) at `grid`, clamped at the ends; exact where a sample lies.

    Args:
        t: Increasing times, s, (N,).
        signal: Values, (N, k).
        grid: Times to interpolate at, s, (M,).
    """
    if len(t) == len(grid) and np.allclose(t, grid, rtol=0, atol=1e-9):
        return signal
    left = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    slope = np.gradient(signal, t, axis=0)
    width = (t[left + 1] - t[left])[:, None]
    s = np.clip((grid - t[left])[:, None] / width, 0.0, 1.0)
    start = signal[left]
    end = signal[left + 1]
    rise = (3 - 2 * s) * s * s
    return (
        start
        + rise * (end - start)
        + width * s * (1 - s) * ((1 - s) * slope[left] - s * slope[left + 1])
    )


def noise_std(signal: Array) -> Array:
    """Standard deviation of white noise or quantisation on a smooth signal, per column, from its third differences.

    Third differences remove anything smooth at the sampling rate and multiply white noise by √20. The largest two
    per cent are left out: they hold the few samples where the signal itself is not smooth.
    """
    return (
        _estimate_spread(np.diff(signal, 3, axis=0))
        if len(signal) >= 8
        else np.zeros(signal.shape[1:])
    )


def jumping_noise_std(signal: Array) -> Array:
    """`noise_std` of a signal that may jump often: no third differences across steps of more than its own rms.

    No sensor's noise is as large as what it measures. A torque that chatters in a gap changes its sign so often that
    more than two per cent of the differences hold a jump.
    """
    jumps = np.abs(np.diff(signal, axis=0)) > np.std(signal, axis=0)
    across = jumps[:-2] | jumps[1:-1] | jumps[2:]
    share = np.mean(across, axis=0) if len(across) else np.zeros(signal.shape[1:])
    out = noise_std(signal)
    for j in np.flatnonzero((share > 1 - KEPT_SHARE) & (share < 0.5)):
        out[j] = _estimate_spread(np.diff(signal[:, j], 3)[~across[:, j]])
    return out


def _estimate_spread(differences: Array) -> Array:
    """Standard deviation of the white noise that third differences are of, per column."""
    squares = np.sort(differences**2, axis=0)
    kept = squares[: max(1, int(KEPT_SHARE * len(squares)))].mean(axis=0)
    return np.asarray(np.sqrt(kept / (20.0 * _KEPT_POWER)))


def compute_noise_gain(sections: Array, rate: float, derivatives: int) -> float:
    """Standard deviation of white noise of unit size after `zero_phase` and so many derivatives."""
    return _compute_noise_gain(sections.tobytes(), rate, derivatives)


@lru_cache(maxsize=64)
def _compute_noise_gain(sections: bytes, rate: float, derivatives: int) -> float:
    """`compute_noise_gain` of the bytes of (any, 6) sections: windows of a stream ask for it several times a second."""
    impulse = np.zeros((4097, 1))
    impulse[2048] = 1.0
    response = zero_phase(impulse, np.frombuffer(bytearray(sections)).reshape(-1, 6))
    for _ in range(derivatives):
        response = differentiate(response, 1.0 / rate)
    return float(np.linalg.norm(response))
