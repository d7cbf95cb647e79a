"""Prescribed motion of a rig's base link, in the base link's own frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gimbal_pin.errors import LogError
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Imu, freeze
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import GRAVITY

BaseMotion = Literal["fixed", "tilted", "rotating"]
"""Motion of the base, by what the joint torques show of it: stands upright, leans or shifts, turns."""

BASE_MOTIONS: tuple[BaseMotion, ...] = ("fixed", "tilted", "rotating")
"""From the least to the greatest: each shows all parameters that the ones before it show."""

LEANS = 0.1
"""Difference of specific force from that of an upright base at rest, m/s² rms, from which the base leans."""
TURNS = 0.02
"""Variation of the rate, rad/s rms, from which the base turns; a constant one is the gyro's own bias."""
_SWAYS = 0.002
"""The same of its means over `_SWAY`, which have less of the gyro's noise: a gyro of 0.01 °/s/√Hz has 0.0004 rad/s
there, and a base that sways by more moves what it carries by more than drives err."""
_SWAY = 0.1
"""Time over which a rate is averaged to see slow turning, s."""
PLATFORM_CUTOFF = 20.0
"""Low-pass on a measured platform motion before it is prescribed, Hz."""


@dataclass(frozen=True, eq=False)
class Platform:
    """Specific force, rate and angular acceleration of the base link: with them the joint torques need no attitude.

    Attributes:
        t: Time, s, shape (N,).
        f: Specific force Rᵀ(a - g) of the base link's origin, m/s² (+9.81 up at rest), shape (N, 3).
        w: Angular rate, rad/s, shape (N, 3).
        dw: Its derivative, rad/s², shape (N, 3).
        quat: Attitude R in the world, (w, x, y, z), shape (N, 4); None where it is not known.
        seed: What repeats a drawn motion as `rng`; None of others, and where a generator was given.
    """

    t: Array
    f: Array
    w: Array
    dw: Array
    quat: Array | None = None
    seed: int | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        samples = len(np.atleast_1d(self.t))
        object.__setattr__(self, "t", freeze(self.t, (samples,), "platform: t"))
        for name, width in (("f", 3), ("w", 3), ("dw", 3), ("quat", 4)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, freeze(value, (samples, width), f"platform: {name}"))

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.t)

    @staticmethod
    def still(t: Array, roll: float = 0.0, pitch: float = 0.0) -> Platform:
        """A base at rest, upright or leaning by `roll` about its x and `pitch` about its y, rad."""
        zero = np.zeros((len(t), 3))
        return Platform.turning(t, zero + np.array([roll, pitch, 0.0]), zero, zero, zero)

    @staticmethod
    def turning(
        t: Array, angles: Array, rates: Array, accelerations: Array, acceleration: Array
    ) -> Platform:
        """``R = Rz Ry Rx``, ``f = Rᵀ(a - g)``, ``w = E ė``, ``dw = E ë + Ė ė``: a motion known by formula.

        Args:
            t: Time, s, (N,).
            angles: e, roll, pitch and yaw, rad, (N, 3).
            rates: ė, rad/s, (N, 3).
            accelerations: ë, rad/s², (N, 3).
            acceleration: a, of the base link's origin in the world, m/s², (N, 3).
        """
        attitude = Rotation.from_euler("xyz", angles)
        f = np.einsum(
            "nji,nj->ni", attitude.as_matrix(), acceleration + np.array([0.0, 0.0, GRAVITY])
        )
        w, dw = _body_rates(angles, rates, accelerations)
        return Platform(t, f, w, dw, attitude.as_quat(scalar_first=True))

    @staticmethod
    def measured(t: Array, imu: Imu, name: str, cutoff: float = PLATFORM_CUTOFF) -> Platform:
        """The motion that a base's IMU reports: low-passed at `cutoff` Hz, without phase, the rate differentiated.

        The attitude is the rate's integral, so that it agrees with it for ever; it starts from the measured attitude,
        or from where specific force points in the mean of the first second.

        Raises:
            LogError: The IMU of `name` lacks a gyro or an accelerometer, or its samples are too few to filter.
        """
        if imu.gyro is None or imu.accel is None:
            raise LogError(
                name, "holds no gyro or no accelerometer of the base", "give gyro_ and accel_ of it"
            )
        if len(t) < 8:
            raise LogError(
                name, f"holds {len(t)} samples of the platform", "give a second of motion at least"
            )
        grid = np.linspace(t[0], t[-1], len(t))
        dt = float(grid[1] - grid[0])
        sections = signals.lowpass(cutoff, 1 / dt)
        f, w = (
            signals.zero_phase(signals.resample(t, x, grid), sections)
            for x in (imu.accel, imu.gyro)
        )
        start = (
            _level_attitude(f[grid < grid[0] + 1.0].mean(axis=0))
            if imu.quat is None
            else imu.quat[0]
        )
        return Platform(grid, f, w, signals.differentiate(w, dt), integrate_attitude(w, dt, start))

    def part(self, rows: slice) -> Platform:
        """Return the samples in `rows`."""
        quat = None if self.quat is None else self.quat[rows]
        return Platform(self.t[rows], self.f[rows], self.w[rows], self.dw[rows], quat)

    def at(self, grid: Array) -> Platform:
        """Return the motion at other times, s, (M,), by cubic interpolation; exact where a sample lies."""
        f, w, dw = (signals.resample(self.t, x, grid) for x in (self.f, self.w, self.dw))
        if self.quat is None:
            return Platform(grid, f, w, dw)
        quat = signals.resample(self.t, self.quat, grid)
        return Platform(grid, f, w, dw, quat / np.linalg.norm(quat, axis=1, keepdims=True))

    def about(self, point: Array) -> Platform:
        """Return the motion that turns about another point: what was the origin's acceleration is now that point's.

        ``f' = f - ω̇×r - ω×(ω×r)``. A profile says how a platform turns and shakes, not about which of its points.

        `point`: r, in the base link's frame, m, (3,).
        """
        swing = np.cross(self.dw, point) + np.cross(self.w, np.cross(self.w, point))
        return Platform(self.t, self.f - swing, self.w, self.dw, self.quat)

    def turned(self, angles: Array, rates: Array) -> Platform:
        """Return the motion of what turns evenly on this platform: ``f' = Rᵀf``, ``w' = Rᵀw + E ė``, ``R = Rz Ry Rx``.

        Args:
            angles: e, roll, pitch and yaw against this platform, rad, (N, 3).
            rates: ė, constant, rad/s, (N, 3).
        """
        R = Rotation.from_euler("xyz", angles).as_matrix()
        f, w, dw = (np.einsum("nji,nj->ni", R, x) for x in (self.f, self.w, self.dw))
        own, change = _body_rates(angles, rates, np.zeros_like(rates))
        return Platform(self.t, f, w + own, dw + change - np.cross(own, w))

    @property
    def slow(self) -> Array:
        """The rate's means over consecutive stretches of `_SWAY`, (M, 3)."""
        span = float(self.t[-1] - self.t[0])
        count = int(min(max(span / _SWAY, 1.0), len(self)))
        starts = np.linspace(0, len(self), count, endpoint=False).astype(int)
        sizes = np.diff(np.append(starts, len(self)))
        return np.asarray(np.add.reduceat(self.w, starts, axis=0) / sizes[:, None])

    @property
    def motion(self) -> BaseMotion:
        """What kind of motion it is."""
        if _rms_variation(self.w) > TURNS or _rms_variation(self.slow) > _SWAYS:
            return "rotating"
        lean = np.sqrt(np.mean(np.sum((self.f - np.array([0.0, 0.0, GRAVITY])) ** 2, axis=1)))
        return "tilted" if lean > LEANS else "fixed"


def _rms_variation(x: Array) -> float:
    """Root mean square of what a vector, (N, 3), is off its mean."""
    return float(np.sqrt(np.sum(np.var(x, axis=0))))


def _body_rates(angles: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
    """Rate and angular acceleration in the turning frame from roll, pitch, yaw and their derivatives, (N, 3) each."""
    (roll, pitch, _) = angles.T
    (droll, dpitch, dyaw) = rates.T
    (ddroll, ddpitch, ddyaw) = accelerations.T
    sr = np.sin(roll)
    cr = np.cos(roll)
    sp = np.sin(pitch)
    cp = np.cos(pitch)
    # The turns about y and z, as the frame turned by pitch alone sees them: what roll then turns by itself.
    y = dpitch
    z = dyaw * cp
    dy = ddpitch
    dz = ddyaw * cp - dyaw * dpitch * sp
    w = [droll - dyaw * sp, y * cr + z * sr, z * cr - y * sr]
    dw = [
        ddroll - ddyaw * sp - dyaw * dpitch * cp,
        dy * cr + dz * sr + droll * w[2],
        dz * cr - dy * sr - droll * w[1],
    ]
    return np.stack(w, axis=1), np.stack(dw, axis=1)


def _level_attitude(f: Array) -> Array:
    """Attitude (w, x, y, z) without yaw whose specific force at rest points along f, (3,)."""
    roll = np.arctan2(f[1], f[2])
    pitch = np.arctan2(-f[0], np.hypot(f[1], f[2]))
    return np.asarray(Rotation.from_euler("xyz", [roll, pitch, 0.0]).as_quat(scalar_first=True))


def integrate_attitude(w: Array, dt: float, start: Array) -> Array:
    """Attitude (w, x, y, z), (N, 4), that starts at `start` and turns by the mean of two samples' rates in between."""
    turn = dt * (w[1:] + w[:-1]) / 2
    angle = np.linalg.norm(turn, axis=1)
    real = np.cos(angle / 2)
    imaginary = turn * (0.5 * np.sinc(angle / (2 * np.pi)))[:, None]
    a, b, c, d = start.tolist()
    out = [(a, b, c, d)]
    for p, (q, r, s) in zip(real.tolist(), imaginary.tolist()):
        a, b, c, d = (
            a * p - b * q - c * r - d * s,
            a * q + b * p + c * s - d * r,
            a * r - b * s + c * p + d * q,
            a * s + b * r - c * q + d * p,
        )
        out.append((a, b, c, d))
    quat = np.array(out)
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)
