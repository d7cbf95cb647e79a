"""What an effect is: torque per coefficient at one joint, one formula for fit and simulation alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, TypeVar

from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter

Value = TypeVar("Value", float, Array)


class Sample(NamedTuple):
    """The state of one joint: floats in simulation, arrays (N,) in identification.

    Attributes:
        t: Time, s.
        q: Angle, rad.
        v: Rate, rad/s.
        a: Acceleration, rad/s².
        slide: Direction of sliding in [-1, 1]: sign(v) while it slides, and while it sticks the share of the dry
            friction that the torque balance takes. Effects use it in place of sign(v), never a smooth sign.
        tau: The model's total torque at the joint, N m.
    """

    t: float | Array
    q: float | Array
    v: float | Array
    a: float | Array
    slide: float | Array
    tau: float | Array


@dataclass(frozen=True)
class Effect(ABC):
    """A torque at one joint that is linear in its coefficients: ``tau_joint = rnea + sum_k coefficient_k basis_k``.

    A subclass states its `name`, its `coefficients` (names, units, bounds), whether it is `dry` friction, and its
    `basis`. Shape parameters, in which it is not linear, are fields of the subclass.

    Attributes:
        joint: The joint it acts on.
    """

    joint: str

    name: ClassVar[str]
    coefficients: ClassVar[tuple[Parameter, ...]]
    dry: ClassVar[bool] = False
    """True if its basis is `slide` times a level: the level then takes part in sticking."""

    @abstractmethod
    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Return the torque per unit of each coefficient, N m per its unit; floats for floats, (N,) for arrays."""


@dataclass(frozen=True)
class Term:
    """An effect with the values of its coefficients.

    Attributes:
        effect: The formula.
        values: One per coefficient, in SI units.
    """

    effect: Effect
    values: tuple[float, ...]

    def torque(self, at: Sample) -> float | Array:
        """``sum_k value_k basis_k``, N m."""
        total: float | Array = 0.0
        for value, basis in zip(self.values, self.effect.basis(at)):
            total = total + value * basis
        return total
