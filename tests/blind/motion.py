"""A base that moves along a known path: sums of sines, their derivatives, and what an IMU on it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from .draws import log_uniform
from .rigs import Array
from .rnea import GRAVITY

CHUNK = 2048
KNOT = 2e-3


@dataclass(frozen=True)
class BaseMotion:
    """x y z (m) and yaw pitch roll (rad, ZYX), each Σ a sin(ωt + φ): arrays (6, k)."""

    amplitude: Array
    omega: Array
    phase: Array

    def at(self, t):
        """Value, first and second derivative at times t (N,): three arrays (N, 6)."""
        pieces = [self._few(t[k : k + CHUNK]) for k in range(0, len(t), CHUNK)]
        return [np.concatenate(parts) for parts in zip(*pieces)]

    def _few(self, t):
        """Return value, first and second derivative at few enough times for the cache."""
        angle = self.omega * t[:, None, None] + self.phase
        wave = self.amplitude * np.sin(angle)
        slope = self.amplitude * self.omega * np.cos(angle)
        bend = self.omega * self.omega * wave
        return wave.sum(axis=2), slope.sum(axis=2), -bend.sum(axis=2)

    def sampled(self, dt, seconds):
        """The path at every half step, by splines through every KNOT: (t) → position, rate, acceleration of the six
        base coordinates, which the simulation loop follows."""
        knots = np.arange(0.0, seconds + 10.0 * KNOT, KNOT)
        spacing = 0.5 * dt
        t = np.arange(int(2.0 * seconds / dt) + 4) * spacing
        table = CubicSpline(knots, np.hstack(self.at(knots)))(t)

        def path(t):
            row = table[round(t / spacing)].tolist()
            return row[:6], row[6:12], row[12:]

        return path

    def imu(self, t):
        """Rate (rad/s) and specific force (m/s²) in the base's frame at times t: two arrays (N, 3)."""
        value, rate, second = self.at(t)
        dyaw, dpitch, droll = rate[:, 3:].T
        (sy, sp, sr), (cy, cp, cr) = (turn(value[:, 3:].T) for turn in (np.sin, np.cos))
        gyro = [droll - sp * dyaw, cr * dpitch + sr * cp * dyaw, cr * cp * dyaw - sr * dpitch]
        attitude = np.array([
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ])  # fmt: skip
        force = second[:, :3] - GRAVITY
        return np.stack(gyro, axis=1), np.einsum("jit,tj->ti", attitude, force)


def _band(rng, low, high, count, rms):
    """`count` sines in a band of Hz, log-uniform, with this rms together: amplitude, ω, phase (3, count)."""
    omega = 2.0 * np.pi * log_uniform(rng, low, high, (3, count))
    amplitude = np.full((3, count), rms * np.sqrt(2.0 / count))
    return amplitude, omega, rng.uniform(-np.pi, np.pi, (3, count))


def _joined(travel, attitude):
    """Bands of acceleration (m/s²) and of attitude (rad) as one motion."""
    meters = [(a / w**2, w, p) for a, w, p in travel]
    halves = [[np.hstack(parts) for parts in zip(*bands)] for bands in (meters, attitude)]
    width = max(parts[0].shape[1] for parts in halves)
    padded = [[np.pad(x, ((0, 0), (0, width - x.shape[1]))) for x in parts] for parts in halves]
    return BaseMotion(*map(np.vstack, zip(*padded)))


def profile_s(rng, size):
    """5° at 0.2–1 Hz and 0.3° at 4–12 Hz of attitude, 1 m/s² at 0.2–2 Hz, rms per axis, all times `size`."""
    sway = _band(rng, 0.2, 1.0, 20, np.radians(5.0) * size)
    shake = _band(rng, 4.0, 12.0, 40, np.radians(0.3) * size)
    return _joined([_band(rng, 0.2, 2.0, 20, size)], [sway, shake])


def handheld(rng, size):
    """A walk: lines at a step rate near 1.8 Hz and its multiples, above a slow sway."""
    step = rng.uniform(1.5, 2.1)

    def line(multiple, rms):
        return _band(rng, 0.99 * step * multiple, 1.01 * step * multiple, 2, rms)

    travel = [line(k, size * rms) for k, rms in ((1, 1.5), (2, 0.8), (3, 0.3))]
    sway = _band(rng, 0.1, 0.6, 12, np.radians(4.0) * size)
    shake = [line(k, np.radians(rms) * size) for k, rms in ((1, 1.0), (2, 0.6))]
    return _joined(travel, [sway, *shake])
