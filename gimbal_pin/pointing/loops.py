"""The outer loops of every controller: each joint by itself, as fast as its own drive lets it be at equal margins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gimbal_pin.control.laws import Bounds, JointPid, Margins, Pid, Robust, bounds
from gimbal_pin.control.laws.computed_torque import ComputedTorque
from gimbal_pin.control.laws.design import inner
from gimbal_pin.control.laws.equal import DAMPING, INTEGRAL, Equal, bandwidth, redesigned
from gimbal_pin.control.laws.observer import Observer, observed_margins
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import digits
from gimbal_pin.pointing.measures import SLOW

FALLEN = 0.5
"""Share of the bandwidth of the PID that is fallen back to."""


@dataclass(frozen=True, eq=False)
class Loops:
    """One loop per joint for every law, all of one disk margin with the drives that the model knows.

    Attributes:
        model: What is known.
        dt: Sampling interval, s.
        delay: Samples from measurement to torque, the drives' own not counted.
    """

    model: Model
    dt: float
    delay: int

    @cached_property
    def equals(self) -> tuple[Equal, ...]:
        """The loops of each joint; those whose drives are alike share them."""
        made = {drive: Equal(self.dt, self.delay * self.dt, drive) for drive in self.model.drives}
        return tuple(made[drive] for drive in self.model.drives)

    @property
    def pid(self) -> tuple[Pid, ...]:
        """The nominal outer loop."""
        return tuple(equal.pid for equal in self.equals)

    @property
    def half(self) -> tuple[Pid, ...]:
        """The outer loop that is fallen back to."""
        return tuple(Pid.placed(FALLEN * bandwidth(pid), DAMPING, INTEGRAL) for pid in self.pid)

    @property
    def observed(self) -> tuple[Pid, ...]:
        """The outer loop beside the observers."""
        return tuple(equal.observed for equal in self.equals)

    @property
    def observers(self) -> tuple[Observer, ...]:
        """The disturbance observers."""
        return tuple(equal.observer for equal in self.equals)

    @property
    def slow(self) -> tuple[Pid, ...]:
        """The outer loop of Lyapunov redesign."""
        return tuple(equal.slow for equal in self.equals)

    @cached_property
    def known(self) -> Bounds:
        """Bounds on the model's error."""
        return bounds(self.model, np.random.default_rng(0))

    @cached_property
    def robust(self) -> Robust:
        """Lyapunov redesign on top of the slow loop."""
        return redesigned(self.equals, self.known)

    @cached_property
    def late(self) -> tuple[float, ...]:
        """Time by which each drive acts late, s, (n)."""
        return self.model.late(self.dt)

    @cached_property
    def leads(self) -> tuple[float, ...]:
        """Time from a sample to the middle of the hold of its torque, s, one per distinct drive."""
        return tuple((self.delay + 0.5) * self.dt + late for late in sorted(set(self.late)))

    def per_lead(self, gains: Sequence[Pid]) -> tuple[Pid, ...]:
        """Return the slowest of the joints' loops, per distinct drive: what its forecast is weighted by."""
        return tuple(
            min((pid for pid, own in zip(gains, self.late) if own == late), key=lambda pid: pid.kp)
            for late in sorted(set(self.late))
        )

    def margins(self, name: str, law: JointPid | ComputedTorque | None = None) -> tuple[Margins, ...]:
        """Return the margins of a controller's loops, joint by joint; those of `law`, where one is given."""
        if law is not None:
            gains = inner(law.gains, law.robust if isinstance(law, ComputedTorque) else None)
            return tuple(equal.of(pid) for equal, pid in zip(self.equals, gains))
        if name == "with-observer":
            return tuple(observed_margins(e.observed, e.observer, e.delay, e.drive) for e in self.equals)
        if name == "lyapunov":
            return tuple(equal.of(pid) for equal, pid in zip(self.equals, inner(self.slow, self.robust)))
        return tuple(equal.margins for equal in self.equals)


def slack(loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]) -> tuple[str, ...]:
    """Say whose loops are too slow to hold the camera: what is faster than their crossover they let pass.

    Args:
        loops: Controller → the margins of its loops, joint by joint.
        joints: Joint names.
    """
    rows = [
        (", ".join(names), places, own) for names, places, own in distinct(loops, joints) if own.crossover_hz < SLOW
    ]
    return tuple(
        f"{who} does not hold the camera: {', '.join(places)} crosses at {digits(own.crossover_hz)} Hz, and all above "
        f"{SLOW:g} Hz is jitter"
        for who, places, own in rows
    )


def distinct(
    loops: Mapping[str, tuple[Margins, ...]], joints: Sequence[str]
) -> list[tuple[list[str], list[str], Margins]]:
    """Return controllers and joints that have the same margins, with these.

    Args:
        loops: Controller → the margins of its loops, joint by joint.
        joints: Joint names.
    """
    same: dict[tuple[Margins, ...], list[str]] = {}
    for name, found in loops.items():
        same.setdefault(found, []).append(name)
    return [
        (names, [joint for joint, other in zip(joints, found) if other == own], own)
        for found, names in same.items()
        for own in dict.fromkeys(found)
    ]
