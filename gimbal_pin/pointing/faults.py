"""Sensors that fail, to see what a controller does then."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, nan
from typing import Literal

import numpy as np

from gimbal_pin.pointing.seen import Seen

Channel = Literal["q", "gyro", "w", "f", "links"]
"""The encoders, the camera's gyro, the platform's gyro, the platform's accelerometer, the gyros in between."""


@dataclass(frozen=True)
class Frozen:
    """A sensor that repeats its last reading.

    Attributes:
        channels: Which.
        start: Since when, s.
        end: Until when, s.
    """

    channels: tuple[Channel, ...]
    start: float
    end: float = inf

    def apply(self, seen: Seen, before: Seen | None) -> Seen | None:
        """Return the sample with the readings before it."""
        if before is None or not self.start <= seen.t < self.end:
            return seen
        return seen._replace(**{name: getattr(before, name) for name in self.channels})


@dataclass(frozen=True)
class Missing:
    """A sensor that says NaN.

    Attributes:
        channels: Which.
        start: Since when, s.
        end: Until when, s.
    """

    channels: tuple[Channel, ...]
    start: float
    end: float = inf

    def apply(self, seen: Seen, before: Seen | None) -> Seen | None:
        """Return the sample without these readings."""
        if not self.start <= seen.t < self.end:
            return seen
        return seen._replace(**{name: np.full_like(getattr(seen, name), nan) for name in self.channels})


@dataclass(frozen=True)
class Dropped:
    """Samples that never arrive: the drive holds its last command.

    Attributes:
        start: From when on, s.
        end: Until when, s.
    """

    start: float
    end: float

    def apply(self, seen: Seen, before: Seen | None) -> Seen | None:
        """Return nothing."""
        return None if self.start <= seen.t < self.end else seen


@dataclass(frozen=True)
class ClockStep:
    """A clock that is set anew.

    Attributes:
        start: When, s.
        by: By how much, s.
    """

    start: float
    by: float = field(default=-1.0)

    def apply(self, seen: Seen, before: Seen | None) -> Seen | None:
        """Return the sample with another stamp."""
        return seen._replace(t=seen.t + self.by) if seen.t >= self.start else seen
