"""Feedback linearisation with a PID outer loop, and Lyapunov redesign on top (THESIS ch. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from gimbal_pin.control.laws.base import Memory, Outer, Pid
from gimbal_pin.control.laws.lyapunov import Robust
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Reference
from gimbal_pin.effects import Sample, Signal, Term
from gimbal_pin.log.log import Array


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """``tau = D(q) y + C v + G + F`` with ``y = a_ref + kd ė + kp e + ki ∫e + w``.

    One RNEA with a = y, and every term of the model at the *reference's* rate: a measured rate near zero would guess
    at the sign of friction, and compensating damping by a delayed measurement takes damping away. Below `still` the
    reference does not slide, and dry friction is not compensated.

    Attributes:
        model: The model that is inverted; its rig states the torque limits.
        gains: Outer loop, one per joint.
        dt: Sampling interval, s.
        lead: Time from the measurement to the middle of the hold of its torque, s: the feed-forward is taken from
            there, by the reference's last difference of acceleration.
        still: Reference rate under which a joint counts as standing, rad/s.
        braking: Deceleration that each motor surely has, rad/s² (see `Outer`); empty: not looked at.
        robust: Lyapunov redesign, or None.
    """

    model: Model
    gains: tuple[Pid, ...]
    dt: float
    lead: float = 0.0
    still: float = 1e-3
    braking: tuple[float, ...] = ()
    robust: Robust | None = None

    @cached_property
    def outer(self) -> Outer:
        """The outer loop with its limits."""
        return Outer(self.gains, tuple(self.model.tau_max.tolist()), self.braking)

    @cached_property
    def leads(self) -> tuple[float, ...]:
        """Time from the measurement to the middle of the hold of the torque that acts, s: the drives' own on top."""
        return tuple(self.lead + late for late in self.model.late(self.dt))

    @cached_property
    def workspace(self) -> pin.Data:
        """Pinocchio's scratch memory; it carries nothing from sample to sample."""
        return self.model.rig.model.createData()

    def start(self) -> Memory:
        """Memory before the first sample: no integral."""
        return Memory((0.0,) * len(self.gains))

    def torque(self, t: float, q: Array, v: Array, reference: Reference, memory: Memory) -> tuple[Array, Memory]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
        error, rate = (reference.q - q).tolist(), (reference.v - v).tolist()
        integral = [s + self.dt * e for s, e in zip(memory.integral, error)]
        feedback = self.outer.feedback(error, integral, rate)
        now = reference.a.tolist()
        ahead = self.ahead(now, memory.acceleration)
        y = [a + f for a, f in zip(ahead, feedback)]
        if self.robust is not None:
            y = [a + w for a, w in zip(y, self.robust.correction(integral, error, rate, ahead, feedback))]
        sliding = [r + lead * a for r, a, lead in zip(reference.v.tolist(), now, self.leads)]
        wanted = self.inverse(t, q + np.array(self.leads) * v, v, y, sliding)
        kept = self.outer.integrated(memory.integral, integral, error, wanted)
        return np.array(self.outer.clipped(wanted)), Memory(kept, tuple(now))

    def ahead(self, now: Sequence[float], before: Sequence[float]) -> Sequence[float]:
        """The reference's acceleration `leads` s on, rad/s²."""
        return [a + lead / self.dt * (a - b) for a, b, lead in zip(now, before, self.leads)] if before else now

    def inverse(self, t: float, q: Array, v: Array, y: Sequence[float], sliding: Sequence[float]) -> list[float]:
        """Torque of the model at measured q, v, with accelerations y and terms at the rates `sliding`, N m."""
        rigid = pin.rnea(self.model.rig.model, self.workspace, q, v, np.array(y)).tolist()
        still, out = self.still, []
        weight, own = rigid, self.model.rig.model
        if self.model.weighed:
            weight = pin.computeGeneralizedGravity(own, self.workspace, q).tolist()
        for terms, angle, a, rate, tau, pull in zip(self.model.by_joint, q.tolist(), y, sliding, rigid, weight):
            slide = 0.0 if -still < rate < still else (1.0 if rate > 0 else -1.0)
            at = Sample(t, angle, rate, a, slide, tau, weight=pull)
            out.append(tau + added(terms, at, tau))
        return [passed(*pair) for pair in zip(self.model.drives, out)] if self.model.drive else out


def added(terms: Sequence[Term], at: Sample, rigid: float) -> float:
    """Torque of some terms where the rest of the model asks for `rigid`, N m; those that feel it all are iterated.

    One step of Aitken's method is exact where the terms are linear in the total torque.
    """
    first = float(sum([term.torque(at) for term in terms]))
    if not any(term.effect.loaded for term in terms):
        return first
    second = float(sum([term.torque(at._replace(tau=rigid + first)) for term in terms]))
    third = float(sum([term.torque(at._replace(tau=rigid + second)) for term in terms]))
    slope = (third - second) / (second - first) if second != first else 0.0
    return third + (third - second) * slope / (1 - slope) if abs(slope) < 1 else third


def passed(drive: Sequence[Signal], torque: float) -> float:
    """What to command so that a drive gives this torque, N m."""
    for signal in reversed(drive):
        torque = signal.command(torque)
    return torque
