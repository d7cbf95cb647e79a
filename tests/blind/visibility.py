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
    n = len(rig.links)
    q, v, a = (blocks(x, rate) for x in (ledger.q, ledger.v, ledger.a))
    sign = blocks(ledger.dry / np.maximum(rig.coulomb, 1e-12), rate)
    friction = [x[:, :, None] * np.eye(n) for x in (sign, v)]
    rigid = [] if trusted else [regressor(rig, q, v, a)]
    return np.concatenate([*rigid, *friction], axis=2)


def projected(rig, ledger, rate, trusted):
    """The effect, smoothed: its rms per joint after the baseline has absorbed what it can, (n,)."""
    columns = baseline_columns(rig, ledger, rate, trusted)
    rows, n, p = columns.shape
    flat = inner(smooth(columns.reshape(rows, n * p), rate), rate).reshape(-1, p)
    effect = inner(smooth(blocks(ledger.effect, rate), rate), rate)
    scale = np.linalg.norm(flat, axis=0)
    used = flat[:, scale > 1e-9 * scale.max()]
    used = used / np.linalg.norm(used, axis=0)
    fit = np.linalg.lstsq(used, effect.reshape(-1), rcond=1e-9)[0]
    return rms(effect - (used @ fit).reshape(-1, n))


def residual(rig, shown, rate):
    """Smoothed torque less the true rigid and viscous model on these channels, and the smoothed acceleration."""
    full = shown.v if shown.v is not None else np.gradient(shown.q, 1.0 / rate, axis=0)
    q, v, tau = (smooth(blocks(x, rate), rate) for x in (shown.q, full, shown.tau))
    a = np.gradient(v, 1.0 / grid_rate(rate), axis=0)
    left = tau - inverse_dynamics(rig, q, v, a) - rig.viscous * v
    return inner(left, rate), inner(a, rate)


def noise_floor(rig, noisy, clean, rate):
    """What sensor noise alone leaves of the true model's torque balance (N m rms, (n,)), and its share of the
    acceleration."""
    (left, a) = residual(rig, noisy, rate)
    (true_left, true_a) = residual(rig, clean, rate)
    return rms(left - true_left), rms(a - true_a) / np.maximum(rms(true_a), 1e-12)
