"""Feedback linearisation on a platform that moves: the platform's motion is in the model, not a disturbance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.control.laws.base import Ahead, Aim, Outer, Pid
from gimbal_pin.control.laws.computed_torque import Robust, compute_added_torque, invert_drive
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Sample
from gimbal_pin.effects.resistance import Resistance
from gimbal_pin.log.log import Array
from gimbal_pin.regression import compute_direction
from gimbal_pin.rig.brief import brief

evaluate_rnea = pin.rnea
PAID = 0.01
"""Time constant with which torque that a limit took off is forgotten, s, where it is not made up for."""
MOST_UNREALISED_TORQUE = 1.0
"""Largest torque, of one sample, that is still to be made up for, in torque limits: a joint that was long at its limit
must not stay there."""


class CarriedMemory(NamedTuple):
    """What the law remembers.

    Attributes:
        integral: ∫e per joint, rad s.
        owed: Torque that the limits took off and that was not made up for yet, N m, for one sample.
    """

    integral: tuple[float, ...]
    owed: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class CarriedTorque:
    """``tau = rnea(q, q̇_d, q̈_d + K ξ + w; f, ω, ω̇) + terms(q̇_d)``: computed torque with the base moving.

    Gravity, Coriolis torque and what the platform's acceleration and turning ask of the joints come from its IMU
    alone: with the base's acceleration its specific force no attitude is needed. The terms are taken at the wanted
    rate, as the measured one is noisy near zero; dry friction that reverses within a hold counts by its mean over it.

    What a torque limit takes off is added to the next samples: ``τ = cut(τ_w + λ o)``, ``o = τ_w + λ o - τ``. Noise on
    a torque near its limit is only ever cut on one side, and would otherwise lower the limit by half its size.

    Attributes:
        model: The model that is inverted.
        gains: Outer loop, one per joint.
        dt: Sampling interval, s.
        robust: Lyapunov redesign, or None.
        trusted: Joints whose feed-forward is believed; empty: all. The others get a PID on their own inertia.
    """

    model: Model
    gains: tuple[Pid, ...]
    dt: float
    robust: Robust | None = None
    trusted: tuple[bool, ...] = ()

    __repr__ = brief

    @cached_property
    def outer(self) -> Outer:
        """The outer loop with its limits."""
        rig = self.model.rig
        return Outer(self.gains, tuple(self.model.tau_max.tolist()), continuous=rig.continuous)

    @cached_property
    def workspace(self) -> Workspace:
        """Pinocchio's scratch memory; it carries nothing from sample to sample."""
        return Workspace(self.model)

    @cached_property
    def friction(self) -> Resistance:
        """The model's terms, the affine ones as two products a joint."""
        return Resistance(self.model.by_joint)

    @cached_property
    def which(self) -> tuple[int, ...]:
        """Place of each joint's lead among the distinct ones, (n)."""
        late = self.model.late(self.dt)
        distinct = sorted(set(late))
        return tuple(distinct.index(one) for one in late)

    def start(self) -> CarriedMemory:
        """Memory before the first sample."""
        none = (0.0,) * len(self.gains)
        return CarriedMemory(none, none)

    def torque(
        self, t: float, q: Array, v: Array, reference: Aim, memory: Any
    ) -> tuple[Array, CarriedMemory]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
        error = self.outer.compute_error(reference.q, q)
        rate = (reference.v - v).tolist()
        integral = [s + self.dt * e for s, e in zip(memory.integral, error)]
        feedback = self.outer.feedback(error, integral, rate)
        if self.robust is not None:
            wished = reference.ahead[0].a.tolist()
            extra = self.robust.correction(integral, error, rate, wished, feedback)
            feedback = [y + w for y, w in zip(feedback, extra)]
        wanted = [
            u + self.lasting * o
            for u, o in zip(self.inverse(t, reference.ahead, feedback), memory.owed)
        ]
        kept = self.outer.integrated(memory.integral, integral, error, wanted)
        tau = self.outer.clipped(wanted)
        owed = memory.owed if tau == wanted and not any(memory.owed) else self.left(wanted, tau)
        return np.array(tau), CarriedMemory(kept, owed)

    def left(self, wanted: Sequence[float], tau: Sequence[float]) -> tuple[float, ...]:
        """What a sample did not give of the torque wanted, N m, at most `MOST_UNREALISED_TORQUE` limits."""
        rows = zip(wanted, tau, self.outer.limits)
        return tuple(
            [
                max(-MOST_UNREALISED_TORQUE * limit, min(MOST_UNREALISED_TORQUE * limit, u - given))
                for u, given, limit in rows
            ]
        )

    @cached_property
    def lasting(self) -> float:
        """Share of what is owed that is left a sample later."""
        return exp(-self.dt / PAID)

    def inverse(self, t: float, ahead: Sequence[Ahead], feedback: Sequence[float]) -> list[float]:
        """Torque of the model, N m: every joint's from the moment at which its own drive will act."""
        if len(ahead) == 1:
            return self.at(t, ahead[0], feedback)
        several = [self.at(t, one, feedback) for one in ahead]
        return [several[k][j] for j, k in enumerate(self.which)]

    def at(self, t: float, there: Ahead, feedback: Sequence[float]) -> list[float]:
        """Torque of the model at one moment, N m."""
        wanted = there.a.tolist()
        y = [a + f for a, f in zip(wanted, feedback)]
        tau = self.workspace.rnea(there, y)
        friction = self.friction
        v = there.v.tolist()
        slide = compute_direction(there.v, there.a, self.dt).tolist()
        rows = zip(tau, friction.constant, slide, friction.per_slide, v, friction.per_rate)
        tau = [rigid + c + s * dry + rate * viscous for rigid, c, s, dry, rate, viscous in rows]
        weight = self.workspace.weight(there) if friction.weighed else tau
        for j, terms in friction.rest:
            at = Sample(t, float(there.q[j]), v[j], y[j], slide[j], tau[j], weight=weight[j])
            tau[j] += compute_added_torque(terms, at, tau[j])
        if self.trusted:
            own = self.workspace.inertia(there.q)
            tau = [x if ok else m * f for x, ok, m, f in zip(tau, self.trusted, own, feedback)]
        return (
            [invert_drive(*pair) for pair in zip(self.model.drives, tau)]
            if self.model.drive
            else tau
        )


class Workspace:
    """The model behind a free-flyer, with the arrays that Pinocchio takes."""

    def __init__(self, model: Model) -> None:
        """Take the model's rig; what its terms add per acceleration stays with the terms."""
        self.pin, self.n = model.rig.floating, model.rig.n
        self.data = self.pin.createData()
        self.own = model.rig.model
        self.fixed = self.own.createData()
        n = self.n
        self.q = np.zeros(7 + n)
        self.v = np.zeros(6 + n)
        self.a = np.zeros(6 + n)
        self.q[6] = 1.0
        # Views of what changes in them: to fill these costs less than to make new arrays.
        self.angles = self.q[7:]
        self.turning = self.v[3:6]
        self.joints = self.v[6:]
        self.force = self.a[:3]
        self.swing = self.a[3:6]
        self.driven = self.a[6:]

    def rnea(self, there: Ahead, y: Sequence[float]) -> list[float]:
        """Rigid torque with the joints accelerating by y, rad/s², N m."""
        self.angles[:], self.joints[:], self.driven[:] = there.q, there.v, y
        self.force[:], self.turning[:], self.swing[:] = there.base
        torque: list[float] = evaluate_rnea(self.pin, self.data, self.q, self.v, self.a).tolist()[
            6:
        ]
        return torque

    def weight(self, there: Ahead) -> list[float]:
        """Rigid torque with the joints at rest, N m."""
        return self.rnea(there._replace(v=np.zeros(self.n)), [0.0] * self.n)

    def inertia(self, q: Array) -> list[float]:
        """Diagonal of D, kg m²."""
        diagonal: list[float] = np.diagonal(pin.crba(self.own, self.fixed, q)).tolist()
        return diagonal
