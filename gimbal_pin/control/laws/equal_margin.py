"""Outer loops of equal margin: what a fair comparison of controllers needs, as bandwidth alone wins in simulation.

Each joint's loop stands by itself: what delays one motor slows that joint, no other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.design import bisected
from gimbal_pin.control.laws.loop import Margins, compute_margins
from gimbal_pin.effects import Signal

CROSSOVER = 25.0
"""Bandwidth of the nominal PID, Hz."""
EQUAL_DISK_MARGIN = 1.07
"""Disk margin of every loop."""
OUTER_DAMPING, OUTER_INTEGRAL = 0.9, 0.2
"""Shape of the outer loop, which gives the nominal PID its 58° of phase margin and its disk margin."""
SLOWEST_BANDWIDTH = 0.05
"""Bandwidth below which no loop is looked for, Hz."""


@dataclass(frozen=True)
class EqualMarginLoop:
    """One joint's outer loop: the fastest that has a disk margin and does not cross above a limit.

    Attributes:
        dt: Sampling interval, s.
        delay: Time from measurement to torque, s, without the hold.
        drive: What stands between the command and the torque that acts, linear parts of it.
        disk: The disk margin.
        crossover: The highest crossover, Hz.
    """

    dt: float = 0.001
    delay: float = 0.001
    drive: tuple[Signal, ...] = ()
    disk: float = EQUAL_DISK_MARGIN
    crossover: float = CROSSOVER

    @cached_property
    def margins(self) -> Margins:
        """Of the nominal outer loop."""
        return self.of(self.pid)

    def of(self, gains: Pid) -> Margins:
        """Return the margins of an outer loop."""
        return compute_margins(gains, self.dt, self.delay, drive=self.drive)

    def fair(self, found: Margins) -> bool:
        """Whether a loop has the wished margin, and is no faster than the nominal one may be."""
        return found.disk_margin >= self.disk and found.crossover_hz <= self.crossover

    @cached_property
    def pid(self) -> Pid:
        """The fastest loop with the wished disk margin that does not cross above the limit."""

        def enough(hz: float) -> bool:
            return self.fair(self.of(Pid.placed(hz, OUTER_DAMPING, OUTER_INTEGRAL)))

        floor = self.crossover / 4
        while not enough(floor) and floor > SLOWEST_BANDWIDTH:
            floor /= 2
        return Pid.placed(bisected(enough, floor, 4 * floor), OUTER_DAMPING, OUTER_INTEGRAL)


def bandwidth(gains: Pid) -> float:
    """Natural frequency of a placed outer loop, Hz."""
    return gains.kd / (2 * OUTER_DAMPING + OUTER_INTEGRAL) / (2 * pi)
