"""A base that moves along a known path: sums of sines, their derivatives, and what an IMU on it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from .draws import log_uniform
from .rigs import Array
from .rnea import GRAVITY

CHUNK, KNOT = 2048, 2e-3


@dataclass(frozen=True)
class BaseMotion:
    """x y z (m) and yaw pitch roll (rad, ZYX), each Σ a sin(ωt + φ): arrays (6, k)."""

    amplitude: Array
    omega: Array
    phase: Array

    def at(self, t):
        """Value, first and second derivative at times t (N,): three arrays (N, 6)."""
        pieces = [self._few(t[k : k + CHUNK]) for k in range(0, len(t), CHUNK)]
        value, rate, second = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        return value, rate, second

    def _few(self, t):
        angle = self.omega * t[:, None, None] + self.phase
        a = self.amplitude
        w = self.omega
        wave = a * np.sin(angle)
        slope = a * w * np.cos(angle)
        return wave.sum(axis=2), slope.sum(axis=2), -(w * w * wave).sum(axis=2)

    def sampled(self, dt, seconds):
        """The path at every half step, by splines through every KNOT: what the simulation loop follows."""
        knots = np.arange(0.0, seconds + 10.0 * KNOT, KNOT)
        t = np.arange(int(2.0 * seconds / dt) + 4) * 0.5 * dt
        return SampledPath(0.5 * dt, CubicSpline(knots, np.hstack(self.at(knots)))(t))

    def imu(self, t):
        """Rate (rad/s) and specific force (m/s²) in the base's frame at times t: two arrays (N, 3)."""
        value, rate, second = self.at(t)
        yaw, pitch, roll = value[:, 3:].T
        dyaw, dpitch, droll = rate[:, 3:].T
        sr = np.sin(roll)
        cr = np.cos(roll)
        sp = np.sin(pitch)
        cp = np.cos(pitch)
        gyro = np.stack(
            [droll - sp * dyaw, cr * dpitch + sr * cp * dyaw, cr * cp * dyaw - sr * dpitch], axis=1
        )
        return gyro, np.einsum("tji,tj->ti", _attitude(yaw, pitch, roll), second[:, :3] - GRAVITY)


@dataclass(frozen=True)
class SampledPath:
    """(t) → position, rate, acceleration of the six base coordinates, on a grid of half steps; table (N, 18)."""

    spacing: float
    table: Array

    def __call__(self, t):
        row = self.table[round(t / self.spacing)].tolist()
        return row[:6], row[6:12], row[12:]


def _attitude(yaw, pitch, roll):
    """R = Rz(yaw) Ry(pitch) Rx(roll), (N, 3, 3)."""
    sy, cy, sp, cp, sr, cr = (f(x) for x in (yaw, pitch, roll) for f in (np.sin, np.cos))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _band(rng, low, high, count, rms):
    """`count` sines in a band of Hz, log-uniform, with this rms together: amplitude, ω, phase (3, count)."""
    omega = 2.0 * np.pi * log_uniform(rng, low, high, (3, count))
    return (
        np.full((3, count), rms * np.sqrt(2.0 / count)),
        omega,
        rng.uniform(-np.pi, np.pi, (3, count)),
    )


def _joined(travel, attitude):
    """Bands of acceleration (m/s²) and of attitude (rad) as one motion."""
    meters = [(a / w**2, w, p) for a, w, p in travel]
    upper, lower = (
        [np.hstack(parts) for parts in zip(*bands, strict=True)] for bands in (meters, attitude)
    )
    width = max(upper[0].shape[1], lower[0].shape[1])
    padded = [
        np.vstack([_pad(x, width), _pad(y, width)]) for x, y in zip(upper, lower, strict=True)
    ]
    return BaseMotion(*padded)


def _pad(x, width):
    return np.pad(x, ((0, 0), (0, width - x.shape[1])))


def profile_s(rng, size):
    """5° at 0.2–1 Hz and 0.3° at 4–12 Hz of attitude, 1 m/s² at 0.2–2 Hz, rms per axis, all times `size`."""
    attitude = [
        _band(rng, 0.2, 1.0, 20, np.radians(5.0) * size),
        _band(rng, 4.0, 12.0, 40, np.radians(0.3) * size),
    ]
    return _joined([_band(rng, 0.2, 2.0, 20, size)], attitude)


def handheld(rng, size):
    """A walk: lines at a step rate near 1.8 Hz and its multiples, above a slow sway."""
    step = rng.uniform(1.5, 2.1)
    lines = [
        _band(rng, 0.99 * step * k, 1.01 * step * k, 2, size * rms)
        for k, rms in ((1, 1.5), (2, 0.8), (3, 0.3))
    ]
    sway = [_band(rng, 0.1, 0.6, 12, np.radians(4.0) * size)]
    shake = [
        _band(rng, 0.99 * step * k, 1.01 * step * k, 2, np.radians(rms) * size)
        for k, rms in ((1, 1.0), (2, 0.6))
    ]
    return _joined(lines, sway + shake)
