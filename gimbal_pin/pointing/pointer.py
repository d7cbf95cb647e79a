"""A controller that holds a camera: guard, navigation, law, and what it falls back to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from operator import ge
from typing import Any, NamedTuple, Protocol

import numpy as np

from gimbal_pin.control.laws.base import JointPid, Law, LawMemory
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.guard import HELD, Guard, Watch
from gimbal_pin.pointing.measurement import Measurement
from gimbal_pin.pointing.navigator import Fix, Known, Navigator
from gimbal_pin.pointing.sight import lost_turn
from gimbal_pin.rig.brief import brief

LIMITED = 50
"""Samples at the torque limit after which it is told of."""


class Held(NamedTuple):
    """What a controller remembers.

    Attributes:
        known: Navigation's memory.
        law: The law's memory, the fallback's while that is in force.
        fallback: Whether the fallback is in force.
        tau: The last torque, N m, (n,).
        watch: The guard's memory.
        limited: Samples in a row at the torque limit, the joint's that has been there longest.
        steep: Whether the camera is near a singular pose.
        unanswered: Samples in a row for which the law gave no number.
        noted: What happened besides what guard and forecast say, in sentences.
    """

    known: Known
    law: Any
    fallback: bool
    tau: Array
    watch: Watch
    limited: int = 0
    steep: bool = False
    unanswered: int = 0
    noted: tuple[str, ...] = ()

    @property
    def events(self) -> tuple[str, ...]:
        """Everything that happened."""
        return (*self.watch.events, *self.known.past.events, *self.noted)


class Holder(Protocol):
    """A controller that holds a camera, such as `Pointer`."""

    @property
    def navigator(self) -> Navigator:
        """Tells what is wanted, and how far ahead the platform's motion counts."""

    @property
    def dt(self) -> float:
        """Sampling interval, s."""

    def start(self, seen: Measurement, camera: Array, base: Array) -> Any:
        """Return the memory at the first sample, see `Pointer.start`; its `events` say what happened."""

    def torque(self, seen: Measurement, memory: Any) -> tuple[Array, Any]:
        """Return the torque, N m, (n,), finite and within the limits, and the next memory."""


@dataclass(frozen=True, eq=False)
class Pointer:
    """From sensors to torques.

    Attributes:
        navigator: Tells the law where the joints are and should be.
        law: Any control law; those that know of a platform read its motion from the reference.
        guard: Checks the sensors.
        fallback: What is left without the platform's IMU or without the camera's: a PID on the camera's attitude.
    """

    navigator: Navigator
    law: Law
    guard: Guard
    fallback: JointPid

    __repr__ = brief

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return self.law.dt

    def start(self, seen: Measurement, camera: Array, base: Array) -> Held:
        """Memory at the first sample, where the attitudes of camera and base link are known, (3, 3)."""
        watch = self.guard.start(seen)
        known = self.navigator.start(watch.good._replace(t=seen.t), camera, base)
        return Held(known, self.law.start(), False, np.zeros(len(seen.q)), watch)

    def torque(self, seen: Measurement, memory: Held) -> tuple[Array, Held]:
        """Return the torque, N m, (n,), finite and within the limits, and the next memory.

        With neither encoders nor the camera's gyro it is zero.
        """
        seen, watch = self.guard.step(seen, memory.watch, memory.known.v, memory.steep)
        lost = watch.lost
        doubtful = watch.doubtful
        if "gyro" in lost:
            base = (
                np.zeros(3) if "w" in lost else seen.w
            )  # without the platform's gyro it counts as standing
            seen = seen._replace(gyro=self.navigator.sight.rate(seen.q, watch.rates, base))
        fix, known = self.navigator.fix(seen, memory.known, doubtful)
        back = bool(lost - {"q", "links"})
        law: Law = self.fallback if back else self.law
        own = memory.law
        if back != memory.fallback:
            own = taken_over(self.fallback, fix, memory.tau) if back else law.start()
        tau, own = law.torque(seen.t, fix.q, fix.v, fix.aim, own)
        if {"q", "gyro"} <= lost:
            tau = np.zeros_like(tau)
        steep = memory.steep
        limited = memory.limited
        after = Held(known, own, back, tau, watch, limited, steep, noted=memory.noted)
        return self.checked(seen.t, tau, fix, memory, after)

    def checked(
        self, t: float, tau: Array, fix: Fix, before: Held, after: Held
    ) -> tuple[Array, Held]:
        """Return torque and memory, with what there is to tell; a torque that is no number becomes none."""
        sizes = [abs(torque) for torque in tau.tolist()]
        # A law clips, and clipping may make a limit of what is no number: so what went in is looked at, too.
        finite = isfinite(sum(sizes) + fix.aim.q.dot(fix.aim.a))
        at_limit = list(map(ge, sizes, self.limits))
        ended = after.known.ended and not before.known.ended
        if (
            finite
            and not any(at_limit)
            and not before.limited
            and fix.steep == before.steep
            and not ended
        ):
            return tau, after
        events = list(after.noted)
        if ended:
            events.append(
                f"{t:.3f} s: the gyros differ by more than their noise, the camera's own is used alone"
            )
        if not finite:
            events.append(f"{t:.3f} s: the law gave no number, no torque")
            tau = np.zeros_like(tau)
            after = after._replace(
                law=self.law.start(),
                fallback=False,
                tau=tau,
                unanswered=before.unanswered + 1,
                noted=tuple(events),
            )
            if after.unanswered >= HELD and not {"q", "gyro"} & after.watch.doubtful:
                return tau, self.restarted(after)
        if fix.steep and not before.steep:
            why = lost_turn(self.navigator.sight, fix.q)
            events.append(f"{t:.3f} s: near a singular pose, inverse kinematics damped: {why}")
        limited = before.limited + 1 if any(at_limit) else 0
        if limited == LIMITED:
            joint = self.navigator.sight.rig.joints[at_limit.index(True)]
            events.append(f"{t:.3f} s: {joint} at its torque limit for {LIMITED * self.dt:g} s")
        return tau, after._replace(limited=limited, steep=fix.steep, noted=tuple(events[:LIMITED]))

    def restarted(self, held: Held) -> Held:
        """Begin anew at the last sample, holding what the camera sees: the attitude that was known is no number."""
        wanted = self.navigator.wanted
        watch = held.watch
        last = held.watch.good
        base = wanted @ self.navigator.sight.attitude(last.q).T
        begun = self.start(
            last._replace(t=last.t + self.dt), wanted, base
        )  # of the sample to come, as a start is
        noted = (
            *held.noted,
            f"{last.t:.3f} s: everything begins anew, the camera is held where it looks",
        )
        own = begun.watch._replace(clock=watch.clock, events=watch.events)
        return begun._replace(watch=own, noted=noted[-LIMITED:])

    @cached_property
    def limits(self) -> list[float]:
        """Torque limits, N m."""
        limits: list[float] = self.navigator.sight.rig.tau_max.tolist()
        return limits


def taken_over(law: JointPid, fix: Fix, tau: Array) -> LawMemory:
    """Return the memory with which a PID goes on with the torque that acted: its integral holds what the model gave."""
    error = fix.aim.q - fix.q
    rate = fix.aim.v - fix.v
    rows = zip(law.gains, law.inertia, error.tolist(), rate.tolist(), tau.tolist())
    return LawMemory(
        tuple(
            (u / m - g.kp * e - g.kd * r) / g.ki if g.integrates else 0.0 for g, m, e, r, u in rows
        )
    )
