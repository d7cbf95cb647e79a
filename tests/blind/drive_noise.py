"""Noise of a drive's torque: all of it where the motion is, none above, and its spectrum in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, freqz_sos, lfilter, sosfilt

from .draws import log_uniform

SETTLING_S = 3.0


@dataclass(frozen=True)
class Colour:
    """Noise of unit rms. "ar1": x' = `phi` x + e at the log's rate; "low-pass": second-order Butterworth at `hertz`."""

    kind: str
    phi: float
    hertz: float

    def _gain(self, hertz, rate):
        """|H|² of the filter that white noise goes through."""
        if self.kind == "ar1":
            return 1.0 / np.abs(1.0 - self.phi * np.exp(-2j * np.pi * hertz / rate)) ** 2
        response = freqz_sos(butter(2, self.hertz, fs=rate, output="sos"), hertz, fs=rate)[1]
        return np.abs(response) ** 2

    def _power(self, rate):
        """Variance after the filter, of white noise of variance one."""
        grid = (np.arange(200_000) + 0.5) / 200_000 * 0.5 * rate
        return float(self._gain(grid, rate).mean())

    def density(self, hertz, rate):
        """One-sided power per Hz at these frequencies; its integral up to rate / 2 is one."""
        return self._gain(hertz, rate) / (0.5 * rate * self._power(rate))

    def series(self, rng, shape, rate):
        """Samples (N, n), settled from the first one on."""
        before = round(SETTLING_S / min(self._corner(rate), 1.0) * rate)
        white = rng.normal(size=(shape[0] + before, shape[1])) / np.sqrt(self._power(rate))
        if self.kind == "ar1":
            return lfilter([1.0], [1.0, -self.phi], white, axis=0)[before:]
        return sosfilt(butter(2, self.hertz, fs=rate, output="sos"), white, axis=0)[before:]

    def _corner(self, rate):
        return -float(np.log(self.phi)) * rate / (2.0 * np.pi) if self.kind == "ar1" else self.hertz


def draw_colour(rng, rate):
    """φ of 0.9–0.99 at the log's rate, or a corner of 0.5–15 Hz."""
    hertz = log_uniform(rng, 0.5, min(15.0, 0.2 * rate))
    return Colour(str(rng.choice(["ar1", "low-pass"])), rng.uniform(0.9, 0.99), hertz)
