"""A motor that gives no more than so much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, copysign, inf, log, nan
from typing import Any, ClassVar

import numpy as np

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import FloatOrArray, clip_value, size
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.effects.signal import Static

SOFT = 2.0
"""Knee that a search starts from."""
CLIP_STEP = 1.25
"""Largest step between clips that a search starts from: one that is a third off gains nothing."""
LOWEST = 0.2
"""Share of the torque from which they start: of commands many times what acts little more than the sign is left."""
NARROW_CLIP, WIDE_CLIP = 0.05, 0.25
"""Shares of the peak by which those are under it that clip peaks alone."""
WIDER = 1.8
"""Largest step between these: what a clip takes off a peak grows with how far it is under it."""
NEAREST = 0.999
"""Share of a soft limit up to which a controller commands what it takes."""
SIDE_PARAMETER = Parameter(
    "side",
    0.0,
    "1",
    -1.0,
    1.0,
    meaning="1 or -1: only torques in that direction are limited; 0: those in both",
)


def _build_limit_grid(low: float, high: float, most: float) -> tuple[float, ...]:
    """Return values from low to high, each at most so many times the last; none where low is no less."""
    return (
        build_geometric_grid(low, high, ceil(log(high / low) / log(most)) + 1, Saturation.shapes[0])
        if 0 < low < high
        else ()
    )


@dataclass(frozen=True)
class Saturation(Static):
    """``y = x`` within ±limit, ``±limit`` beyond; with a knee n ``y = x / (1 + |x/limit|^n)^(1/n)``.

    A supply or an amplifier clips, at a limit under the one that the rig states. Iron gives less and less per ampere
    long before (the form is Rapp's, 1991, of amplifiers).

    Attributes:
        joint: The joint whose motor it is.
        limit: Largest torque, N m.
        side: 1 or -1 if only torques in that direction are limited; 0 for both.
        knee: How suddenly it is reached; 0 for a clip.
    """

    limit: float
    side: int = 0
    knee: float = 0.0

    name: ClassVar[str] = "saturation"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("limit", nan, "N m", 1e-6, 1e6, meaning="largest torque that the motor gives"),
        Parameter(
            "knee",
            0.0,
            "1",
            0.0,
            20.0,
            meaning="how suddenly it is reached, the more the larger; 0 for a clip",
        ),
    )
    experiment: ClassVar[str] = (
        "peaks of torque up to the stated limit, short, next to gentle motion"
    )
    compensation: ClassVar[str] = (
        "state this limit as the motor's: references and anti-windup then keep to it"
    )

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """With the side, which is chosen and not measured."""
        return (*cls.shapes, SIDE_PARAMETER)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """A side is a direction: of what is given its sign counts."""
        return replace(super().planted(joint, given), side=int(np.sign(given["side"])))

    @property
    def largest(self) -> float:
        """The limit."""
        return self.limit

    def of_side(self, x: FloatOrArray) -> FloatOrArray:
        """Size of the command where its direction is limited, else zero."""
        return size(clip_value(x, 0.0 if self.side > 0 else -inf, 0.0 if self.side < 0 else inf))

    def passed(self, x: FloatOrArray) -> FloatOrArray:
        """Cut the command, or bend it."""
        if not self.knee:
            return clip_value(
                x, -inf if self.side > 0 else -self.limit, inf if self.side < 0 else self.limit
            )
        return x / (1.0 + (self.of_side(x) / self.limit) ** self.knee) ** (1.0 / self.knee)

    def command(self, torque: float) -> float:
        """``x = y / (1 - |y/limit|^n)^(1/n)``: make up for what a knee bends; a clip asks for nothing else."""
        share = min(float(self.of_side(torque)) / self.limit, NEAREST)
        if not self.knee or not share:
            return torque
        return copysign(share * self.limit, torque) / (1.0 - share**self.knee) ** (1.0 / self.knee)

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Limits that bite on the log's peaks, on both sides or on one, and soft ones that may lie beyond."""
        low = max(LOWEST * seen.torque, cls.shapes[0].lower)
        high = (1.0 - WIDE_CLIP) * seen.peak
        under = _build_limit_grid(low, high, CLIP_STEP)
        limits = (
            *under,
            *(
                seen.peak - one
                for one in _build_limit_grid(NARROW_CLIP * seen.peak, WIDE_CLIP * seen.peak, WIDER)
            ),
        )
        beyond = build_geometric_grid(0.7 * seen.peak, 10 * seen.peak, 6, cls.shapes[0])
        return (
            *(
                cls.inside(joint, limit, side)
                for limit in sorted(set(limits))
                for side in (0, 1, -1)
            ),
            *(cls.inside(joint, limit, 0, SOFT) for limit in beyond),
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the limit."""
        where = {0: "", 1: " in the positive direction", -1: " in the negative direction"}[
            self.side
        ]
        if self.knee:
            return f"the motor gives less and less per command{where}, and no more than {self.limit:.3g} N m"
        return f"the motor gives no more than {self.limit:.3g} N m{where}, whatever is commanded"
