"""Sensors that fail, to see what a controller does then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Literal

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.pointing.seen import Fault, Seen

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


SENSORS: Mapping[str, tuple[Channel, ...]] = {
    "encoders": ("q",),
    "camera-gyro": ("gyro",),
    "platform-imu": ("w", "f"),
    "gyros-between": ("links",),
}
"""What a person calls the channels."""
WRITTEN = "frozen:SENSOR:START[:END], nan:SENSOR:START[:END], dropped:START:END or clock:START:STEP, in s"


def parse_fault(text: str) -> Fault:
    """Return what ``frozen:SENSOR:START[:END]``, ``nan:…``, ``dropped:START:END`` or ``clock:START:STEP`` says, s.

    Raises:
        UsageError: It is none of these; it says what there is.
    """
    kind, *rest = text.split(":")
    channels = SENSORS.get(rest.pop(0)) if kind in ("frozen", "nan") and rest else ()
    times = [value for value in map(number, rest) if isfinite(value)]
    if len(times) == len(rest):
        if kind == "frozen" and channels and len(times) in (1, 2):
            return Frozen(channels, *times)
        if kind == "nan" and channels and len(times) in (1, 2):
            return Missing(channels, *times)
        if kind == "dropped" and len(times) == 2:
            return Dropped(*times)
        if kind == "clock" and len(times) == 2:
            return ClockStep(*times)
    raise UsageError(f"fault '{text}'", "is none", f"write {WRITTEN}, SENSOR one of {', '.join(SENSORS)}")


def number(text: str) -> float:
    """Return a number, nan where it is none."""
    try:
        return float(text)
    except ValueError:
        return nan
