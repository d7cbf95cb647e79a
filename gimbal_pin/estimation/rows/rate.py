"""A joint's rate from its angle and its gyro."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array


def fused(derived: Array, raw_q: Array, raw_v: Array, cutoff: float, dt: float) -> tuple[Array, Array]:
    """Combine the angle's derivative with the measured rate; return rate and its standard deviation.

    The derivative of an angle with white noise σ_q is the better rate below the frequency where 2π f σ_q = σ_v, the
    measured rate above it: a complementary filter at that crossover takes each where it is better, and removes a
    gyro's bias on the way. A column of one value throughout has no noise to weigh it by and is no measurement: where
    the joint is held, the angle says so, too.
    """
    sections = signals.lowpass(cutoff, 1 / dt)
    angle_noise, rate_noise = signals.noise_std(raw_q), signals.noise_std(raw_v)
    rate = signals.zero_phase(raw_v, sections)
    rate_std = rate_noise * signals.noise_gain(sections, 1 / dt, 0)
    out = rate.copy()
    difference = derived - rate
    # The smoothed angle is wrong at its two ends; a slow crossover would carry that far inwards.
    edge = min(round(signals.settling(cutoff) / dt), len(rate) // 2 - 1)
    difference[:edge], difference[-edge:] = difference[edge], difference[-edge - 1]
    for j, (sigma_q, sigma_v) in enumerate(zip(angle_noise, rate_noise)):
        crossover = sigma_v / (2 * np.pi * max(sigma_q, 1e-12))
        measured = np.ptp(raw_v[:, j]) > 0
        if measured and crossover * dt < 1e-4:
            continue
        if not measured or crossover * dt > 0.4:
            out[:, j] = derived[:, j]
            rate_std[j] = angle_noise[j] * signals.noise_gain(sections, 1 / dt, 1)
            continue
        slow = signals.lowpass(crossover, 1 / dt)
        out[:, j] += signals.zero_phase(difference[:, j : j + 1], slow)[:, 0]
    return out, rate_std
