"""Columns that can be in no SI units: refused where that is certain, noted where it is likely."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite, pi
from types import MappingProxyType

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log import signals
from gimbal_pin.log.io.recognise import OTHER_UNIT, find_ratio, take_increments
from gimbal_pin.log.limited import MOSTLY, compute_share_near_limit
from gimbal_pin.log.log import Array
from gimbal_pin.log.mapping import Source, format_remapping
from gimbal_pin.rig.rig import Rig

JOINED_INTERVALS = 10
"""Intervals that are joined for a second estimate of a rate's scale, which a low-pass or delay changes less."""
MIN_WRONG_RATE_SCALE = 1.25
"""Factor between an angle and its rate's integral that is another unit or gear: scales of gyros and drives differ by
some per cent. Doubling its logarithm, 1.56, would hide a gear of 3 to 2."""
MIN_INCREMENT_TO_NOISE_POWER = 100.0
"""Power of increments over their noise from which these must correlate with their rate's by more than 0.9: noise alone
then leaves 0.99. At twice that fewer joints are judged."""


def check_units(
    name: str,
    rig: Rig,
    t: Array,
    q: Array,
    v: Array | None,
    q_ref: Array | None = None,
    sources: Mapping[str, Source] = MappingProxyType({}),
) -> list[str]:
    """Return notes on rates that are not their angles' derivatives; raise `LogError` where units are surely others.

    That is for angles, rates or times that can be no radians, radians per second or seconds, for rates that have
    changed places, and for angles that are radians of a joint which its loop has lost. Fewer than 50 samples are not
    judged.

    Args:
        name: The file.
        rig: Whose limits the angles are compared with.
        t: Time, (N,).
        q: Angles, (N, n).
        v: Rates, (N, n), or None.
        q_ref: References, (N, n), or None.
        sources: What the columns were read from.
    """
    if len(t) >= 50:
        _check_angles(name, rig, sources, q, q_ref)
        if v is not None:
            return _check_rates(name, rig, sources, t, q, v)
    return []


def _check_angles(
    name: str, rig: Rig, sources: Mapping[str, Source], q: Array, q_ref: Array | None
) -> None:
    """Raise `LogError` if joints travel much farther than the rig's limits let them, in radians.

    That is half as far again, and a turn of the encoder; spikes, a hundredth of the samples, do not count.
    """
    travel = np.subtract(*np.quantile(q, [0.99, 0.01], axis=0))
    room = np.subtract(*rig.stops[::-1])
    off = [j for j in range(rig.n) if isfinite(room[j]) and travel[j] > 1.5 * room[j] + 2 * pi]
    for j in off:
        # Where an angle goes as its reference does, in whatever unit, the loop holds the joint.
        a, b = (np.zeros(len(q)) if x is None else x[:, j] - x[:, j].mean() for x in (q_ref, q))
        if q_ref is not None and not a @ b > 0.9 * np.sqrt((a @ a) * (b @ b)):
            what = f"q_{rig.joints[j]} travels {travel[j]:.4g} rad where the rig's limits leave {room[j]:.3g}, and not"
            what = rig.in_units(rig.joints[j], f"{what} as q_ref_{rig.joints[j]}")
            raise LogError(
                name,
                what,
                "the loop lost the joint: give a log of one that holds it, of lower gains",
            )
    for j in off[:1]:
        what = f"q_{rig.joints[j]} travels {travel[j]:.4g} rad where the rig's limits leave {room[j]:.3g}"
        names = [f"q_{rig.joints[k]}" for k in off]
        given = [sources.get(name, Source(name)) for name in names]
        plain = all(source.factor == 1.0 for source in given)
        likely = plain and travel[j] < 1.1 * degrees(room[j])
        factor, unit = (
            ("pi/180", "degrees") if likely else ("RAD_PER_UNIT", "counts or another unit")
        )
        maps = format_remapping(
            {name: Source(source.column) for name, source in zip(names, given)},
            {name: (name, factor) for name in names},
        )
        mend = f"if these are {unit}, map them, and rates in such units as well: {maps}"
        raise LogError(name, rig.in_units(rig.joints[j], what), mend)


def _check_rates(
    name: str, rig: Rig, sources: Mapping[str, Source], t: Array, q: Array, v: Array
) -> list[str]:
    """Return notes on rates whose integral is not their angle, or a multiple of it.

    Raises:
        LogError: Rates have changed places, or an angle plainly follows its rate, but many times faster or slower, or
            the other way.
    """
    moved = take_increments(t, q)
    sums = take_increments(t, v, integrated=True)
    pairs = list(zip(rig.joints, moved.T, sums.T))
    ratios = {joint: ratio for joint, *pair in pairs if (ratio := find_ratio(*pair)[1])}
    lost = [pair for pair in pairs if pair[0] not in ratios]
    # With independent noise the product of both crossed correlations is at most that of the joints' own, under 0.81.
    follows = {x[0]: y[0] for x in lost for y in lost if x[0] != y[0] and find_ratio(x[1], y[2])[1]}
    if follows and sorted(follows) == sorted(follows.values()):
        maps = format_remapping(
            sources, {f"dq_{joint}": (f"dq_{other}", 1.0) for joint, other in follows.items()}
        )
        names = " and ".join(f"dq_{joint}" for joint in follows)
        raise LogError(
            name, f"{names} hold the rates of each other's joints", f"exchange them: {maps}"
        )
    off = {
        joint: ratio for joint, ratio in ratios.items() if not 1 / OTHER_UNIT < ratio < OTHER_UNIT
    }
    for joint, factor in list(off.items())[:1]:
        if 1 / OTHER_UNIT < -factor < OTHER_UNIT:
            maps = format_remapping(sources, {f"dq_{joint}": (f"dq_{joint}", -1.0)})
            raise LogError(
                name,
                f"dq_{joint} is negative where q_{joint} rises",
                f"turn the sign of one: {maps}",
            )
        what = f"q_{joint} moves {factor:.3g} times as far as dq_{joint} says"
        if len(off) == len(ratios) and abs(np.log10(factor) + 3) < 0.3:
            maps = format_remapping(sources, {"t": ("t", 1e-3)})
            raise LogError(
                name, f"{what}, as every joint does", f"t is in ms, not s: map it: {maps}"
            )
        maps = format_remapping(sources, {f"dq_{joint}": (f"dq_{joint}", float(f"{factor:.3g}"))})
        raise LogError(
            name, what, f"one of the two is in degrees, or in other units: {maps}, or map q_{joint}"
        )
    notes = []
    few = slice(0, len(moved) // JOINED_INTERVALS * JOINED_INTERVALS)
    noise = (
        2.0 * signals.noise_std(q) ** 2,
        len(t) / len(moved) * (np.median(np.diff(t)) * signals.noise_std(v)) ** 2,
    )
    for j, (joint, x, y) in enumerate(pairs):
        coarse = find_ratio(
            *(part[few].reshape(-1, JOINED_INTERVALS).sum(axis=1) for part in (x, y))
        )[1]
        ratio = ratios.get(joint, 0.0)
        is_scale = ratio * coarse > 0 and abs(np.log(ratio / coarse)) < np.log(1.1)
        if not ratio and all(
            np.mean(part**2) > MIN_INCREMENT_TO_NOISE_POWER * power[j]
            for part, power in zip((x, y), noise)
        ):
            notes.append(
                f"{name}: dq_{joint} is not the derivative of q_{joint}: leave rates out, or map another column"
            )
        elif is_scale and abs(np.log(ratio)) > np.log(MIN_WRONG_RATE_SCALE):
            maps = format_remapping(
                sources, {f"dq_{joint}": (f"dq_{joint}", float(f"{ratio:.3g}"))}
            )
            what = f"q_{joint} moves {ratio:.3g} times as far as dq_{joint} says"
            notes.append(
                f"{name}: {what}: map the rate, {maps}, or the angle; the time where every joint has this factor"
            )
    return notes


def describe_torques(rig: Rig, tau: Array | None) -> tuple[str, ...]:
    """Return a sentence per joint whose torque, (N, n), can be no N m, or is at the motor's limit most of the time.

    Noise and clipping go a little beyond the limit, and not to three times it.
    """
    strong = list[str]()
    pushed = list[str]()
    for joint, limit, x in zip(rig.joints, rig.tau_max, () if tau is None else tau.T):
        most = float(np.abs(x).max())
        share = float(compute_share_near_limit(x, limit))
        if most > 3.0 * limit:
            mend = f"if it is a current or in other units, map tau_{joint}=COLUMN*(N m per unit)"
            said = (
                f"tau_{joint} reaches {most:.4g} N m where the motor's limit is {limit:.3g}; {mend}"
            )
            strong.append(rig.in_units(joint, said))
        if share > MOSTLY:
            mend = (
                "a loop that swings or cannot follow shows little of the rig; record one that "
                "holds it, of lower gains"
            )
            said = f"tau_{joint} is at the motor's limit of {limit:.3g} N m for {100 * share:.0f} % of the time: {mend}"
            pushed.append(rig.in_units(joint, f"{said} or slower"))
    return (*strong, *pushed)
