"""Columns that can be in no SI units: refused where that is certain, noted where it is likely."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite, pi
from types import MappingProxyType

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gimbal_pin.errors import LogError
from gimbal_pin.log.limited import MOSTLY, near_limit
from gimbal_pin.log.log import Array
from gimbal_pin.log.mapping import Source, remapped
from gimbal_pin.rig.rig import Rig

_TOO_STRONG = 3.0
"""Torque over a motor's limit from which it is not in N m: noise and clipping go a little beyond."""
_SPIKES = 0.01
"""Share of the samples at either end that do not count: spikes are the audit's to find."""
_FEWEST = 50
"""Fewest samples that are judged."""
_BEYOND = 1.5
"""Travel over the room within the rig's limits, a turn of the encoder aside, from which it is not in radians."""
_INTERVALS = 200
"""Intervals over which angles are compared with the integrals of their rates."""
_ALIKE = 0.9
"""Least correlation of the two by which their ratio counts."""
_OFF = 3.0
"""Ratio of the two from which they are in different units."""


def check_units(
    name: str,
    rig: Rig,
    t: Array,
    q: Array,
    v: Array | None,
    q_ref: Array | None = None,
    sources: Mapping[str, Source] = MappingProxyType({}),
) -> None:
    """Raise `LogError` for angles, rates or times that can be no radians, radians per second or seconds.

    And for angles that are radians of a joint which its loop has lost.

    Args:
        name: The file.
        rig: Whose limits the angles are compared with.
        t: Time, (N,).
        q: Angles, (N, n).
        v: Rates, (N, n), or None.
        q_ref: References, (N, n), or None.
        sources: What the columns were read from.
    """
    if len(t) >= _FEWEST:
        _check_angles(name, rig, sources, q, q_ref)
    if v is not None and len(t) > _INTERVALS:
        _check_rates(name, rig, sources, t, q, v)


def _check_angles(name: str, rig: Rig, sources: Mapping[str, Source], q: Array, q_ref: Array | None) -> None:
    """Raise `LogError` if joints travel much farther than the rig's limits let them, in radians."""
    travel = np.subtract(*np.quantile(q, [1 - _SPIKES, _SPIKES], axis=0))
    room = np.subtract(*rig.stops[::-1])
    off = [j for j in range(rig.n) if isfinite(room[j]) and travel[j] > _BEYOND * room[j] + 2 * pi]
    for j in off if q_ref is not None else ():
        # Where an angle goes as its reference does, in whatever unit, the loop holds the joint.
        assert q_ref is not None
        a, b = q_ref[:, j] - q_ref[:, j].mean(), q[:, j] - q[:, j].mean()
        if not a @ b > _ALIKE * np.sqrt((a @ a) * (b @ b)):
            joint, limits = rig.joints[j], f"where the rig's limits leave {room[j]:.3g}"
            what = f"q_{joint} travels {travel[j]:.4g} rad {limits}, and not as q_ref_{joint}"
            raise LogError(
                name,
                rig.in_units(joint, what),
                "the loop lost the joint: give a log of one that holds it, of lower gains",
            )
    if off:
        j = off[0]
        what = f"q_{rig.joints[j]} travels {travel[j]:.4g} rad where the rig's limits leave {room[j]:.3g}"
        likely = travel[j] < 1.1 * degrees(room[j])
        factor, unit = ("pi/180", "degrees") if likely else ("(rad per unit)", "counts or another unit")
        names = [f"q_{rig.joints[k]}" for k in off]
        maps = remapped(sources, {name: (name, factor) for name in names})
        what = rig.in_units(rig.joints[j], what)
        raise LogError(name, what, f"if these are {unit}, map them, and rates in such units as well: {maps}")


def _check_rates(name: str, rig: Rig, sources: Mapping[str, Source], t: Array, q: Array, v: Array) -> None:
    """Raise `LogError` if an angle plainly follows its rate, but many times faster or slower."""
    ends = np.linspace(0, len(t) - 1, _INTERVALS + 1).astype(int)
    moved, sums = (np.diff(x[ends], axis=0) for x in (q, cumulative_trapezoid(v, t, axis=0, initial=0.0)))
    size, other, both = (np.sum(a * b, axis=0) for a, b in ((moved, moved), (sums, sums), (moved, sums)))
    ratio = np.sqrt(size / np.maximum(other, 1e-300))
    alike = (both > _ALIKE * np.sqrt(size * other)) & (both > 0)
    off = alike & ((ratio > _OFF) | (ratio < 1 / _OFF))
    if not off.any():
        return
    j = int(np.argmax(off))
    joint, factor = rig.joints[j], float(ratio[j])
    what = f"q_{joint} moves {factor:.3g} times as far as dq_{joint} says"
    if factor == 0:
        raise LogError(name, f"q_{joint} stands still, while dq_{joint} does not", "map the columns of one joint")
    if off.sum() == alike.sum() and abs(np.log10(factor) + 3) < 0.3:
        maps = remapped(sources, {"t": ("t", 1e-3)})
        raise LogError(name, f"{what}, as every joint does", f"t is in ms, not s: map it: {maps}")
    maps = remapped(sources, {f"dq_{joint}": (f"dq_{joint}", float(f"{factor:.3g}"))})
    mend = f"one of the two is in degrees, or in other units: {maps}, or map q_{joint}"
    raise LogError(name, what, mend)


def describe_torques(rig: Rig, tau: Array | None) -> tuple[str, ...]:
    """Return a sentence per joint whose torque, (N, n), can be no N m, or is at the motor's limit most of the time."""
    if tau is None:
        return ()
    joints = list(zip(rig.joints, rig.tau_max, np.abs(tau).max(axis=0), near_limit(tau, rig.tau_max).tolist()))
    strong = [
        (
            joint,
            f"tau_{joint} reaches {most:.4g} N m where the motor's limit is {limit:.3g}; if it is a current or in "
            f"other units, map tau_{joint}=COLUMN*(N m per unit)",
        )
        for joint, limit, most, _ in joints
        if most > _TOO_STRONG * limit
    ]
    pushed = [
        (
            joint,
            f"tau_{joint} is at the motor's limit of {limit:.3g} N m for {100 * share:.0f} % of the time: a loop that "
            "swings or cannot follow shows little of the rig; record one that holds it, of lower gains or slower",
        )
        for joint, limit, _, share in joints
        if share > MOSTLY
    ]
    return tuple(rig.in_units(joint, said) for joint, said in (*strong, *pushed))
