"""Holes in a log: where samples are lost, and which holes the motion around them closes.

A hole that is closed is filled, so that the filters run on, and flagged: nothing is ever fitted or judged inside it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log.log import Array, Imu, Log

Indices = NDArray[np.integer[Any]]

SAMPLES, PERIODS = 4.5, 0.1
"""A longer interval than so many samples and so many periods of the cutoff is a hole."""
LONGEST = 0.25
"""Periods of the cutoff in which nothing below it can turn unseen: no longer hole is closed."""
SIDE, LEAST = 2.0, 6
"""Time on either side that tells the motion, in lengths of the hole, and the fewest samples in it."""
KEPT = 0.98
"""Share of the samples that the resolution is taken from."""


class Side(NamedTuple):
    """Angle, rad, rate and acceleration at one end of a hole, from a parabola through the samples beside it, (n,)."""

    q: Array
    v: Array
    a: Array


class Filled(NamedTuple):
    """A log whose closed holes hold samples.

    Attributes:
        log: The log, with samples in them.
        closed: Begin and end of every hole that was closed, s, (k, 2).
    """

    log: Log
    closed: Array


def holes(log: Log, cutoff: float) -> Indices:
    """Return the last sample before every hole."""
    return np.flatnonzero(np.diff(log.t) > max(SAMPLES * log.dt, PERIODS / cutoff))


def filled(log: Log, cutoff: float) -> Filled:
    """Fill the holes in which ``h²/8 max |a| <= resolution``: no chord is further from a motion of that curvature.

    h is the hole's length and a the acceleration on both sides of it and across it. What fills it is a cubic, which
    lies closer still. Longer holes than `LONGEST`, and those without motion enough around them, stay holes.

    `cutoff`: the highest frequency that will be looked at, Hz.
    """
    found = holes(log, cutoff)
    if not len(found):
        return Filled(log, np.zeros((0, 2)))
    edges, fine = np.concatenate([[-1], found, [len(log) - 1]]).tolist(), resolution(log)
    closed: list[tuple[int, Side, Side]] = []
    for first, k, last in zip(edges, edges[1:], edges[2:]):
        sides = beside(log, first + 1, k, last)
        length = float(log.t[k + 1] - log.t[k])
        if sides is not None and length * cutoff <= LONGEST and np.all(sagitta(*sides, length) <= fine):
            closed.append((k, *sides))
    times = np.array([[log.t[k], log.t[k + 1]] for k, *_ in closed]).reshape(-1, 2)
    return Filled(inserted(log, closed) if closed else log, times)


def beside(log: Log, first: int, k: int, last: int) -> tuple[Side, Side] | None:
    """The motion on both sides of the hole after sample k, from samples first ... last; None where they are few."""
    reach = SIDE * (log.t[k + 1] - log.t[k])
    begin, end = np.searchsorted(log.t, [log.t[k] - reach, log.t[k + 1] + reach], side="right")
    before, after = slice(max(int(begin), first), k + 1), slice(k + 1, min(int(end), last + 1))
    if min(before.stop - before.start, after.stop - after.start) < LEAST:
        return None
    return parabola(log, before, float(log.t[k])), parabola(log, after, float(log.t[k + 1]))


def parabola(log: Log, rows: slice, at: float) -> Side:
    """Least squares of ``q + v (t - at) + a (t - at)²/2`` over some samples."""
    t = log.t[rows] - at
    size = max(float(np.abs(t).max()), 1e-12)
    powers = np.stack([np.ones(len(t)), t / size, (t / size) ** 2 / 2], axis=1)
    q, v, a = np.linalg.lstsq(powers, log.q[rows], rcond=None)[0]
    return Side(q, v / size, a / size**2)


def sagitta(before: Side, after: Side, length: float) -> Array:
    """``h²/8 max |a|`` over both ends and the mean between them, rad, (n,)."""
    across = (after.v - before.v) / length
    return np.asarray(length**2 / 8 * np.max(np.abs([before.a, after.a, across]), axis=0))


def resolution(log: Log) -> Array:
    """Standard deviation of the angles' noise and rounding, from third differences over the true intervals, rad, (n,).

    White noise of deviation s gives s whatever the spacing of the samples.
    """
    n = len(log) - 3
    if n < 1:
        return np.zeros(len(log.joints))
    near = [log.t[i : i + n] for i in range(4)]
    weights = [1.0 / np.prod([own - other for other in near if other is not own], axis=0) for own in near]
    rough = np.sum([w[:, None] * log.q[i : i + n] for i, w in enumerate(weights)], axis=0)
    squares = np.sort(rough**2 / np.sum(np.square(weights), axis=0)[:, None], axis=0)
    return np.asarray(np.sqrt(squares[: max(1, int(KEPT * n))].mean(axis=0)))


def inserted(log: Log, closed: list[tuple[int, Side, Side]]) -> Log:
    """Return the log with the angle's cubic in these holes, its slope for the rate, and straight lines else."""
    t, q, slopes = [log.t], [log.q], list[Array]()
    for k, before, after in closed:
        length = float(log.t[k + 1] - log.t[k])
        s = np.arange(1, round(length / log.dt))[:, None] * (log.dt / length)
        s = s[s[:, 0] < 1.0 - 1e-9]
        t.append(log.t[k] + length * s[:, 0])
        rise, drop = after.q - before.q, s * (1 - s)
        cubic = before.q + (3 - 2 * s) * s * s * rise + length * drop * ((1 - s) * before.v - s * after.v)
        q.append(cubic)
        slope = 6 * drop * rise / length + (1 - s) * (1 - 3 * s) * before.v + s * (3 * s - 2) * after.v
        slopes.append(slope)
    times = np.concatenate(t)
    order = np.argsort(times, kind="stable")
    times = times[order]
    measured = {name: x for name in ("tau", "q_ref", "temperature") if (x := getattr(log, name)) is not None}
    values: dict[str, Any] = {name: straight(times, log.t, x) for name, x in measured.items()}
    if log.v is not None:
        values["v"] = np.concatenate([log.v, *slopes])[order]
    imus = {
        link: Imu(**{name: straight(times, log.t, x) for name, x in imu.channels.items()})
        for link, imu in log.imus.items()
    }
    return replace(log, t=times, q=np.concatenate(q)[order], imus=imus, **values)


def straight(times: Array, t: Array, values: Array) -> Array:
    """Interpolate columns linearly, exact at the samples, (N, n)."""
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)


def inside(closed: Array, t: Array) -> NDArray[np.bool_]:
    """Whether times lie in one of the holes (k, 2), in order and apart from each other, ends left out."""
    begun, ended = np.searchsorted(closed[:, 0], t, side="left"), np.searchsorted(closed[:, 1], t, side="right")
    return np.asarray(begun > ended)
