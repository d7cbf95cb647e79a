"""What the sensors of a gimbal measure at one sample, how they come to measure it, and how they fail."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, isfinite, nan, pi
from typing import NamedTuple, Protocol

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.rig import Rig

GYRO = np.deg2rad(0.005)
"""Noise density of the benchmark's gyros, rad/s/√Hz."""
ACCELEROMETER = 100e-6 * 9.81
"""Noise density of its accelerometers, m/s²/√Hz."""
BITS = 16
"""Resolution of its encoders."""


NO_GYROS = np.zeros(0)
"""The readings of a rig without gyros between platform and camera."""


class Measurement(NamedTuple):
    """One sample of every sensor: what a controller gets, and all that it gets.

    Attributes:
        t: Time stamp, s.
        q: Angles, rad, (n,).
        gyro: Rate of the gyro beside the camera, in the camera's frame, rad/s, (3,).
        w: Rate of the platform's gyro, in the base link's frame, rad/s, (3,).
        f: Specific force of the platform, m/s², (3,).
        links: Rates of the gyros on links between the two, each in its link's frame, rad/s, (3 L,).
    """

    t: float
    q: Array
    gyro: Array
    w: Array
    f: Array
    links: Array = NO_GYROS


class Fault(Protocol):
    """A sensor that fails."""

    def apply(self, seen: Measurement, before: Measurement | None) -> Measurement | None:
        """Return what arrives in place of `seen`, None if nothing does; `before` is what arrived last."""


SENSORS: Mapping[str, tuple[str, ...]] = {
    "encoders": ("q",),
    "camera-gyro": ("gyro",),
    "platform-imu": ("w", "f"),
    "gyros-between": ("links",),
}
"""Sensor → its fields of a measurement."""
WRITTEN = "frozen:SENSOR:START[:END], nan:SENSOR:START[:END], dropped:START:END or clock:START:STEP, in s"


@dataclass(frozen=True)
class SensorFault:
    """A fault from `start` to `end`, s.

    Attributes:
        kind: "frozen" repeats the last reading, "nan" gives none; "dropped" loses the sample, "clock" steps its stamp.
        fields: Fields of the measurement that fail, of the first two kinds.
        start: Beginning, s.
        end: End, s.
        step: Step of the clock, s.
    """

    kind: str
    fields: tuple[str, ...]
    start: float
    end: float = inf
    step: float = 0.0

    def apply(self, seen: Measurement, before: Measurement | None) -> Measurement | None:
        """Return the measurement as it arrives, see `Fault`."""
        if not self.start <= seen.t < self.end or (self.kind == "frozen" and before is None):
            return seen
        if self.kind == "dropped":
            return None
        if self.kind == "clock":
            return seen._replace(t=seen.t + self.step)
        old = before if self.kind == "frozen" else None
        own = {name: getattr(old, name) if old else np.full_like(getattr(seen, name), nan) for name in self.fields}
        return seen._replace(**own)


def parse_fault(text: str) -> SensorFault:
    """Return what ``frozen:SENSOR:START[:END]``, ``nan:…``, ``dropped:START:END`` or ``clock:START:STEP`` says, s.

    Raises:
        UsageError: It is none of these; it says what there is.
    """
    kind, *rest = text.split(":")
    fields = SENSORS.get(rest.pop(0), ()) if kind in ("frozen", "nan") and rest else ()
    try:
        times = [float(word) for word in rest]
    except ValueError:
        times = []
    if all(map(isfinite, times)):
        if fields and len(times) in (1, 2):
            return SensorFault(kind, fields, *times)
        if kind == "dropped" and len(times) == 2:
            return SensorFault(kind, (), *times)
        if kind == "clock" and len(times) == 2:
            return SensorFault(kind, (), times[0], step=times[1])
    raise UsageError(f"fault '{text}'", "is none", f"write {WRITTEN}, SENSOR one of {', '.join(SENSORS)}")


@dataclass(frozen=True, eq=False)
class Station:
    """The sensors of the benchmark.

    Attributes:
        step: Angle of one encoder step, rad, (n,); 0: exact.
        noise: Densities of the IMUs' noise.
        faults: What goes wrong with them, in order.
    """

    step: Array
    noise: Noise = field(default_factory=lambda: Noise(GYRO, ACCELEROMETER))
    faults: tuple[Fault, ...] = ()

    @staticmethod
    def of(rig: Rig, faults: tuple[Fault, ...] = ()) -> Station:
        """16-bit encoders on every joint."""
        return Station(np.full(rig.n, 2 * pi / 2**BITS), faults=faults)

    @staticmethod
    def exact(rig: Rig) -> Station:
        """Sensors without error."""
        return Station(np.zeros(rig.n), Noise())

    def draws(self, samples: int, links: int, dt: float, rng: np.random.Generator) -> Array:
        """Noise of camera gyro, platform gyro, accelerometer and links' gyros, rad/s, m/s², (samples, 3 + links, 3)."""
        densities = [self.noise.gyro, self.noise.gyro, self.noise.accelerometer] + [self.noise.gyro] * links
        return np.array(densities)[:, None] / np.sqrt(2 * dt) * rng.standard_normal((samples, 3 + links, 3))

    def angles(self, q: Array) -> Array:
        """The angles as the encoders report them, rad, (n,)."""
        return np.asarray(np.rint(q / self.step) * self.step) if self.coarse else q.copy()

    @cached_property
    def coarse(self) -> bool:
        """Whether the encoders have steps."""
        return bool(self.step.all())
