"""How still the picture stands: jitter, drift, and the spectrum of the line of sight (CONTROL, "Profile S")."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.log.log import Array

SLOW = 0.2
"""Corner between jitter and drift, Hz."""
SETTLING = 2.0
"""Beginning of a run that is not counted, s."""


def split(error: Array, dt: float) -> tuple[Array, Array]:
    """Part an error, (N, k), into what moves faster than `SLOW`, by a second-order zero-phase high-pass, and the rest.

    A run too short to show such slow motion is parted at its mean.
    """
    sections = butter(2, SLOW, btype="highpass", fs=1 / dt, output="sos")
    pad = min(len(error) - 1, round(1 / SLOW / dt))
    fast = sosfiltfilt(sections, error, axis=0, padlen=pad) if len(error) * dt > 1 / SLOW / 2 else error - error.mean(0)
    return fast, error - fast


def jitter(error: Array, dt: float) -> tuple[float, float, float]:
    """Jitter rms, jitter max and drift of a line-of-sight error (e_y, e_z), rad, (N, 2).

    Drift is how far its slow part goes from where it began.
    """
    fast, slow = split(error, dt)
    size = np.hypot(*fast.T)
    return float(np.sqrt(np.mean(size**2))), float(size.max()), float(np.hypot(*(slow - slow[0]).T).max())


def cumulative(error: Array, dt: float) -> tuple[Array, Array]:
    """Root of the power above each frequency... of the fast part's both axes, rad rms, over frequency, Hz."""
    fast, _ = split(error, dt)
    power = np.sum(np.abs(np.fft.rfft(fast, axis=0)) ** 2, axis=1)
    power[1:] *= 2
    power[-1] /= 2 if len(fast) % 2 == 0 else 1
    return np.fft.rfftfreq(len(fast), dt), np.sqrt(np.cumsum(power)) / len(fast)
