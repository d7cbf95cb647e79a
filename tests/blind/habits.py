"""How people move a rig: one motion several times over, a joint that turns on and on, a joint that is held still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .draws import draw_sign, log_uniform
from .rigs import Array

LONGEST_FADE = 3.0
"""Seconds in which the end of a motion goes over into its next beginning."""


@dataclass(frozen=True)
class Habit:
    """`period`, `fade`: of a repeated motion, in samples (0: not repeated); `held`: joints that stand; `turning`: a
    joint that follows `path` (N,), rad."""

    period: int = 0
    fade: int = 0
    held: tuple[int, ...] = ()
    turning: int | None = None
    path: Array | None = None

    def fold(self, x):
        """The first period of x (N, n) again and again, its end faded into its beginning."""
        if not self.period:
            return x
        once = x[: self.period].copy()
        place = np.arange(self.fade)[:, None] / self.fade
        soft = place**3 * (10.0 - 15.0 * place + 6.0 * place * place)
        once[: self.fade] = (
            soft * x[: self.fade] + (1.0 - soft) * x[self.period : self.period + self.fade]
        )
        return once[np.arange(len(x)) % self.period]

    def motion(self, q):
        """Angles (N, n), rad, as this habit has them."""
        q = self.fold(q)
        if self.held:
            q[:, self.held] = q[0, self.held]
        if self.turning is not None and self.path is not None:
            q[:, self.turning] = self.path
        return q

    def torque(self, dither):
        """Torque on top (N, n), N m: repeated with the motion, none on joints that are held."""
        dither = self.fold(dither)
        if self.held:
            dither[:, self.held] = 0.0
        return dither


def repeated(samples, repeats, rate):
    """A motion made `repeats` times within these samples, which it must divide."""
    period = samples // repeats
    return Habit(period, min(period // 2, round(LONGEST_FADE * rate)))


def turning_path(rng, t, turns):
    """An angle (N,) that travels so many revolutions at a wandering speed, in every third log back again, rad."""
    hertz = log_uniform(rng, 0.03, 0.5, 4)
    phase = rng.uniform(-np.pi, np.pi, 4)
    wander = np.sin(2.0 * np.pi * hertz * t[:, None] + phase).mean(axis=1)
    speed = (1.0 + rng.uniform(0.05, 0.9) * wander) * np.clip(t / 0.5, 0.0, 1.0)
    if rng.random() < 1.0 / 3.0:
        speed *= np.clip((rng.uniform(0.4, 0.7) * t[-1] - t) / 0.5, -1.0, 1.0)
    speed *= draw_sign(rng) * 2.0 * np.pi * turns / np.abs(speed).sum()
    return np.cumsum(speed) + rng.uniform(-np.pi, np.pi)
