"""A motor that gives another torque than it reports, in proportion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.functions import clip_value
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.log.log import Array


@dataclass(frozen=True)
class TorqueGain(Effect):
    """``tau = missing tau_model``, so that ``(1 - missing) tau`` acts: gain = 1 - missing.

    A single joint with no known load or coupling cannot show it: all its inertias would scale alike. A half of the
    amplifier, or of its current sensing, that is off in one direction alone bends the torque, and that shows anywhere.

    Attributes:
        joint: The joint whose motor it is.
        side: 1 or -1 if only torques in that direction are off; 0 for both.
    """

    side: int = 0

    name: ClassVar[str] = "torque-gain"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("missing", nan, "1", -1.0, 0.95),)
    gain: ClassVar[Parameter] = Parameter(
        "gain", nan, "1", 0.05, 2.0, meaning="torque that acts over the torque that is reported"
    )
    loaded: ClassVar[bool] = True
    hidden: ClassVar[str] = (
        "the inertias that this joint moves scale as a gain in both directions would: only a known load, or fast "
        "motion of all axes, tells them apart"
    )
    like_inertia: ClassVar[bool] = True
    experiment: ClassVar[str] = "all axes at once, with a known mass fixed at a known place"
    compensation: ClassVar[str] = "the command is divided by the gain; correct the torque constant"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The model's total torque, or what of it has the one direction."""
        return (clip_value(at.tau, 0.0 if self.side > 0 else -inf, 0.0 if self.side < 0 else inf),)

    @property
    def coupled(self) -> bool:
        """Only what is the same in both directions scales like inertias."""
        return self.side == 0

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """In both directions, and in either."""
        return tuple(cls(joint, side) for side in (0, 1, -1))

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """The gain."""
        return tuple(
            replace(self.gain, value=1 - x.value, std=x.std)
            for x in super().shown(values, covariance)
        )

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """The gain."""
        return (cls.gain,)

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return the term with this gain."""
        return Term(cls(str(joint)), (1 - given["gain"],))

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the gain in per cent."""
        word = "less" if values[0] >= 0 else "more"
        where = {0: "", 1: " in the positive direction", -1: " in the negative direction"}[
            self.side
        ]
        return f"the motor gives {100 * abs(values[0]):.3g} % {word} torque than it reports{where}"
