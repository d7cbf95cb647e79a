"""Stretches that stand for a long log: what a diagnosis costs grows with the time, what it tells with its root."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimbal_pin.estimation.rows.filtering import FINE
from gimbal_pin.log.log import Log

USED = 120.0
"""Time that is looked at, s, or as many rows as that has at `FINE`."""
COUNT = 8
"""Stretches: 15 s each, forty times what filters lose at their ends; a drift is seen at eight times."""
LONG = 2.0
"""Logs of so many times that are not looked at as a whole: what is left out between two stretches is then a pause."""


class Chosen(NamedTuple):
    """A log to look at, and what was used of a longer one: nothing to be said where it is the whole."""

    log: Log
    note: str = ""


def chosen(log: Log, used: float = USED, count: int = COUNT) -> Chosen:
    """Return stretches that last `used` seconds together, spread evenly over the rows, the first and the last included.

    They are one log with pauses, so that filters end there and no time is lost. A log of less than `LONG` times that
    is returned as it is.
    """
    rows = round(used / count / min(log.dt if len(log) > 1 else np.inf, 1.0 / FINE))
    if len(log) <= LONG * count * rows:
        return Chosen(log)
    starts = np.linspace(0, len(log) - rows, count).round().astype(int)
    note = f"{log.name}: used {count} stretches of {rows * log.dt:.3g} s out of {len(log) * log.dt / 60:.3g} min"
    return Chosen(log.part((starts[:, None] + np.arange(rows)).ravel()), note)
