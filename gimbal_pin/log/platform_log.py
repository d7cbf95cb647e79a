"""What is wrong with the log of a platform's IMU, and the stretch of it that a rig can be carried along."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.errors import LogError, digits
from gimbal_pin.log.log import Array, Imu
from gimbal_pin.log.platform import CUTOFF, TURNS

Flags = NDArray[np.bool_]
REPEATS, HELD = 8, 0.05
"""All axes of a sensor repeat themselves over so many samples, and so many seconds: it is frozen."""
STUCK, LONG = 25, 0.25
"""The same of one axis, which may rest by itself for a while."""
USUAL = 0.5
"""An axis that repeats itself at more than this share of its samples is coarse or still, not stuck."""
HOLE = 4.5
"""A longer interval than so many samples is a gap."""
BRIDGED = 0.25
"""A longer gap is not bridged: a quarter of a second hides whole swings."""
SHORTEST = 2.0
"""Fewer seconds without such a gap are no motion to be carried along."""
WEIGHT = (5.0, 20.0)
"""Mean specific force of what is carried, m/s²: outside of that it is another unit, or lacks gravity."""
FAST = 6.0
"""A platform that turns faster, rad/s rms, is most likely given in degrees."""
BIASED = 0.1
"""A rate that never changes and is more than this, rad/s, is no gyro's bias on a platform that stands."""
WORDS = {"gyro": "gyro", "accel": "accelerometer"}


class Aboard(NamedTuple):
    """A platform's log as far as it can be used.

    Attributes:
        t: Time, s, (N,).
        imu: Its samples.
        notes: What is wrong with the rest, in sentences.
    """

    t: Array
    imu: Imu
    notes: tuple[str, ...]


def sound(t: Array, imu: Imu, name: str) -> Aboard:
    """Leave out frozen readings, and take the longest stretch without a gap that nothing bridges.

    Args:
        t: Time, s, increasing, (N,).
        imu: What the platform's IMU reported, gyro and accelerometer.
        name: The log's name.

    Raises:
        LogError: A sensor never changes, no stretch is long enough, or specific force is none.
    """
    if len(t) < 2:
        raise LogError(name, "has one row, which shows no motion", f"record at least {SHORTEST:g} s of the platform")
    if imu.gyro is None or imu.accel is None:  # `Platform.measured` refuses that
        return Aboard(t, imu, ())
    plausible(imu.accel, name)
    stuck, told = frozen(t, imu, name)
    rows = np.flatnonzero(~stuck)
    first, end, more = whole(t, rows, name)
    rows = rows[first:end]
    kept = t[rows]
    notes = [*told, *more, *slow(kept), *quick(imu)]
    return Aboard(kept, picked(imu, rows), tuple(f"{name}: {note}" for note in notes))


def plausible(accel: Array, name: str) -> None:
    """Raise `LogError` where specific force, (N, 3), is not that of something carried."""
    mean = float(np.mean(np.linalg.norm(accel, axis=1)))
    if not WEIGHT[0] < mean < WEIGHT[1]:
        what = f"its accelerometer reads {digits(mean)} m/s² in the mean, and whoever is carried feels 9.81"
        raise LogError(name, what, "give specific force: --map accel_LINK_x=ax*9.81 where it is in g, gravity included")


def frozen(t: Array, imu: Imu, name: str) -> tuple[Flags, list[str]]:
    """Return the samples that only repeat the one before them, (N,), and what to say of them.

    Where the gyro says that the platform stands, nothing need change.
    """
    stuck, told, dt = np.zeros(len(t), dtype=bool), list[str](), float(np.median(np.diff(t)))
    resting = {sensor: x for sensor in WORDS if (x := getattr(imu, sensor)) is not None and not np.ptp(x, axis=0).any()}
    turning = "gyro" in resting and float(np.linalg.norm(resting["gyro"][0])) > BIASED
    if len(resting) == 2 and not turning:
        return stuck, ["nothing in it ever changes: the platform stands"]
    if resting:
        what = f"its {WORDS[next(iter(resting))]} never changes, though the platform moves"
        raise LogError(name, what, "look at its wiring and at the columns, and record again")
    turns = np.ones(len(t), dtype=bool) if imu.gyro is None else np.linalg.norm(imu.gyro, axis=1) > TURNS
    for sensor, word in WORDS.items():
        if (x := getattr(imu, sensor)) is not None:
            own = repeated(x, dt) & turns
            stuck |= own
            told += said(word, t, own)
    return stuck, told


def repeated(x: Array, dt: float) -> Flags:
    """Whether samples only repeat those before them: of all axes (N, 3) for long, or of one for longer."""
    same = np.vstack([np.zeros((1, x.shape[1]), dtype=bool), np.diff(x, axis=0) == 0.0])
    out = np.zeros(len(x), dtype=bool)
    for rows, samples, seconds in ((same.all(axis=1), REPEATS, HELD), *((axis, STUCK, LONG) for axis in same.T)):
        for begin, end in runs(rows) if samples == REPEATS or rows.mean() < USUAL else ():
            if end - begin + 1 >= max(samples, seconds / dt):
                out[begin:end] = True
    return out


def runs(flags: Flags) -> list[tuple[int, int]]:
    """First and one past the last index of every run of true flags."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(ends[::2].tolist(), ends[1::2].tolist()))


def said(word: str, t: Array, stuck: Flags) -> list[str]:
    """Say where a sensor was frozen."""
    found = runs(stuck)
    if not found:
        return []
    lengths = [float(t[min(end, len(t) - 1)] - t[begin - 1]) for begin, end in found]
    k = int(np.argmax(lengths))
    times = "once" if len(found) == 1 else f"{len(found)} times, the longest time"
    where = f"for {digits(lengths[k])} s from {digits(t[found[k][0] - 1], 4)} s on"
    return [
        f"the {word} repeats itself {times} {where} ({digits(100 * stuck.mean(), 2)} % of the log): that is left out"
    ]


def whole(t: Array, rows: NDArray[np.intp], name: str) -> tuple[int, int, list[str]]:
    """Return begin and end, among the good samples, of the longest stretch without a long gap, and what to say.

    Raises:
        LogError: It is too short.
    """
    steps = np.diff(t[rows])
    gaps = np.flatnonzero(steps > HOLE * np.median(np.diff(t)))
    edges = [0, *(gaps[steps[gaps] > BRIDGED] + 1).tolist(), len(rows)]
    first, end = max(itertools.pairwise(edges), key=lambda pair: t[rows[pair[1] - 1]] - t[rows[pair[0]]])
    lasts = float(t[rows[end - 1]] - t[rows[first]])
    if lasts < SHORTEST and len(edges) > 2:
        what = f"holds no {SHORTEST:g} s in a row without a gap of more than {BRIDGED:g} s: {digits(lasts)} s at most"
        raise LogError(name, what, "record the platform again, or give another stretch")
    told = []
    if len(edges) > 2:
        between = f"{digits(t[rows[first]], 4)} to {digits(t[rows[end - 1]], 4)} s"
        lost = f"{len(edges) - 2} gap{'s' * (len(edges) > 3)} of more than {BRIDGED:g} s, up to {digits(steps.max())} s"
        told.append(f"{lost}: the longest stretch without one is used, {between}")
    short = [k for k in gaps.tolist() if first <= k < end - 1]
    if short:
        longest = f"{len(short)} gap{'s' * (len(short) > 1)} of up to {digits(steps[short].max())} s"
        told.append(f"{longest} in it: the motion there is interpolated")
    return int(first), int(end), told


def slow(t: Array) -> list[str]:
    """Say that a log does not show motion up to the cutoff."""
    rate = 1 / float(np.median(np.diff(t)))
    return (
        [f"sampled at {digits(rate)} Hz: motion above {digits(rate / 2)} Hz is not in it"] if rate < 2 * CUTOFF else []
    )


def quick(imu: Imu) -> list[str]:
    """Say that a gyro may be in degrees."""
    rms = 0.0 if imu.gyro is None else float(np.sqrt(np.mean(np.sum(imu.gyro**2, axis=1))))
    return [f"turns at {digits(rms)} rad/s rms: if that is in degrees, map it with *pi/180"] if rms > FAST else []


def picked(imu: Imu, rows: NDArray[np.intp]) -> Imu:
    """Return some of an IMU's samples."""
    return Imu(*(None if x is None else x[rows] for x in (imu.gyro, imu.accel, imu.quat)))
