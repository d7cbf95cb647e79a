"""Where up is, by an accelerometer that moves: its mean, turned into the world by the gyros."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot, inf
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array


class Upright(NamedTuple):
    """What levelling remembers.

    Attributes:
        samples: How many its means are of, at most those of `span`.
        means: Means of the specific force in the gyros' world, one per weight, m/s², (3, 3).
        turn: What levels that world, (3, 3).
        eased: Time in which the correction comes in, s.
    """

    samples: int
    means: Array
    turn: Array
    eased: float


@dataclass(frozen=True)
class Level:
    """``f̄ = Σ a_c y_c``, ``y_c⁺ = y_c + c/(n + c - 1) (R f - y_c)``: up is the mean of the specific force in the world.

    y_c weighs the sample of time t by t^(c-1), so a = (10, -15, 6) for c = (3, 4, 5) weighs by t² (T - t)²: the mean
    acceleration of a platform that goes nowhere is its velocity's change over T, and such a window leaves but its
    place's, over T², and less. From `span` on the same sums are three low-passes in a row. The turn that levels is
    in no loop and costs no margin; a constant bias b of the gyros leaves 0.8 b `span`.

    Attributes:
        dt: Sampling interval, s.
        span: Longest time that counts, s: 0.02° are left of profile S.
        eased: Time in which the correction comes in, s; in a world that is known to be level it is `span`, by when the
            mean is as good as that: profile S turns such a world by less than 0.02°.
    """

    dt: float
    span: float = 40.0
    eased: float = 1.0

    def start(self, sure: bool) -> Upright:
        """Memory of a world that is level as it is known to be, or as one sample had it, which is not sure."""
        return Upright(
            0, np.tile([0.0, 0.0, 9.81], (3, 1)), np.eye(3), self.span if sure else self.eased
        )

    def step(self, memory: Upright, f: Array) -> Upright:
        """Memory with a specific force in the gyros' world, m/s², (3,)."""
        count = min(memory.samples + 1, round(self.span / self.dt))
        gains = np.array([[3 / (count + 2)], [4 / (count + 3)], [5 / (count + 4)]])
        means = memory.means + gains * (f - memory.means)
        x, y, z = (10 * means[0] - 15 * means[1] + 6 * means[2]).tolist()
        part = min(count * self.dt / memory.eased, 1.0)
        tilt = (part * part * (3 - 2 * part)) ** 2 * atan2(hypot(x, y), z)
        aside = max(hypot(x, y), 1e-12)
        return Upright(
            count, means, pin.exp3(tilt * np.array([y / aside, -x / aside, 0.0])), memory.eased
        )


def leveled(f: Array) -> Array:
    """Attitude with heading zero in which a specific force points up, (3, 3); level where there is none."""
    x, y, z = np.asarray(f, float).tolist()
    if not 0 < hypot(x, y, z) < inf:
        return np.eye(3)
    return np.asarray(pin.rpy.rpyToMatrix(atan2(y, z), atan2(-x, hypot(y, z)), 0.0))
