"""What is held out of an estimate, to judge it by."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.log import Log


def split(logs: Sequence[Log], holdout: str | None, filters: Filtering) -> tuple[tuple[Log, ...], tuple[Log, ...], str]:
    """Return training logs, held-out logs, and how they were parted."""
    if not logs:
        raise UsageError("logs", "none was given", "give at least one log")
    how = holdout or ("last-third" if len(logs) == 1 else f"log:{len(logs)}")
    if how == "none":
        return tuple(logs), (), "none"
    if how == "last-third":
        halves = [thirds(log, filters) for log in logs]
        return tuple(a for a, _ in halves), tuple(b for _, b in halves), "last third"
    match = re.fullmatch(r"log:(\d+)", how)
    if not match or not 1 <= int(match[1]) <= len(logs) or len(logs) < 2:
        several = f", or log:1 to log:{len(logs)}" if len(logs) > 1 else "; log:N takes several logs"
        raise UsageError("--holdout", f"cannot be '{how}'", f"use last-third or none{several}")
    k = int(match[1]) - 1
    return (*logs[:k], *logs[k + 1 :]), (logs[k],), f"log {k + 1} of {len(logs)}"


def thirds(log: Log, filters: Filtering) -> tuple[Log, Log]:
    """Split at two thirds of the time; the filters' settling at the cut keeps a gap between the two."""
    cut = int(np.searchsorted(log.t, log.t[0] + (log.t[-1] - log.t[0]) * 2 / 3))
    return log.part(slice(0, cut)), log.part(slice(cut, None))
