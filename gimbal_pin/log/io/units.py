"""Columns that can be in no SI units: refused where that is sure, told where it is likely."""

from __future__ import annotations

from math import degrees, inf, isfinite, pi

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.limited import MOSTLY, near_limit
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

TOO_STRONG = 3.0
"""Torque over a motor's limit from which it is none in N m: noise and clipping go a little beyond."""
FEW = 0.01
"""Share of the samples at either end that do not count: spikes are the audit's to find."""
FEWEST = 50
"""Samples that can be judged."""
BEYOND = 1.5
"""Travel over what the rig's limits leave, a turn of the encoder aside, from which it is none in radians."""
INTERVALS = 200
"""Intervals over which angles are compared with what their rates add up to."""
ALIKE = 0.9
"""Least correlation of the two that tells their ratio."""
OFF = 3.0
"""Ratio of the two from which they are in different units."""


def check_units(name: str, rig: Rig, t: Array, q: Array, v: Array | None, q_ref: Array | None = None) -> None:
    """Raise `LogError` for angles, rates or times that can be no radians, radians per second or seconds.

    And for angles that are radians of a joint which its loop has lost.

    Args:
        name: The file.
        rig: Whose limits the angles are compared with.
        t: Time, (N,).
        q: Angles, (N, n).
        v: Rates, (N, n), or None.
        q_ref: References, (N, n), or None.
    """
    if len(t) >= FEWEST:
        check_angles(name, rig, q, q_ref)
    if v is not None and len(t) > INTERVALS:
        check_rates(name, rig, t, q, v)


def check_angles(name: str, rig: Rig, q: Array, q_ref: Array | None) -> None:
    """Raise `LogError` if joints travel much farther than the rig's limits let them, in radians."""
    way = np.subtract(*np.quantile(q, [1 - FEW, FEW], axis=0))
    room = np.array([limit.upper - limit.lower if isfinite(limit.upper - limit.lower) else inf for limit in rig.limits])
    off = [j for j in range(rig.n) if way[j] > BEYOND * room[j] + 2 * pi]
    if not off:
        return
    worst = off[0]
    if q_ref is not None and (lost := [j for j in off if not followed(q_ref[:, j], q[:, j])]):
        joint, far, most = rig.joints[lost[0]], way[lost[0]], room[lost[0]]
        what = f"q_{joint} travels {far:.4g} rad where the rig's limits leave {most:.3g}, and not as q_ref_{joint}"
        raise LogError(name, what, "the loop lost the joint: give a log of one that holds it, of lower gains")
    likely = way[worst] < 1.1 * degrees(room[worst])
    what = f"q_{rig.joints[worst]} travels {way[worst]:.4g} rad where the rig's limits leave {room[worst]:.3g}"
    factor, unit = ("pi/180", "degrees") if likely else ("(rad per unit)", "counts or another unit")
    mend = " ".join(f"--map q_{rig.joints[j]}=COLUMN*{factor}" for j in off)
    raise LogError(name, what, f"if these are {unit}, map them, and rates in such units as well: {mend}")


def followed(reference: Array, angle: Array) -> bool:
    """Whether an angle goes where its reference does, in whatever unit: their correlation is over `ALIKE`."""
    a, b = reference - reference.mean(), angle - angle.mean()
    return bool(a @ b > ALIKE * np.sqrt((a @ a) * (b @ b)))


def check_rates(name: str, rig: Rig, t: Array, q: Array, v: Array) -> None:
    """Raise `LogError` if an angle plainly follows its rate, but many times faster or slower."""
    ends = np.linspace(0, len(t) - 1, INTERVALS + 1).astype(int)
    added = np.concatenate([np.zeros((1, rig.n)), np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t)[:, None], axis=0)])
    ways, sums = np.diff(q[ends], axis=0), np.diff(added[ends], axis=0)
    size, other, both = (np.sum(a * b, axis=0) for a, b in ((ways, ways), (sums, sums), (ways, sums)))
    ratio = np.sqrt(size / np.maximum(other, 1e-300))
    tells = (both > ALIKE * np.sqrt(size * other)) & (both > 0)
    off = tells & ((ratio > OFF) | (ratio < 1 / OFF))
    if not off.any():
        return
    j = int(np.argmax(off))
    joint, factor = rig.joints[j], float(ratio[j])
    what = f"q_{joint} moves {factor:.3g} times as far as dq_{joint} says"
    if factor == 0:
        raise LogError(name, f"q_{joint} stands still, while dq_{joint} does not", "map the columns of one joint")
    if off.sum() == tells.sum() and abs(np.log10(factor) + 3) < 0.3:
        raise LogError(name, f"{what}, as every joint does", "t is in ms, not s: map it: --map t=COLUMN*1e-3")
    mend = f"one of the two is in degrees, or in other units: --map dq_{joint}=COLUMN*{factor:.3g}, or map q_{joint}"
    raise LogError(name, what, mend)


def pushed(rig: Rig, tau: Array | None) -> tuple[str, ...]:
    """Return a sentence per joint that is at its torque limit most of the time: its loop swings, or cannot follow."""
    if tau is None:
        return ()
    shares = near_limit(tau, rig.tau_max).tolist()
    return tuple(
        f"tau_{joint} is at the motor's limit of {limit:.3g} N m for {100 * share:.0f} % of the time: a loop that "
        "swings or cannot follow shows little of the rig; record one that holds it, of lower gains or slower"
        for joint, limit, share in zip(rig.joints, rig.tau_max, shares)
        if share > MOSTLY
    )


def strong(rig: Rig, tau: Array | None) -> tuple[str, ...]:
    """Return a sentence per joint whose torque can be no N m: it is far beyond what its motor has."""
    if tau is None:
        return ()
    return tuple(
        f"tau_{joint} reaches {reach:.4g} N m where the motor's limit is {limit:.3g}; if it is a current or in other "
        f"units, map tau_{joint}=COLUMN*(N m per unit)"
        for joint, limit, reach in zip(rig.joints, rig.tau_max, np.abs(tau).max(axis=0))
        if reach > TOO_STRONG * limit
    )
