"""Sensors that fail, between a gimbal's measurements and the controller that holds its camera."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.log import Array
from gimbal_pin.pointing import Measurement
from gimbal_pin.pointing.navigator import Navigator
from gimbal_pin.pointing.pointer import Holder


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
        """Return what arrives of a measurement, None if nothing does; `before` is what arrived last."""
        if not self.start <= seen.t < self.end or (self.kind == "frozen" and before is None):
            return seen
        if self.kind == "dropped":
            return None
        if self.kind == "clock":
            return seen._replace(t=seen.t + self.step)
        old = before if self.kind == "frozen" else None
        own = {
            name: getattr(old, name) if old else np.full_like(getattr(seen, name), nan)
            for name in self.fields
        }
        return seen._replace(**own)


class Arrived(NamedTuple):
    """Memory of a holder behind failing sensors.

    Attributes:
        own: The holder's own memory.
        tau: The last torque, which holds where no measurement arrives, N m, (n,).
        before: The measurement that arrived last.
    """

    own: Any
    tau: Array
    before: Measurement | None = None

    @property
    def events(self) -> tuple[str, ...]:
        """The holder's events."""
        return tuple(self.own.events)


@dataclass(frozen=True, eq=False)
class FailingSensors:
    """A holder whose sensors fail.

    Attributes:
        holder: The holder.
        faults: Faults of its sensors, in order; the first sample always arrives.
    """

    holder: Holder
    faults: tuple[SensorFault, ...]

    @property
    def navigator(self) -> Navigator:
        """The holder's navigator."""
        return self.holder.navigator

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return self.holder.dt

    def receive(self, seen: Measurement, before: Measurement | None) -> Measurement | None:
        """Return what arrives of a measurement after all faults."""
        arrived: Measurement | None = seen
        for fault in self.faults:
            arrived = None if arrived is None else fault.apply(arrived, before)
        return arrived

    def start(self, seen: Measurement, camera: Array, base: Array) -> Arrived:
        """Return the memory at the first sample."""
        arrived = self.receive(seen, None)
        assert arrived is not None
        return Arrived(self.holder.start(arrived, camera, base), np.zeros(len(seen.q)))

    def torque(self, seen: Measurement, memory: Arrived) -> tuple[Array, Arrived]:
        """Return the holder's torque, the last one where no measurement arrives, and the next memory."""
        arrived = self.receive(seen, memory.before)
        if arrived is None:
            return memory.tau, memory
        tau, own = self.holder.torque(arrived, memory.own)
        return tau, Arrived(own, tau, arrived)
