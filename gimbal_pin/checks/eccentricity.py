"""Encoders mounted off their joint's centre, estimated from a log whose rates do not come from the angles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import fdtrc

from gimbal_pin.log.log import Array, Log

_WINDOW = 0.1
"""Time between the angles that are compared, s: long enough for a turn larger than the noise of either."""
_BLOCKS = 40
"""Blocks of windows from whose scatter the covariance is estimated."""
_CHANCE = 1e-6
"""p-value from which an encoder counts as centred."""
_CLEAR = 10.0
"""Standard deviations from zero that an eccentricity must have before angles are corrected by it."""
_LEAST = 5e-4
"""Smallest size, rad, that is corrected."""
_ITERATIONS = 8
"""Fixed-point iterations for the true angle in the sine of its own error."""


@dataclass(frozen=True)
class Eccentricity:
    """``q_read = q + a cos q + b sin q``, beside the encoder's offset, which is its error's mean over a turn.

    Attributes:
        cosine: a, rad.
        sine: b, rad.
        std: Standard deviation of its size √(a² + b²), rad.
    """

    cosine: float
    sine: float
    std: float

    @property
    def size(self) -> float:
        """√(a² + b²), rad."""
        return float(np.hypot(self.cosine, self.sine))

    @property
    def phase(self) -> float:
        """φ of ``size sin(q + φ)``, rad."""
        return float(np.arctan2(self.cosine, self.sine))

    def error(self, q: Array) -> Array:
        """What the encoder adds at the true angles q, rad, (N,)."""
        return np.asarray(self.cosine * np.cos(q) + self.sine * np.sin(q))

    def mended(self, read: Array) -> Array:
        """True angles, rad, (N,), but for the offset, of those that were read."""
        q = read
        for _ in range(_ITERATIONS):
            q = read - self.error(q)
        return q


def fit_eccentricity(t: Array, q: Array, v: Array) -> Eccentricity | None:
    """Fit ``Δq_read - ∫v dt = a Δcos q + b Δsin q + c Δt + d Δq + e Δv`` over windows; None where a, b may be zero.

    The last three take up a rate's bias, its scale, and a delay between the two sensors. The scale multiplies the
    angles, which have little noise: a regressor made of the noisy rates would bias it.

    Args:
        t: Time, s, (N,).
        q: Angles as they were read, rad, (N,).
        v: Rates of another sensor, rad/s, (N,); rates that were made from the angles show no eccentricity.
    """
    at = np.flatnonzero(np.diff(np.floor((t - t[0]) / _WINDOW), prepend=-1.0))
    turned = cumulative_trapezoid(v, t, initial=0.0)[at]
    t, q, v = t[at], q[at], v[at]
    whole = np.diff(t) < 2 * _WINDOW
    found = Eccentricity(0.0, 0.0, 0.0)
    if np.sum(whole) < 2 * _BLOCKS:
        return None
    for _ in range(_ITERATIONS):
        x = found.mended(q)
        columns = np.stack([np.cos(x), np.sin(x), t - t[0], x, v], axis=1)
        rows, target = np.diff(columns, axis=0)[whole], np.diff(q - turned)[whole]
        unit = np.linalg.norm(rows, axis=0)
        if np.any(unit == 0) or np.linalg.cond(rows / unit) > 1e6:
            return None
        beta, covariance = _fit_by_blocks(rows / unit, target)
        beta, covariance = beta / unit, covariance / np.outer(unit, unit)
        a, b = beta[:2].tolist()
        along = np.array([a, b]) / max(float(np.hypot(a, b)), 1e-300)
        found = Eccentricity(a, b, float(np.sqrt(along @ covariance[:2, :2] @ along)))
    wald = float(beta[:2] @ np.linalg.solve(covariance[:2, :2], beta[:2]))
    chance = fdtrc(2, _BLOCKS - 2, wald / 2)
    return found if chance < _CHANCE and found.size > max(_LEAST, _CLEAR * found.std) else None


def _fit_by_blocks(A: Array, b: Array) -> tuple[Array, Array]:
    """``min |A x - b|`` and the covariance of x by blocks of rows: neighbours share an angle's noise."""
    inverse = np.linalg.inv(A.T @ A)
    x = inverse @ (A.T @ b)
    starts = np.linspace(0, len(b), _BLOCKS, endpoint=False).astype(int)
    scores = np.add.reduceat(A * (b - A @ x)[:, None], starts, axis=0)
    return x, inverse @ (scores.T @ scores) @ inverse


def correct_angles(log: Log) -> tuple[Log, dict[str, Eccentricity]]:
    """Return the log with the angles mended of the joints whose encoders its rates show to be eccentric, and these."""
    if log.v is None:
        return log, {}
    each = {joint: fit_eccentricity(log.t, log.q[:, j], log.v[:, j]) for j, joint in enumerate(log.joints)}
    found = {joint: one for joint, one in each.items() if one is not None}
    if not found:
        return log, {}
    q = [found[joint].mended(x) if joint in found else x for joint, x in zip(log.joints, log.q.T)]
    return replace(log, q=np.stack(q, axis=1)), found
