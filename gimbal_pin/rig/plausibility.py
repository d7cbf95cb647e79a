"""Comparison of a rig's numbers with each other: values that contradict the rest are probably in another unit."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from gimbal_pin.rig.inertia import join_names

if TYPE_CHECKING:
    from gimbal_pin.rig.rig import Rig

UNIT_RATIO = 1000**0.5
"""Ratio of two like quantities of a rig from which one of them is probably in another unit.

Millimetres, grams and N mm make a value 1000 times too large. The square root is the middle, on a logarithmic scale,
between equal quantities and such a slip. With twice the ratio a slip must be that much clearer to be noted.
"""
MAX_DENSITY = 22_590.0
"""Density of osmium, the densest material, kg/m³ (CRC Handbook of Chemistry and Physics).

With twice the density, bodies have to be smaller by a fifth before their mass is noted.
"""
MAX_PLAUSIBLE_ANGLE = 4.1 * pi
"""Two turns, rad, which files round up: a joint that turns further is continuous, and ±13° in degrees are beyond it.

With twice the angle, limits up to ±25 that are in degrees pass.
"""

MAX_REACH = 1.0
"""Length of the largest gimbals, m: a body's radius of gyration may exceed it by `UNIT_RATIO` at most.

It holds where all bodies share the error, as with inertias in kg mm². With twice the length, small bodies pass.
"""
MAX_TURN_SECONDS = UNIT_RATIO**0.5
"""Longest time from rest through one radian at full torque, s.

Motors of gimbals and arms take .01 to 1 s; inertias that are 1000 times too large take 30 times as long, and this is
the middle. With twice the time, an inertia must be another four times too large before it is noted.
"""
MAX_TORQUE_PER_MASS = 150.0
"""Peak torque of a geared motor per mass, N m/kg; the densest have 140 (T-Motor AK80-64, 120 N m at 0.85 kg).

Of a rig the moved mass is counted, motors and payload. With twice the value, torques may be twice as large.
"""


def find_implausible_values(rig: Rig) -> Iterator[str]:
    """Yield a sentence on each kind of value that the rest of the rig contradicts, with the places of such values.

    Of all bodies of mass m with the radius of gyration ``k² = ∫ r² dm / m``, a sphere is the least dense: it has the
    radius ``R = k / √0.6``. A rig's length is that of its chain of joints, or its bodies' lower median radius of
    gyration if that is longer. A motor of torque τ turns the inertia I through one radian in ``√(2 I / τ)``.
    """
    bodies = rig.model.inertias.tolist()[1:]
    masses = np.array([body.mass for body in bodies])
    gyration = np.sqrt([np.trace(body.inertia) / 2 for body in bodies] / masses)
    origins = np.linalg.norm(
        [place.translation for place in rig.model.jointPlacements.tolist()[1:]], axis=1
    )
    places = np.maximum(origins, np.linalg.norm([body.lever for body in bodies], axis=1))
    typical_gyration = np.sort(gyration)[(rig.n - 1) // 2]
    length = min(max(origins.sum(), typical_gyration), MAX_REACH)
    inertia = np.diag(pin.crba(rig.model, rig.model.createData(), pin.neutral(rig.model)))
    turning = np.where(rig.slides, 0.0, [np.maximum(-rig.stops[0], rig.stops[1]), rig.tau_max])
    torque = MAX_TORQUE_PER_MASS * masses.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        turn_seconds = np.where(rig.slides, 0.0, np.sqrt(2 * inertia / rig.tau_max))
        density = masses / (4 / 3 * pi * (gyration / sqrt(0.6)) ** 3)
    for sentence, names, values, bound in (
        (
            "angles beyond two turns are probably in degrees, not in rad",
            rig.joints,
            turning[0],
            MAX_PLAUSIBLE_ANGLE,
        ),
        (
            "origins far from all bodies are probably not in m",
            rig.joints,
            places,
            UNIT_RATIO * typical_gyration,
        ),
        (
            "radii of gyration beyond the rig's size: state inertias in kg m²",
            rig.links,
            gyration,
            UNIT_RATIO * length,
        ),
        (
            "seconds through one radian at full torque: state inertias in kg m², torque limits in N m",
            rig.joints,
            turn_seconds,
            MAX_TURN_SECONDS,
        ),
        (
            "kg/m³ beyond any material: state masses in kg, inertias in kg m²",
            rig.links,
            density,
            MAX_DENSITY,
        ),
        (
            "torque limits beyond motors of the rig's mass: state them in N m",
            rig.joints,
            turning[1],
            torque,
        ),
    ):
        wrong = [f"{name} {value:.4g}" for name, value in zip(names, values) if bound < value < inf]
        if wrong:
            yield f"{sentence}: {join_names(wrong)}"
