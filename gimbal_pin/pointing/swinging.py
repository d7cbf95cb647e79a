"""Loops that swing by themselves: torque of one frequency, far more of it than the platform's motion asks for."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.signal import welch

from gimbal_pin.dynamics.model import Model
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.demand import RATE, Demand
from gimbal_pin.pointing.result import Pointing

BAND = (2.0, 60.0)
"""Frequencies at which a loop is looked for that swings, Hz: below are motions, above the propellers."""
LINE = 0.1
"""Half width of a line, in shares of its frequency."""
SMALLEST = 0.05
"""A line of less torque, rms in torque limits, is none."""
BEYOND = 9.0
"""Power beyond that which the motion asks for: a loop of disk margin 0.5 has less than five times as much."""
LONGEST = 2.0
"""Length of the stretches whose spectra are averaged, s; a run of fewer than two is looked at as one."""


@dataclass(frozen=True)
class Swing:
    """One joint's loop that swings by itself: it is unstable, and but a torque limit or friction holds it.

    Attributes:
        joint: The joint.
        hz: Frequency, Hz.
        share: Torque of that frequency, rms in torque limits.
    """

    joint: str
    hz: float
    share: float

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return asdict(self)


def swinging(plant: Model, wanted: Array, platform: Platform, run: Pointing) -> tuple[Swing, ...]:
    """Return the joints that swing by themselves in the second half of a run, the one that swings most first.

    What the motion asks for is inverse dynamics of the camera standing still; a stable loop gives that, times its
    complementary sensitivity. Moments at which a motor is too weak for it are not looked at.

    Args:
        plant: The plant.
        wanted: The camera's attitude in the world, (3, 3).
        platform: What carried it.
        run: What the camera did.
    """
    half = slice((run.counted.start + len(run.t)) // 2, None)
    step = max(1, round(1 / RATE / run.dt))
    tau, t = means(run.tau[half], step), means(run.t[half, None], step)[:, 0]
    if len(t) < 8 or not any(loudest(x / limit, t)[1] > SMALLEST for x, limit in zip(tau.T, run.tau_max)):
        return ()
    asked = Demand.of(plant, wanted, platform.at(t))
    fine = asked.within(t)
    found = []
    for j, joint in enumerate(run.joints):
        own, other = (fine * x[:, j] / run.tau_max[j] for x in (tau, asked.tau))
        hz, share, beyond = against(own, other, t)
        if share > SMALLEST and beyond > BEYOND:
            found.append(Swing(joint, hz, share))
    return tuple(sorted(found, key=lambda swing: -swing.share))


def means(x: Array, count: int) -> Array:
    """Means of so many consecutive rows, (N, n) → (N // count, n)."""
    whole = len(x) // count
    return np.asarray(x[: whole * count].reshape(whole, count, -1).mean(axis=1))


def lines(x: Array, t: Array) -> tuple[Array, Array]:
    """Frequencies within `BAND`, Hz, and the power of a line at each of them, (K,)."""
    rate = 1 / float(t[1] - t[0])
    f, density = welch(x - x.mean(), rate, nperseg=min(len(x), round(LONGEST * rate)))
    total = np.concatenate([[0.0], np.cumsum(density * (f[1] - f[0]))])
    wide = np.maximum(LINE * f, 1.5 * f[1])  # a window smears a line over three bins at least
    low, high = np.searchsorted(f, f - wide, "left"), np.searchsorted(f, f + wide, "right")
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return f[inside], (total[high] - total[low])[inside]


def loudest(x: Array, t: Array) -> tuple[float, float]:
    """Frequency, Hz, and rms of the loudest line; zero where there is none."""
    f, power = lines(x, t)
    k = int(np.argmax(power)) if len(power) else 0
    return (float(f[k]), float(np.sqrt(power[k]))) if len(power) else (0.0, 0.0)


def against(x: Array, other: Array, t: Array) -> tuple[float, float, float]:
    """Frequency, Hz, and rms of the line of x that exceeds that of another signal most, and how many times its power.

    Lines of less than half the power of the loudest one do not count.
    """
    (f, power), (_, known) = lines(x, t), lines(other, t)
    if not len(f):
        return 0.0, 0.0, 0.0
    ratio = np.where(power >= power.max() / 2, power / np.maximum(known, 1e-12), 0.0)
    k = int(np.argmax(ratio))
    return float(f[k]), float(np.sqrt(power[k])), float(ratio[k])
