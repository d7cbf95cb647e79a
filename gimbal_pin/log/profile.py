"""Profile S, the reference motion of a platform: hand or airframe, engine, propellers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import Platform
from gimbal_pin.rig.arguments import check_arguments, check_count, to_numbers
from gimbal_pin.rig.types import Rng, make_generator


@dataclass(frozen=True)
class Band:
    """A sum of sines per axis: frequencies log-uniform in a band, amplitude ``rms √(2/n)``, random phase.

    Attributes:
        low: Lowest frequency, Hz.
        high: Highest frequency, Hz.
        rms: Root mean square of the sum, in the quantity's unit.
        count: n, how many sines.
    """

    low: float
    high: float
    rms: float
    count: int


def make_propeller_band(frequency: float, rms: float) -> Band:
    """A propeller: eight sines within 3 % of its frequency, Hz."""
    return Band(0.97 * frequency, 1.03 * frequency, rms, 8)


ATTITUDE = (
    Band(0.2, 1.0, radians(5.0), 20),
    Band(4.0, 12.0, radians(0.3), 40),
    make_propeller_band(75.0, radians(0.0035)),
    make_propeller_band(140.0, radians(0.0014)),
)
"""Roll, pitch and yaw of profile S, rad."""
ACCELERATION = (
    Band(0.2, 2.0, 1.0, 20),
    make_propeller_band(75.0, 1.0),
    make_propeller_band(140.0, 0.5),
)
"""Acceleration in the world of profile S, m/s²."""


@check_arguments
def profile_s(t: Array, rng: Rng = None, size: float = 1.0) -> Platform:
    """Return profile S at the times `t`, s, (N,); `size` scales its angles and accelerations.

    `rng`: a generator or a seed; None: a fresh one, whose seed is in the result. The draws do not depend on `t`: one
    seed is one motion, however finely and long it is looked at.
    """
    t = to_numbers("profile_s: t", t, "(N,)")
    check_count("profile_s: t", t, t.size)
    generator, seed = make_generator(rng)
    angles, rates, accelerations = sum_bands(ATTITUDE, t, generator, 2)
    (acceleration,) = sum_bands(ACCELERATION, t, generator, 0)
    drawn = Platform.turning(
        t, size * angles, size * rates, size * accelerations, size * acceleration
    )
    return replace(drawn, seed=seed)


def sum_bands(
    bands: Sequence[Band], t: Array, rng: np.random.Generator, derivatives: int
) -> tuple[Array, ...]:
    """Return the bands' sum on three axes and so many of its derivatives (0 or 2), (N, 3) each."""
    out = tuple(np.zeros((len(t), 3)) for _ in range(derivatives + 1))
    for axis in range(3):
        for band in bands:
            omega = 2 * np.pi * np.exp(rng.uniform(np.log(band.low), np.log(band.high), band.count))
            phase = rng.uniform(0.0, 2 * np.pi, band.count)
            size = band.rms * np.sqrt(2 / band.count)
            for w, start in zip(omega.tolist(), phase.tolist()):
                wave = size * np.sin(w * t + start)
                out[0][:, axis] += wave
                if derivatives:
                    out[1][:, axis] += size * w * np.cos(w * t + start)
                    out[2][:, axis] -= w**2 * wave
    return out
