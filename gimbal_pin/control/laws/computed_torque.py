"""Feedback linearisation with a PID outer loop, and Lyapunov redesign on top (thesis ch. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from math import hypot
from typing import Any

import numpy as np
import pinocchio as pin

from gimbal_pin.control.laws.base import LawMemory, Outer, Pid
from gimbal_pin.control.laws.uncertainty import ModelErrorBounds
from gimbal_pin.dynamics.model import Model
from gimbal_pin.dynamics.simulation import Reference
from gimbal_pin.effects import Sample, Signal, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.brief import brief


@dataclass(frozen=True, eq=False)
class Robust:
    """``w = ρ z/‖z‖`` outside a boundary layer ``‖z‖ ≤ ε``, ``ρ z/ε`` inside; ``z = Bᵀ P ξ``, ``ξ = (∫e, e, ė)``.

    The layer is as thick as ρ is large, ε = ρ/gain: what the loop sees of it within is the constant `gain`, so that
    one margin holds at any ρ.

    ``ρ = (α ‖a_ref‖ + α ‖K ξ‖ + B_M Φ)/(1 - α)`` with the reference's acceleration and the feedback of the moment:
    both are known at every sample, and never more than their suprema Q_M and ‖K‖ ‖ξ‖ in the thesis.

    Attributes:
        P: Solution of ``Aᵀ P + P A = -Q`` per joint, (n, 3, 3).
        bounds: α, Φ and B_M.
        gain: ρ/ε; z is in rad/s², as w is.
    """

    P: Array = field(repr=False)
    bounds: ModelErrorBounds
    gain: float

    __repr__ = brief

    def __post_init__(self) -> None:
        """Refuse a bound that Lyapunov redesign cannot answer."""
        if not 0 <= self.bounds.alpha < 1:
            what = f"is {self.bounds.alpha:.2g}, and Lyapunov redesign needs less than 1"
            raise UsageError(
                "alpha = ‖I - D⁻¹ D̂‖", what, "identify the model better, or use kind='pid'"
            )
        if not self.gain > 0:
            raise UsageError(
                "gain of the boundary layer", f"is {self.gain:g}", "give a positive one"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return what files hold."""
        return {"gain": self.gain, **asdict(self.bounds)}

    @cached_property
    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """``Bᵀ P`` per joint: the direction of the correction in ξ."""
        return tuple((float(row[0]), float(row[1]), float(row[2])) for row in self.P[:, 2, :])

    def size(self, ahead: Sequence[float], feedback: Sequence[float]) -> float:
        """ρ, rad/s², for the reference's acceleration and the feedback ``K ξ``, rad/s² each."""
        alpha = self.bounds.alpha
        return (
            alpha * (hypot(*ahead) + hypot(*feedback)) + self.bounds.inverse * self.bounds.phi
        ) / (1 - alpha)

    def correction(
        self,
        integral: Sequence[float],
        error: Sequence[float],
        rate: Sequence[float],
        ahead: Sequence[float],
        feedback: Sequence[float],
    ) -> list[float]:
        """Return w per joint, rad/s²."""
        z = [a * s + b * e + c * r for (a, b, c), s, e, r in zip(self.rows, integral, error, rate)]
        size = self.size(ahead, feedback)
        length = hypot(*z)
        share = self.gain if self.gain * length <= size else size / length
        return [share * x for x in z]


def error_system(gains: Pid) -> Array:
    """A of one joint's closed error system ``ξ̇ = A ξ``, ξ = (∫e, e, ė), (3, 3)."""
    return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-gains.ki, -gains.kp, -gains.kd]])


def weight(gains: Pid) -> Array:
    """Q = diag(ω⁶, ω⁴, ω²) with ω² = kp: every entry of ξ counts by the acceleration it stands for, (3, 3)."""
    return np.diag([gains.kp**3, gains.kp**2, gains.kp])


def lyapunov(gains: Sequence[Pid]) -> Array:
    """P of ``Aᵀ P + P A = -Q`` per joint, (n, 3, 3); without integral action of (e, ė) alone, zero elsewhere."""
    from scipy.linalg import solve_continuous_lyapunov

    out = np.zeros((len(gains), 3, 3))
    for P, pid in zip(out, gains):
        part = slice(0 if pid.integrates else 1, 3)
        A = error_system(pid)[part, part]
        Q = weight(pid)[part, part]
        P[part, part] = solve_continuous_lyapunov(A.T, -Q)
    return out


def stiffened(gains: Pid, row: Sequence[float], gain: float) -> Pid:
    """The loop inside the boundary layer, where ``w = gain z`` with gain = ρ/ε is nothing but more PID."""
    return Pid(gains.kp + gain * row[1], gains.ki + gain * row[0], gains.kd + gain * row[2])


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

    __repr__ = brief

    @cached_property
    def outer(self) -> Outer:
        """The outer loop with its limits."""
        rig = self.model.rig
        return Outer(self.gains, tuple(self.model.tau_max.tolist()), self.braking, rig.continuous)

    @cached_property
    def leads(self) -> tuple[float, ...]:
        """Time from the measurement to the middle of the hold of the torque that acts, s: the drives' own on top."""
        return tuple(self.lead + late for late in self.model.late(self.dt))

    @cached_property
    def workspace(self) -> pin.Data:
        """Pinocchio's scratch memory; it carries nothing from sample to sample."""
        return self.model.rig.model.createData()

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
        feedback = self.outer.feedback(error, integral, rate)
        now = reference.a.tolist()
        ahead = self.ahead(now, memory.acceleration)
        y = [a + f for a, f in zip(ahead, feedback)]
        if self.robust is not None:
            y = [
                a + w
                for a, w in zip(y, self.robust.correction(integral, error, rate, ahead, feedback))
            ]
        sliding = [r + lead * a for r, a, lead in zip(reference.v.tolist(), now, self.leads)]
        wanted = self.inverse(t, q + np.array(self.leads) * v, v, y, sliding)
        kept = self.outer.integrated(memory.integral, integral, error, wanted)
        return np.array(self.outer.clipped(wanted)), LawMemory(kept, tuple(now))

    def ahead(self, now: Sequence[float], before: Sequence[float]) -> Sequence[float]:
        """The reference's acceleration `leads` s on, rad/s²."""
        return (
            [a + lead / self.dt * (a - b) for a, b, lead in zip(now, before, self.leads)]
            if before
            else now
        )

    def inverse(
        self, t: float, q: Array, v: Array, y: Sequence[float], sliding: Sequence[float]
    ) -> list[float]:
        """Torque of the model at measured q, v, with accelerations y and terms at the rates `sliding`, N m."""
        rigid = self.rigid(q, v, y)
        still = self.still
        out = []
        weight = rigid
        own = self.model.rig.model
        if self.model.weighed:
            weight = pin.computeGeneralizedGravity(own, self.workspace, q).tolist()
        for terms, angle, a, rate, tau, pull in zip(
            self.model.by_joint, q.tolist(), y, sliding, rigid, weight
        ):
            slide = 0.0 if -still < rate < still else (1.0 if rate > 0 else -1.0)
            at = Sample(t, angle, rate, a, slide, tau, weight=pull)
            out.append(tau + compute_added_torque(terms, at, tau))
        return (
            [invert_drive(*pair) for pair in zip(self.model.drives, out)]
            if self.model.drive
            else out
        )

    def rigid(self, q: Array, v: Array, y: Sequence[float]) -> list[float]:
        """Torque of the bodies, N m."""
        torque: list[float] = pin.rnea(
            self.model.rig.model, self.workspace, q, v, np.array(y)
        ).tolist()
        return torque


@dataclass(frozen=True, eq=False)
class CompensatedPid(ComputedTorque):
    """``tau_j = I_j (kp e + ki ∫e + kd ė) + G_j + F_j``: a PID of each joint with gravity and friction fed forward.

    Attributes:
        inertia: Inertia seen by each motor at home without its rotor's, which the terms add, kg m².
    """

    inertia: tuple[float, ...] = ()

    def ahead(self, now: Sequence[float], before: Sequence[float]) -> Sequence[float]:
        """No acceleration is fed forward."""
        return [0.0] * len(now)

    def rigid(self, q: Array, v: Array, y: Sequence[float]) -> list[float]:
        """Gravity's torque, and the joints' own inertia times y, N m."""
        gravity = pin.computeGeneralizedGravity(self.model.rig.model, self.workspace, q).tolist()
        return [g + own * a for g, own, a in zip(gravity, self.inertia, y)]


def compute_added_torque(terms: Sequence[Term], at: Sample, rigid: float) -> float:
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


def invert_drive(drive: Sequence[Signal], torque: float) -> float:
    """What to command so that a drive gives this torque, N m."""
    for signal in reversed(drive):
        torque = signal.command(torque)
    return torque
