"""A motor that gives another torque than it reports, in proportion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Any, ClassVar

from gimbal_pin.effects.base import Effect, Sample, Term
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter


@dataclass(frozen=True)
class TorqueGain(Effect):
    """``tau = missing tau_model``, so that ``(1 - missing) tau`` acts: gain = 1 - missing.

    A single joint with no known load or coupling cannot show it: all its inertias would scale alike.
    """

    name: ClassVar[str] = "torque-gain"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("missing", nan, "1", -1.0, 0.95),)
    gain: ClassVar[Parameter] = Parameter("gain", nan, "1", 0.05, 2.0)
    loaded: ClassVar[bool] = True
    coupled: ClassVar[bool] = True
    experiment: ClassVar[str] = "all axes at once, with a known mass fixed at a known place"
    lookalikes: ClassVar[tuple[str, ...]] = ("armature", "payload-mass", "torque-ripple")
    compensation: ClassVar[str] = "the command is divided by the gain; correct the torque constant"

    def basis(self, at: Sample) -> tuple[float | Array, ...]:
        """The model's total torque."""
        return (at.tau,)

    def shown(self, values: Sequence[float] = (), covariance: Array | None = None) -> tuple[Parameter, ...]:
        """The gain."""
        return tuple(replace(self.gain, value=1 - x.value, std=x.std) for x in super().shown(values, covariance))

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
        return f"the motor gives {100 * abs(values[0]):.3g} % {word} torque than it reports"
