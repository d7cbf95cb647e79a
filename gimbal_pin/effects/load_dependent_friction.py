"""Friction that grows with what the joint carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import nan
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import hypot
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
    """``tau = mu (sqrt(preload² + load²) - preload) slide``: bearings and gears drag with what they carry.

    A gear carries all of the model's torque. A bearing carries the weight, which the motor holds by its torque, and of
    that torque the share `driven` with which a pinion or a belt presses on it besides: ``load = weight + driven tau``.
    A preload presses at right angles to the load: friction rises from it smoothly, not at once.

    Attributes:
        joint: The joint it acts on.
        weighs: False for a gear, True for a bearing.
        driven: Share of the torque that a bearing carries beside the weight.
        preload: What it carries without any load, N m.
    """

    weighs: bool = False
    driven: float = 0.0
    preload: float = 0.0

    name: ClassVar[str] = "load-dependent-friction"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "driven",
            0.0,
            "1",
            0.0,
            10.0,
            meaning="share of the torque that loads a bearing beside the weight",
        ),
        Parameter(
            "preload", 0.0, "N m", 0.0, 100.0, meaning="what loads it without any torque or weight"
        ),
    )
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
        """What the load adds to what the preload makes, in the direction of sliding."""
        load = at.weight + self.driven * at.tau if self.weighs else at.tau
        return ((hypot(load, self.preload) - self.preload) * at.slide,)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Gear, bearing, and one that half the torque presses on, each in proportion and beyond a preload."""
        carried = ((False, 0.0), (True, 0.0), (True, 0.5))
        return tuple(
            cls.inside(joint, *form, preload)
            for form, preload in product(carried, (0.0, seen.torque / 4))
        )

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """What is carried, its preload and how much it drags."""
        return (WEIGHS, *cls.shapes, *cls.linear)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with these parameters."""
        return Term(
            cls(str(joint), given["weighs"] != 0, given["driven"], given["preload"]), (given["mu"],)
        )

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """The coefficient last, after those shape parameters that are not zero."""
        return tuple(p for p in super().shown(values, covariance) if p.value or p.name == "mu")

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the share of the load."""
        what = "weight" if self.weighs else "torque"
        more = (
            f" and {100 * self.driven:.3g} % of its torque" if self.weighs and self.driven else ""
        )
        beyond = f", beyond {self.preload:.3g} N m" if self.preload else ""
        return f"friction grows by {100 * values[-1]:.3g} % of the {what} that the joint carries{more}{beyond}"
