"""Heat that a motor makes of its torque: copper losses go with the square of the current, as the torque with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gimbal_pin.log.log import PAUSE, Array
from gimbal_pin.rig.brief import brief

AVERAGING_TIME = 0.02
"""Time over which losses are averaged, s: of what warms over seconds nothing is lost."""
MOST_AVERAGES = 1_000_000
"""Averages of one log, however long its clock says that it is: 8 MB, `AVERAGING_TIME` up to five hours and a half."""


class Losses(NamedTuple):
    """``τ²`` of one motor since its log began, whichever part of the log the samples are of.

    Attributes:
        power: Its mean over each `step`, N² m², (M,).
        t: Time of the samples since the log began, s, (N,).
        step: Time over which it is averaged, s.
    """

    power: Array
    t: Array
    step: float = AVERAGING_TIME

    def __repr__(self) -> str:
        """See `brief`."""
        return brief(self)

    @staticmethod
    def along(t: Array, tau: Array, at: Array) -> Losses:
        """Losses of a torque held from each time to the next.

        Args:
            t: Times of the whole log, s, (L,).
            tau: Torque of the motor, N m, (L,).
            at: Times of the samples, s, (N,), on the same clock.
        """
        power = tau[:-1] ** 2
        spans = np.diff(t)
        # What a motor did in a pause nobody knows: the mean of what it did else, not what it did last.
        power[spans > PAUSE] = power.mean()
        energy = np.concatenate([[0.0], np.cumsum(power * spans)])
        step = max(AVERAGING_TIME, float(t[-1] - t[0]) / MOST_AVERAGES)
        grid = np.arange(t[0], t[-1] + step, step)
        return Losses(np.diff(np.interp(grid, t, energy)) / step, at - t[0], step)

    def warmth(self, span: float) -> Array:
        """Return x of ``span dx/dt = τ² - x`` from cold, N² m², (N,), exact for losses constant over each step.

        A motor on a mount that stays cold: one thermal resistance and one capacity (IEC 60034-1).
        """
        kept = np.exp(-self.step / span)
        warm = np.concatenate([[0.0], lfilter([1.0 - kept], [1.0, -kept], self.power)])
        return np.asarray(np.interp(self.t, self.step * np.arange(len(warm)), warm))
