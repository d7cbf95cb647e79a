"""Friction that grows with what the joint carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array

WEIGHS = Parameter(
    "weighs",
    0.0,
    "1",
    0.0,
    1.0,
    meaning="0 for a gear, which the joint's whole torque loads; 1 for a bearing, which the weight "
    "loads that it carries",
)


@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """``tau = mu |load| slide``: bearings and gears drag with what they carry.

    The load of a gear is the model's whole torque at the joint, that of a bearing the weight which it carries.

    Attributes:
        joint: The joint it acts on.
        weighs: False for a gear, True for a bearing.
    """

    weighs: bool = False

    name: ClassVar[str] = "load-dependent-friction"
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("mu", nan, "1", 0.0, 0.95, meaning="friction per load"),
    )
    dry: ClassVar[bool] = True
    loaded: ClassVar[bool] = True
    weighed: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "the same motion with two payloads, or well out of balance and balanced"
    )
    compensation: ClassVar[str] = (
        "friction feed-forward by what the model says that the joint carries"
    )

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """Return the size of the load, in the direction of sliding."""
        return (size(at.weight if self.weighs else at.tau) * at.slide,)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Return a gear and a bearing."""
        return cls(joint), cls(joint, weighs=True)

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """Return what is carried, and the friction per load."""
        return (WEIGHS, *cls.linear)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with these parameters."""
        return Term(cls(str(joint), given["weighs"] != 0), (given["mu"],))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the share of the load."""
        what = "weight" if self.weighs else "torque"
        return f"friction grows by {100 * values[-1]:.3g} % of the {what} that the joint carries"
