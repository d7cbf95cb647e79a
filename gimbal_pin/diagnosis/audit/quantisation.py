"""Resolution of the channels: no fault of its own, but what the other checks and the reader want to know."""

from __future__ import annotations

from dataclasses import dataclass
from math import log2, pi

import numpy as np

from gimbal_pin.diagnosis.audit.mend import CHANNELS
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter

COARSE = 12.0
"""An encoder of fewer bits per turn is worth a sentence."""


@dataclass(frozen=True)
class Resolution:
    """Smallest change of a joint's channels, 0 where a channel takes any value.

    Attributes:
        joint: The joint.
        angle: Step of the angle, rad.
        rate: Step of the rate, rad/s.
        torque: Step of the torque, N m.
    """

    joint: str
    angle: float
    rate: float
    torque: float

    @property
    def bits(self) -> float:
        """Resolution of the angle in bits per turn; infinite where it has no step."""
        return log2(2.0 * pi / self.angle) if self.angle > 0 else float("inf")

    @property
    def sentence(self) -> str | None:
        """A note for a coarse encoder, else None."""
        if self.bits >= COARSE:
            return None
        return f"{self.joint}: the angle has steps of {1000 * self.angle:.2g} mrad ({self.bits:.0f} bits per turn)"

    @property
    def figures(self) -> tuple[Parameter, ...]:
        """The steps with their units."""
        units = (
            ("angle_step", self.angle, "rad"),
            ("rate_step", self.rate, "rad/s"),
            ("torque_step", self.torque, "N m"),
        )
        return tuple(Parameter(name, value, unit) for name, value, unit in units)


def resolutions(log: Log) -> tuple[Resolution, ...]:
    """Return the resolution of every joint's channels."""
    steps = [[0.0] * len(log.joints) if (x := getattr(log, name)) is None else quanta(x) for name in CHANNELS]
    return tuple(Resolution(joint, *each) for joint, *each in zip(log.joints, *steps))


def quanta(signal: Array) -> list[float]:
    """Return each column's step: the change that all changes are whole multiples of; 0 where there is none."""
    return [quantum(column) for column in signal.T]


def quantum(column: Array) -> float:
    """``max d`` with every change a whole multiple of d, but for rounding in the log; 0 if there is none."""
    levels = np.unique(column)
    # A file holds some digits of each value: two writings of one level are one level.
    spread = 1e-7 * max(float(np.abs(levels).max(initial=0.0)), 1e-300)
    gaps = np.diff(levels)
    gaps = gaps[gaps > spread]
    if len(gaps) < 4:
        return 0.0
    # Of a channel that takes any value the smallest gaps are chance, and the others no multiples of them.
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    return step if np.mean(np.abs(gaps / step - np.round(gaps / step)) < 0.05) > 0.95 else 0.0
