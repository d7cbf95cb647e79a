"""What a sensor's noise is like, whatever its colour: Gaussian, smooth over frequency, and each joint's own.

A cause outside the library may leave what no function of the motion shows: knocks, a hum, a shaken base.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.stats import kurtosis

from gimbal_pin.log import Array

RARE = 10.0
"""Excess kurtosis that no sensor's noise has: what is left comes in few moments."""
UNEVEN = 2.0
"""Excess kurtosis that no even noise has, however slow, over the hundred rows or more of a log."""
OPEN = 0.9
"""Weight of a row from which it counts there: rows that fade to nothing would look like moments of silence."""
PEAKED = 4.5
"""How far the mean of a spectrum over what its medians promise is above one if it holds lines, over that of a noise
at so many frequencies: one in ten thousand noises has as much."""
SHARED = 0.3
"""Correlation of two joints' residuals from which they have one cause."""
SMOOTH = 31
"""Frequencies over which a noise's spectrum is taken to be smooth."""
INSIDE = 0.75
"""Share of the band that is judged: the rest fades out."""
FEWEST = 40
"""Frequencies that are needed."""


def flattened(pieces: Sequence[Array]) -> list[Array]:
    """Divide each stretch, (m,), by its own smooth spectrum: noise of any smooth colour becomes white, of unit size."""
    out = []
    for x in pieces:
        spectrum = fft.rfft(x)
        inside = slice(2, int(INSIDE * len(spectrum)))
        power = uniform_filter1d(median_filter(np.abs(spectrum) ** 2, SMOOTH), SMOOTH)
        kept = np.zeros_like(spectrum)
        kept[inside] = spectrum[inside] / np.sqrt(np.maximum(power[inside], 1e-300))
        flat = fft.irfft(kept, len(x))
        out.append(flat / max(float(np.std(flat)), 1e-300))
    return out


def rare(pieces: Sequence[Array]) -> bool:
    """Whether a residual, one array per stretch, comes in few moments."""
    return float(kurtosis(np.concatenate(flattened(pieces)))) > RARE


def uneven(pieces: Sequence[Array], gates: Sequence[Array]) -> bool:
    """Whether a residual swells and fades where its gate is open, one array of each per stretch, as it stands."""
    every = np.concatenate(list(pieces))[np.concatenate(list(gates)) > OPEN]
    return len(every) >= FEWEST and float(kurtosis(every)) > UNEVEN


def peaked(pieces: Sequence[Array]) -> bool:
    """Whether a residual has lines in its spectrum.

    ``mean of P/(median of P nearby / ln 2)``: one for a noise, whose power is exponentially distributed. The steepest
    colour is taken out first, so that the medians follow.
    """
    ratios = []
    for x in pieces:
        level = x[1:] - x[:-1] * float(x[1:] @ x[:-1] / max(float(x @ x), 1e-300))
        power = np.abs(fft.rfft(level * np.hanning(len(level)))) ** 2
        power = power[3 : int(INSIDE * len(power)) : 2]  # the window ties neighbours together
        if len(power) >= FEWEST:
            ratios.append(power * np.log(2) / np.maximum(median_filter(power, SMOOTH), 1e-300))
    every = np.concatenate(ratios) if ratios else np.ones(1)
    return float(np.mean(every)) > 1 + PEAKED / np.sqrt(len(every))


def shared(pieces: Sequence[Array], others: Sequence[Array]) -> bool:
    """Whether two joints' residuals go together."""
    a, b = (np.concatenate(flattened(x)) for x in (pieces, others))
    return abs(float(np.mean(a * b))) > SHARED
