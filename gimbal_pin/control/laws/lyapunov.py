"""Lyapunov redesign of the outer loop (THESIS ch. 5; Siciliano et al. 2009, 8.5.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import hypot

import numpy as np

from gimbal_pin.control.laws.base import Pid
from gimbal_pin.control.laws.uncertainty import Bounds
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array


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
    bounds: Bounds
    gain: float

    def __post_init__(self) -> None:
        """Refuse a bound that Lyapunov redesign cannot answer."""
        if not 0 <= self.bounds.alpha < 1:
            what = f"is {self.bounds.alpha:.2g}, and Lyapunov redesign needs less than 1"
            raise UsageError("alpha = ‖I - D⁻¹ D̂‖", what, "identify the model better, or use kind='pid'")
        if not self.gain > 0:
            raise UsageError("gain of the boundary layer", f"is {self.gain:g}", "give a positive one")

    @cached_property
    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """``Bᵀ P`` per joint: the direction of the correction in ξ."""
        return tuple((float(row[0]), float(row[1]), float(row[2])) for row in self.P[:, 2, :])

    def size(self, ahead: Sequence[float], feedback: Sequence[float]) -> float:
        """ρ, rad/s², for the reference's acceleration and the feedback ``K ξ``, rad/s² each."""
        alpha = self.bounds.alpha
        return (alpha * (hypot(*ahead) + hypot(*feedback)) + self.bounds.inverse * self.bounds.phi) / (1 - alpha)

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
        size, length = self.size(ahead, feedback), hypot(*z)
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
        A, Q = error_system(pid)[part, part], weight(pid)[part, part]
        P[part, part] = solve_continuous_lyapunov(A.T, -Q)
    return out


def stiffened(gains: Pid, row: Sequence[float], gain: float) -> Pid:
    """The loop inside the boundary layer, where ``w = gain z`` with gain = ρ/ε is nothing but more PID."""
    return Pid(gains.kp + gain * row[1], gains.ki + gain * row[0], gains.kd + gain * row[2])
