"""How much of an effect can be seen in coloured noise: effect and baseline whitened by the noise's true spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rigs import Array
from .visibility import CUTOFF_HZ, baseline_columns, blocks, grid_rate


@dataclass(frozen=True)
class Spectrum:
    """One-sided power of each joint's noise, (N m)² per Hz, at frequencies (k,): (k, n)."""

    hertz: Array
    density: Array

    def at(self, hertz):
        """Between the frequencies by straight lines, (m, n)."""
        return np.stack([np.interp(hertz, self.hertz, column) for column in self.density.T], axis=1)

    def floor(self):
        """Noise rms below CUTOFF_HZ, N m, (n,)."""
        below = np.linspace(0.0, CUTOFF_HZ, 4001)
        return np.sqrt(np.trapezoid(self.at(below), below, axis=0))


def whitened(x, spectrum, rate):
    """Fourier coefficients of x (N, n, ...) up to CUTOFF_HZ, such that this noise's have a mean square of one."""
    window = np.hanning(len(x)).reshape(-1, *[1] * (x.ndim - 1))
    hertz = np.fft.rfftfreq(len(x), 1.0 / rate)
    band = hertz <= min(CUTOFF_HZ, 0.4 * rate)
    expected = 0.5 * rate * float((window**2).sum()) * spectrum.at(hertz[band])
    scale = np.sqrt(expected).reshape(*expected.shape, *[1] * (x.ndim - 2))
    return np.fft.rfft(window * x, axis=0)[band] / scale


def size(effect, columns, spectrum, rate):
    """What the columns (N, n, p) leave of the effect (N, n), N m at this rate (Hz), over the noise, each rms over the
    band: (n,). Three is what stands clear, as in white noise."""
    wanted = whitened(effect, spectrum, rate)
    shown = whitened(columns, spectrum, rate)
    flat = shown.reshape(wanted.size, -1)
    scale = np.linalg.norm(flat, axis=0)
    used = flat[:, scale > 1e-9 * scale.max(initial=0.0)]
    used = used / np.linalg.norm(used, axis=0)
    table = np.vstack([used.real, used.imag])
    target = np.concatenate([wanted.real.ravel(), wanted.imag.ravel()])
    fit = np.linalg.lstsq(table, target, rcond=1e-9)[0]
    left = wanted - (used @ fit).reshape(wanted.shape)
    return np.sqrt(np.mean(np.abs(left) ** 2, axis=0))


def seen(rig, ledger, spectrum, rate, trusted):
    """Projected effect over noise of each joint, (n,), as `size` has it."""
    columns = baseline_columns(rig, ledger, rate, trusted)
    return size(blocks(ledger.effect, rate), columns, spectrum, grid_rate(rate))
