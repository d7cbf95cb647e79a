"""A drive that follows its command with a lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, nan
from typing import ClassVar

from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange, build_geometric_grid
from gimbal_pin.effects.signal import Signal, SignalMemory


@dataclass(frozen=True)
class ActuatorLag(Signal):
    """``time_constant dy/dt = x - y``: a current loop of finite bandwidth.

    Attributes:
        joint: The joint whose motor lags.
        time_constant: Time to 1 - 1/e of a step, s.
    """

    time_constant: float

    name: ClassVar[str] = "actuator-lag"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "time_constant",
            nan,
            "s",
            1e-5,
            1.0,
            meaning="time that the torque takes to follow a step of the command by 63 %",
        ),
    )
    linear: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "a chirp to 20 Hz and above: a lag loses torque with frequency, a delay does not"
    )
    compensation: ClassVar[str] = (
        "tune with the time constant added to the loop's delay; raise the current loop's gain"
    )

    def start(self, level: float = 0.0) -> SignalMemory:
        """Return the torque at the end of the last interval."""
        return (level,)

    def step(self, memory: SignalMemory, x: float, dt: float) -> tuple[SignalMemory, float]:
        """Exact for a held command: the torque at the end of the interval, and its mean."""
        away = memory[0] - x
        left = exp(-dt / self.time_constant)
        return (x + away * left,), x + away * (1 - left) * self.time_constant / dt

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Time constants from a tenth of a sample of the channels to a tenth of a second."""
        return tuple(
            cls.inside(joint, time)
            for time in build_geometric_grid(seen.dt / 10, 0.1, 9, cls.shapes[0])
        )

    def says(self, values: Sequence[float] = ()) -> str:
        """Return the time constant in milliseconds."""
        return f"the motor's torque follows the command with a time constant of {1e3 * self.time_constant:.3g} ms"
