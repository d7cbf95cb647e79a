"""Outer loops of equal margin: what a fair comparison of control laws needs, as bandwidth alone wins in simulation.

Each joint's loop stands by itself: what delays one motor slows that joint, no other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.computed_torque import Robust, lyapunov, stiffened
from gimbal_pin.control.laws.design import LAYERED, bisected
from gimbal_pin.control.laws.loop import Margins, margins
from gimbal_pin.control.laws.observer import Observer, observed_margins
from gimbal_pin.control.laws.uncertainty import Bounds
from gimbal_pin.effects import Signal

CROSSOVER = 25.0
"""Of the nominal PID, Hz (CONTROL, "Profile S")."""
DISK = 1.07
"""Disk margin of every loop."""
DAMPING, INTEGRAL = 0.9, 0.2
"""Shape of the outer loop, which gives the nominal PID its 58° of phase margin and its disk margin."""
SLOWEST = 0.05
"""Bandwidth below which no loop is looked for, Hz."""
OBSERVER = 0.8
"""Bandwidth of the disturbance observer, in crossovers of the nominal outer loop: 20 Hz where that crosses at 25."""


@dataclass(frozen=True)
class Equal:
    """One joint's loop per law, all with the same disk margin; none crosses above the nominal PID.

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
    disk: float = DISK
    crossover: float = CROSSOVER

    @cached_property
    def pid(self) -> Pid:
        """The nominal outer loop."""
        return self.largest(self.of, INTEGRAL)

    @cached_property
    def margins(self) -> Margins:
        """Of the nominal outer loop."""
        return self.of(self.pid)

    @cached_property
    def observer(self) -> Observer:
        """The observer, which knows of the delay in whole samples."""
        late = self.delay + sum(signal.late(self.dt) for signal in self.drive)
        return Observer(OBSERVER * self.margins.crossover_hz, self.dt, round(late / self.dt))

    @cached_property
    def observed(self) -> Pid:
        """The outer loop beside the observer, which integrates: proportional and derivative only."""
        return self.largest(lambda gains: observed_margins(gains, self.observer, self.delay, self.drive), 0.0)

    @cached_property
    def slow(self) -> Pid:
        """The linear loop that Lyapunov redesign leaves, before its layer takes up the rest."""
        return Pid.placed(LAYERED * bandwidth(self.pid), DAMPING, INTEGRAL)

    def of(self, gains: Pid) -> Margins:
        """Return the margins of an outer loop."""
        return margins(gains, self.dt, self.delay, drive=self.drive)

    def fair(self, found: Margins) -> bool:
        """Whether a loop has the wished margin, and is no faster than the nominal one may be."""
        return found.disk_margin >= self.disk and found.crossover_hz <= self.crossover

    def largest(self, of: Callable[[Pid], Margins], integral: float) -> Pid:
        """The fastest loop with the wished disk margin that does not cross above the limit."""

        def enough(hz: float) -> bool:
            return self.fair(of(Pid.placed(hz, DAMPING, integral)))

        floor = self.crossover / 4
        while not enough(floor) and floor > SLOWEST:
            floor /= 2
        return Pid.placed(bisected(enough, floor, 4 * floor), DAMPING, integral)


def redesigned(equals: Sequence[Equal], known: Bounds) -> Robust:
    """Return Lyapunov redesign of the joints' slower loops, with the thinnest layer that keeps every joint's margin."""
    law = Robust(lyapunov([equal.slow for equal in equals]), known, 1.0)

    def enough(gain: float) -> bool:
        rows = zip(equals, law.rows)
        return all(equal.fair(equal.of(stiffened(equal.slow, row, gain))) for equal, row in rows)

    return replace(law, gain=bisected(enough, 1e-3, 100.0))


def bandwidth(gains: Pid) -> float:
    """Natural frequency of a placed outer loop, Hz."""
    return gains.kd / (2 * DAMPING + INTEGRAL) / (2 * pi)
