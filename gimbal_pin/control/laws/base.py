"""What the control laws share: gains, outer loop, memory, torque limit; what a law is given; the PID of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, pi, remainder, sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np

from gimbal_pin.dynamics.simulation import Reference
from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief


class BaseState(NamedTuple):
    """Motion of the base link at one moment, in its own frame, as its IMU tells it.

    Attributes:
        f: Specific force, m/s².
        w: Angular rate, rad/s.
        dw: Angular acceleration, rad/s².
    """

    f: Sequence[float] | Array
    w: Array
    dw: Sequence[float] | Array


class Ahead(NamedTuple):
    """Where the model is to be evaluated: at the middle of the hold of the torque, or now.

    Attributes:
        q: Angles, rad, (n,).
        v: Wanted rates, rad/s, (n,): those that keep the camera's attitude.
        a: Wanted accelerations, rad/s², (n,).
        base: Motion of the base.
    """

    q: Array
    v: Array
    a: Array
    base: BaseState


class Aim(NamedTuple):
    """Where the joints should be so that the camera looks where it should; a `Reference` for any law.

    Attributes:
        q: Angles, rad, (n,).
        v: Rates, rad/s, (n,).
        a: Accelerations, rad/s², (n,).
        ahead: One per distinct lead of the law's drives, see `Navigator.leads`.
    """

    q: Array
    v: Array
    a: Array
    ahead: tuple[Ahead, ...]


class Law(Protocol):
    """A `simulation.Controller` whose reference may be an `Aim`: of this, any law reads the part that it knows."""

    @property
    def dt(self) -> float:
        """Sampling interval, s."""

    def start(self) -> Any:
        """Return the memory before the first sample."""

    def torque(
        self, t: float, q: Array, v: Array, reference: Any, memory: Any
    ) -> tuple[Array, Any]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""


class Pid(NamedTuple):
    """Gains of one joint's outer loop, ``kp e + ki ∫e + kd ė``, in acceleration: 1/s², 1/s³, 1/s."""

    kp: float
    ki: float
    kd: float

    @staticmethod
    def placed(bandwidth_hz: float, damping: float, integral: float) -> Pid:
        """Gains that give the error the polynomial ``(s² + 2 ζ ω s + ω²) (s + γ ω)``.

        Args:
            bandwidth_hz: ω/2π, Hz.
            damping: ζ.
            integral: γ, speed of the integral action in shares of ω; 0: none.
        """
        w = 2 * pi * bandwidth_hz
        return Pid(
            (1 + 2 * damping * integral) * w**2, integral * w**3, (2 * damping + integral) * w
        )

    @property
    def integrates(self) -> bool:
        """Whether there is integral action worth the name: a pole a million times slower than the rest is none."""
        return bool(self.ki > 1e-6 * self.kp**1.5)


class LawMemory(NamedTuple):
    """What a law remembers from sample to sample.

    Attributes:
        integral: ∫e per joint, rad s.
        acceleration: The reference's acceleration at the sample before, rad/s²; empty before the first.
    """

    integral: tuple[float, ...]
    acceleration: tuple[float, ...] = ()


@dataclass(frozen=True)
class Outer:
    """``K ξ = kp e + ki ∫e + kd ė`` per joint, for errors that the motor can brake; larger ones are approached.

    A linear loop that starts far away would arrive faster than the motor can stop it, and overshoot by half the
    way. So beyond |e| = a (kd/kp)² the pull is ``kd √(2 a |e| - a² (kd/kp)²)``: the joint comes in on the parabola of
    a constant deceleration a, which meets the linear loop in value and slope.

    Attributes:
        gains: One per joint.
        limits: Torque limits, N m.
        braking: Deceleration a that each motor surely has, rad/s²; empty: without bound, the loop is linear.
        continuous: Whether each joint turns without stops; empty: none does.
    """

    gains: tuple[Pid, ...]
    limits: tuple[float, ...]
    braking: tuple[float, ...] = ()
    continuous: tuple[bool, ...] = ()

    __repr__ = brief

    @cached_property
    def rows(self) -> tuple[tuple[float, float, float, float, float], ...]:
        """Per joint kp, ki, kd, the error at which the parabola begins, and a."""
        braking = self.braking or (inf,) * len(self.gains)
        return tuple(
            (kp, ki, kd, a * (kd / kp) ** 2, a) for (kp, ki, kd), a in zip(self.gains, braking)
        )

    def compute_error(self, goal: Array, q: Array) -> list[float]:
        """Return ``goal - q``, rad, modulo 2π within ± π at joints that turn without stops."""
        error = (goal - q).tolist()
        if not any(self.continuous):
            return error
        return [
            remainder(e, 2 * pi) if endless else e for e, endless in zip(error, self.continuous)
        ]

    def feedback(
        self, error: Sequence[float], integral: Sequence[float], rate: Sequence[float]
    ) -> list[float]:
        """K ξ per joint, rad/s²."""
        return [
            ki * s + kd * r + (kp * e if -knee <= e <= knee else approach(kd, e, knee, a))
            for (kp, ki, kd, knee, a), e, s, r in zip(self.rows, error, integral, rate)
        ]

    def integrated(
        self,
        before: Sequence[float],
        after: Sequence[float],
        error: Sequence[float],
        torque: Sequence[float],
    ) -> tuple[float, ...]:
        """Conditional integration: not while the error drives the motor further into its limit, nor on an approach.

        Args:
            before: Integrals at the sample before, rad s.
            after: Integrals with this sample's error, rad s.
            error: e, rad.
            torque: Torques wanted with `after`, not yet cut, N m.
        """
        rows = zip(self.rows, before, after, error, torque, self.limits)
        return tuple(
            [
                old if (abs(tau) > limit and tau * e > 0) or abs(e) > row[3] else new
                for row, old, new, e, tau, limit in rows
            ]
        )

    def clipped(self, torque: Sequence[float]) -> list[float]:
        """Return the torques cut to the limits, N m."""
        rows = zip(torque, self.limits)
        return [-limit if tau < -limit else limit if tau > limit else tau for tau, limit in rows]


def approach(kd: float, error: float, knee: float, braking: float) -> float:
    """Pull towards the goal from beyond the knee, rad/s²."""
    pull = kd * sqrt(braking * (2 * abs(error) - knee))
    return pull if error > 0 else -pull


@dataclass(frozen=True)
class JointPid:
    """``tau_j = I_j (kp e + ki ∫e + kd ė)``: joints apart, gravity and friction not compensated.

    The derivative is the reference's rate less the measured rate: nothing is differenced.

    Attributes:
        gains: Outer loop, one per joint.
        inertia: Nominal inertia seen by each motor, kg m².
        limits: Torque limits, N m; a joint at its limit integrates no further into it.
        dt: Sampling interval, s.
        braking: Deceleration that each motor surely has, rad/s² (see `Outer`); empty: not looked at.
        continuous: Whether each joint turns without stops; empty: none does.
    """

    gains: tuple[Pid, ...]
    inertia: tuple[float, ...]
    limits: tuple[float, ...]
    dt: float
    braking: tuple[float, ...] = ()
    continuous: tuple[bool, ...] = ()

    __repr__ = brief

    @cached_property
    def outer(self) -> Outer:
        """The outer loop with its limits."""
        return Outer(self.gains, self.limits, self.braking, self.continuous)

    def start(self) -> LawMemory:
        """Memory before the first sample: no integral."""
        return LawMemory((0.0,) * len(self.gains))

    def torque(
        self, t: float, q: Array, v: Array, reference: Reference, memory: LawMemory
    ) -> tuple[Array, LawMemory]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
        error = self.outer.compute_error(reference.q, q)
        rate = (reference.v - v).tolist()
        integral = [s + self.dt * e for s, e in zip(memory.integral, error)]
        wanted = [
            inertia * y
            for inertia, y in zip(self.inertia, self.outer.feedback(error, integral, rate))
        ]
        kept = self.outer.integrated(memory.integral, integral, error, wanted)
        return np.array(self.outer.clipped(wanted)), LawMemory(kept)
