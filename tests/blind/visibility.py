"""How much of an effect could be seen at all: what a refit cannot absorb, against what the sensors blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from .rigs import Array
from .rnea import inverse_dynamics, regressor

CUTOFF_HZ = 20.0
GRID_HZ = 125.0


@dataclass(frozen=True)
class Channels:
    """What sensors showed (or would have shown without noise), (N, n): angle, rate or None, torque."""

    q: Array
    v: Array | None
    tau: Array


def blocks(x, rate):
    """Means over blocks of samples, down to about GRID_HZ."""
    size = max(1, round(rate / GRID_HZ))
    rows = len(x) // size
    return x[: rows * size].reshape(rows, size, *x.shape[1:]).mean(axis=1)


def grid_rate(rate):
    """The coarse grid's rate, Hz."""
    return rate / max(1, round(rate / GRID_HZ))


def smooth(x, rate):
    """Zero-phase third-order low-pass at CUTOFF_HZ, on the coarse grid."""
    return sosfiltfilt(butter(3, CUTOFF_HZ, fs=grid_rate(rate), output="sos"), x, axis=0)


def inner(x, rate):
    """Without a tenth of a second at either end, where a filter has seen too little."""
    margin = max(1, round(0.1 * grid_rate(rate)))
    return x[margin:-margin]


def rms(x):
    """√mean of squares down the samples, (n,)."""
    return np.sqrt(np.mean(x**2, axis=0))


def baseline_columns(rig, ledger, rate, trusted):
    """Columns of the refitted model, (N', n, p): rigid (unless trusted), Coulomb with true stick, viscous."""
    q, v, a = (blocks(x, rate) for x in (ledger.q, ledger.v, ledger.a))
    sign = blocks(ledger.dry / np.maximum(rig.coulomb, 1e-12), rate)
    friction = [x[:, :, None] * np.eye(len(rig.links)) for x in (sign, v)]
    rigid = [] if trusted else [regressor(rig, q, v, a)]
    return np.concatenate([*rigid, *friction], axis=2)


def independent(columns):
    """Those columns (N, p) that are not next to nothing, each of length one."""
    scale = np.linalg.norm(columns, axis=0)
    used = columns[:, scale > 1e-9 * scale.max(initial=0.0)]
    return used / np.linalg.norm(used, axis=0)


def projected(rig, ledger, rate, trusted):
    """The effect, smoothed: its rms per joint after the baseline has absorbed what it can, (n,)."""
    columns = baseline_columns(rig, ledger, rate, trusted)
    rows, n, p = columns.shape
    flat = inner(smooth(columns.reshape(rows, n * p), rate), rate).reshape(-1, p)
    effect = inner(smooth(blocks(ledger.effect, rate), rate), rate)
    used = independent(flat)
    fit = np.linalg.lstsq(used, effect.reshape(-1), rcond=1e-9)[0]
    return rms(effect - (used @ fit).reshape(-1, n))


def residual(rig, shown, rate):
    """Smoothed torque less the true rigid and viscous model on these channels, and the smoothed acceleration."""
    full = shown.v if shown.v is not None else np.gradient(shown.q, 1.0 / rate, axis=0)
    q, v, tau = (smooth(blocks(x, rate), rate) for x in (shown.q, full, shown.tau))
    a = np.gradient(v, 1.0 / grid_rate(rate), axis=0)
    left = tau - inverse_dynamics(rig, q, v, a) - rig.viscous * v
    return inner(left, rate), inner(a, rate)


def noise_of(rig, noisy, clean, rate):
    """Return the torque balance of the true model by sensor noise alone (N, n), and its share of the acceleration."""
    left, a = residual(rig, noisy, rate)
    true_left, true_a = residual(rig, clean, rate)
    return left - true_left, rms(a - true_a) / np.maximum(rms(true_a), 1e-12)


# in coloured noise: effect and baseline whitened by the noise's true spectrum


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


@dataclass(frozen=True)
class Blur:
    """Effect of sensor noise on each joint, (n,): torque balance (N m rms, smoothed) and share of the acceleration.

    `noise` is its spectrum where it is not white."""

    floor: Array
    acceleration: Array
    noise: Spectrum | None = None


def whitened(x, spectrum, rate):
    """Fourier coefficients of x (N, n, p) up to CUTOFF_HZ, such that this noise's have a mean square of one."""
    window = np.hanning(len(x))[:, None, None]
    hertz = np.fft.rfftfreq(len(x), 1.0 / rate)
    band = hertz <= min(CUTOFF_HZ, 0.4 * rate)
    expected = 0.5 * rate * float((window**2).sum()) * spectrum.at(hertz[band])
    return np.fft.rfft(window * x, axis=0)[band] / np.sqrt(expected)[:, :, None]


def size(effect, columns, spectrum, rate):
    """Return the part of an effect (N, n) that columns (N, n, p) do not explain, over the noise, (n,).

    Both are rms over the band, of torques in N m at a rate in Hz. From three on an effect counts as visible."""
    wanted = whitened(effect[:, :, None], spectrum, rate)[:, :, 0]
    used = independent(whitened(columns, spectrum, rate).reshape(wanted.size, -1))
    table = np.vstack([used.real, used.imag])
    target = np.concatenate([wanted.real.ravel(), wanted.imag.ravel()])
    fit = np.linalg.lstsq(table, target, rcond=1e-9)[0]
    return rms(np.abs(wanted - (used @ fit).reshape(wanted.shape)))


def seen(spectrum, rig, ledger, rate, trusted):
    """Projected effect over noise of each joint, (n,), as `size` has it."""
    columns = baseline_columns(rig, ledger, rate, trusted)
    return size(blocks(ledger.effect, rate), columns, spectrum, grid_rate(rate))
