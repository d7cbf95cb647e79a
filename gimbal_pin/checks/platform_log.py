"""Checks of the log of a platform's IMU, and the stretch of it that is usable as prescribed motion."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.checks.series import find_runs
from gimbal_pin.errors import LogError, digits
from gimbal_pin.log.log import GAP_SAMPLES, Array, Imu
from gimbal_pin.log.platform import PLATFORM_CUTOFF, TURNS
from gimbal_pin.regression import Flags

_REPEATS, _HELD = 8, 0.05
"""All axes of a sensor repeat themselves over so many samples, and so many seconds: it is frozen."""
_STUCK, _LONG = 25, 0.25
"""The same of one axis, which may rest by itself for a while."""
_USUAL = 0.5
"""An axis that repeats itself at more than this share of its samples is coarse or still, not stuck."""
_BRIDGED = 0.25
"""A longer gap is not bridged: a quarter of a second hides whole swings."""
_FEWEST_SECONDS = 2.0
"""Fewest seconds without such a gap."""
_WEIGHT = (5.0, 20.0)
"""Mean specific force of what is carried, m/s²: outside of that it is in another unit, or lacks gravity."""
_FAST = 6.0
"""A platform that turns faster, rad/s rms, is most likely given in degrees."""
_BIASED = 0.1
"""Largest constant rate, rad/s, that is taken for the bias of a gyro at rest."""


class UsablePlatform(NamedTuple):
    """The usable part of a platform's log.

    Attributes:
        t: Time, s, (N,).
        imu: Its samples.
        notes: What is wrong with the rest, in sentences.
    """

    t: Array
    imu: Imu
    notes: tuple[str, ...]


def check_platform_log(t: Array, imu: Imu, name: str) -> UsablePlatform:
    """Leave out frozen readings, and take the longest stretch without a gap that is too long to interpolate.

    Args:
        t: Time, s, increasing, (N,).
        imu: What the platform's IMU reported, gyro and accelerometer.
        name: The log's name.

    Raises:
        LogError: A sensor never changes, no stretch is long enough, or specific force is not that of a carried body.
    """
    if len(t) < 2:
        raise LogError(
            name,
            "has one row, which shows no motion",
            f"record at least {_FEWEST_SECONDS:g} s of the platform",
        )
    if imu.gyro is None or imu.accel is None:  # `Platform.measured` refuses that
        return UsablePlatform(t, imu, ())
    mean = float(np.mean(np.linalg.norm(imu.accel, axis=1)))
    if not _WEIGHT[0] < mean < _WEIGHT[1]:
        what = f"its accelerometer reads {digits(mean)} m/s² in the mean, and whoever is carried feels 9.81"
        raise LogError(
            name,
            what,
            "give specific force: --map accel_LINK_x=ax*9.81 where it is in g, gravity included",
        )
    stuck, notes = _find_frozen(t, imu.gyro, imu.accel, name)
    rows = np.flatnonzero(~stuck)
    first, end, more = _find_longest_stretch(t, rows, name)
    kept = t[rows[first:end]]
    rate = 1 / float(np.median(np.diff(kept)))
    rms = float(np.sqrt(np.mean(np.sum(imu.gyro**2, axis=1))))
    notes += more
    if rate < 2 * PLATFORM_CUTOFF:
        notes.append(
            f"sampled at {digits(rate)} Hz: motion above {digits(rate / 2)} Hz is not in it"
        )
    if rms > _FAST:
        notes.append(
            f"turns at {digits(rms)} rad/s rms: if that is in degrees, map it with *pi/180"
        )
    return UsablePlatform(
        kept, imu.part(rows[first:end]), tuple(f"{name}: {note}" for note in notes)
    )


def _find_frozen(t: Array, gyro: Array, accel: Array, name: str) -> tuple[Flags, list[str]]:
    """Return the samples that only repeat the one before them, (N,), and a sentence on each sensor's.

    Where the gyro says that the platform stands, nothing need change.
    """
    stuck = np.zeros(len(t), dtype=bool)
    notes = list[str]()
    dt = float(np.median(np.diff(t)))
    resting = [
        word
        for word, x in (("gyro", gyro), ("accelerometer", accel))
        if not np.ptp(x, axis=0).any()
    ]
    if len(resting) == 2 and not float(np.linalg.norm(gyro[0])) > _BIASED:
        return stuck, ["nothing in it ever changes: the platform stands"]
    if resting:
        what = f"its {resting[0]} never changes, though the platform moves"
        raise LogError(name, what, "look at its wiring and at the columns, and record again")
    turns = np.linalg.norm(gyro, axis=1) > TURNS
    for word, x in (("gyro", gyro), ("accelerometer", accel)):
        same = np.vstack([np.zeros((1, 3), dtype=bool), np.diff(x, axis=0) == 0.0])
        own = _find_long_runs(np.all(same, axis=1), max(_REPEATS, _HELD / dt))
        for axis in same.T:
            if axis.mean() < _USUAL:
                own |= _find_long_runs(axis, max(_STUCK, _LONG / dt))
        own &= turns
        stuck |= own
        if found := find_runs(own):
            lengths = [float(t[min(end, len(t) - 1)] - t[begin - 1]) for begin, end in found]
            k = int(np.argmax(lengths))
            times = "once" if len(found) == 1 else f"{len(found)} times, the longest time"
            where = f"for {digits(lengths[k])} s from {digits(t[found[k][0] - 1], 4)} s on"
            share = f"{digits(100 * own.mean(), 2)} % of the log"
            notes.append(f"the {word} repeats itself {times} {where} ({share}): that is left out")
    return stuck, notes


def _find_long_runs(flags: Flags, samples: float) -> Flags:
    """Return the flags of runs of at least so many samples, counting the sample that they repeat."""
    out = np.zeros(len(flags), dtype=bool)
    for begin, end in find_runs(flags):
        out[begin:end] = end - begin + 1 >= samples
    return out


def _find_longest_stretch(
    t: Array, rows: NDArray[np.intp], name: str
) -> tuple[int, int, list[str]]:
    """Return begin and end, among the good samples, of the longest stretch without a long gap, and notes.

    Raises:
        LogError: It is too short.
    """
    steps = np.diff(t[rows])
    gaps = np.flatnonzero(steps > GAP_SAMPLES * np.median(np.diff(t)))
    edges = [0, *(gaps[steps[gaps] > _BRIDGED] + 1).tolist(), len(rows)]
    first, end = max(
        itertools.pairwise(edges), key=lambda pair: t[rows[pair[1] - 1]] - t[rows[pair[0]]]
    )
    begins = float(t[rows[first]])
    ends = float(t[rows[end - 1]])
    if ends - begins < _FEWEST_SECONDS and len(edges) > 2:
        lasts = digits(ends - begins)
        what = f"holds no {_FEWEST_SECONDS:g} s in a row without a gap of more than {_BRIDGED:g} s: {lasts} s at most"
        raise LogError(name, what, "record the platform again, or give another stretch")
    notes = []
    if len(edges) > 2:
        lost = (
            f"{len(edges) - 2} gap{'s' * (len(edges) > 3)} of more than {_BRIDGED:g} s, up to "
            f"{digits(steps.max())} s"
        )
        between = f"{digits(begins, 4)} to {digits(ends, 4)} s"
        notes.append(f"{lost}: the longest stretch without one is used, {between}")
    if short := [k for k in gaps.tolist() if first <= k < end - 1]:
        count = f"{len(short)} gap{'s' * (len(short) > 1)} of up to {digits(steps[short].max())} s"
        notes.append(f"{count} in it: the motion there is interpolated")
    return int(first), int(end), notes
