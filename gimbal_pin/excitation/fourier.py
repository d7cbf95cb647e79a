"""Finite Fourier series that start and end at rest (Swevers et al. 1997)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Motion

LONGEST_PERIOD = 20.0
"""Longest period, s, where no number of harmonics is given: a longer motion repeats. Forty harmonics gain three per
cent in the condition number over ten, and take ten times as long to find."""

MOST_PERIODS, SHORTEST_PERIOD = 5, 4.0
"""Default number of periods of a motion, and the shortest of them, s: `count_periods`.

What differs between periods is noise, what all of them show and the model does not is structure (Swevers et al. 1997;
Pintelon and Schoukens 2012): the first has the start in it, and four are left. Five of 5 s tell the parameters of
the three bundled rigs to 0.75-0.87 times the deviations (geometric mean) that a period of 10 s leaves in the same time,
at condition numbers of 3.8-4.3 instead of 4.7-7.3, as they hold frequencies up to 1 Hz; periods of 2 s, in which an
arm within its limits cannot go far, to 0.74-1.44 times at 4.1-10.5.
"""


def count_periods(seconds: float) -> int:
    """Return how many periods a motion of so many seconds has by default: `MOST_PERIODS`, unless they get short."""
    return max(1, min(MOST_PERIODS, int(seconds / SHORTEST_PERIOD)))


@dataclass(frozen=True)
class Series:
    """``q(t) = q0 + sum_l a_l sin(l w t)/(l w) - b_l cos(l w t)/(l w)``, ``w = 2 pi / seconds``, per joint.

    So ``v = sum a_l cos + b_l sin``. The motion is periodic, and at rest at both ends (v = 0 and a = 0) if
    ``sum_l a_l = 0`` and ``sum_l l b_l = 0``; q0 is the middle of the motion, not its start.
    Coefficients are stacked ``(q0, a_1 .. a_L, b_1 .. b_L)``, one column per joint, shape (2 L + 1, n).

    Attributes:
        seconds: Period, s.
        harmonics: Number of harmonics, L.

    Raises:
        UsageError: The period is not positive, or there are under two harmonics (one alone cannot start at rest).
    """

    seconds: float
    harmonics: int

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (isfinite(self.seconds) and self.seconds > 0):
            raise UsageError(
                "seconds", f"is {self.seconds}", "give the length of the motion, over zero"
            )
        if self.harmonics < 2:
            raise UsageError(
                "harmonics",
                f"is {self.harmonics}",
                "give two or more: one alone cannot start at rest",
            )

    @staticmethod
    def of(seconds: float, harmonics: int | None = None, periods: int = 1) -> Series:
        """Return the series for a motion of `seconds`, which repeats it a whole number of times, a multiple of periods.

        With the number of harmonics left free it is five at least, and the highest has half a hertz or a little more,
        however long the motion is: inertias show by acceleration, and a fixed number would slow down a longer motion.
        """
        if periods < 1:
            raise UsageError("periods", f"is {periods}", "give one or more")
        period = seconds / periods
        if harmonics is not None or not isfinite(seconds):
            return Series(period, 5 if harmonics is None else harmonics)
        period /= max(1, ceil(period / LONGEST_PERIOD))
        return Series(period, max(5, ceil(0.5 * period)))

    @property
    def order(self) -> Array:
        """``l = 1 .. L``."""
        return np.arange(1.0, self.harmonics + 1)

    def basis(self, t: Array) -> Array:
        """Angle, rate and acceleration per unit of each coefficient at times `t` (T,), shape (3, T, 2 L + 1)."""
        omega = 2 * np.pi / self.seconds * self.order
        sin = np.sin(np.outer(t, omega))
        cos = np.cos(np.outer(t, omega))
        one = np.ones((len(t), 1))
        zero = np.zeros((len(t), 1))
        return np.stack(
            [
                np.hstack([one, sin / omega, -cos / omega]),
                np.hstack([zero, cos, sin]),
                np.hstack([zero, -sin * omega, cos * omega]),
            ]
        )

    @cached_property
    def rest(self) -> Array:
        """Orthonormal basis of the coefficients that start and end at rest, (2 L + 1, 2 L - 1)."""
        ends = np.zeros((2, 2 * self.harmonics + 1))
        ends[0, 1 : self.harmonics + 1] = 1.0
        ends[1, self.harmonics + 1 :] = self.order
        return np.linalg.qr(ends.T, mode="complete")[0][:, 2:]

    def motion(self, coefficients: Array, t: Array) -> Motion:
        """The motion of coefficients (2 L + 1, n) at times `t`, s."""
        return Motion(t, *(self.basis(t) @ coefficients))
