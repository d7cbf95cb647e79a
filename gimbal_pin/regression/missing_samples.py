"""Gaps in a log: where samples are lost, and which of them are interpolated from the motion around them.

A gap that is closed is fill_gaps, so that the filters run on, and flagged: nothing is ever fitted or judged inside it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log.log import GAP_SAMPLES, Array, Imu, Log

Indices = NDArray[np.integer[Any]]

PERIODS = 0.1
"""A longer interval than `GAP` samples and so many periods of the cutoff is a gap."""
LONGEST_GAP = 0.25
"""Longest gap that is closed, in periods of the cutoff: nothing below it can turn unseen in less."""
GAP_SIDE, FEWEST_SIDE_SAMPLES = 2.0, 6
"""Time on either side from which the motion is taken, in lengths of the gap, and the fewest samples in it."""
RESOLUTION_SHARE = 0.98
"""Share of the samples that the resolution is taken from."""


class Filled(NamedTuple):
    """A log whose closed gaps hold samples.

    Attributes:
        log: The log, with samples in them.
        closed: Begin and end of every gap that was closed, s, (k, 2).
    """

    log: Log
    closed: Array


Side = tuple[Array, Array, Array]
"""Angle, rad, rate and acceleration at one end of a gap, (n,) each."""


def holes(log: Log, cutoff: float) -> Indices:
    """Return the last sample before every gap."""
    return np.flatnonzero(np.diff(log.t) > compute_gap_length(log.dt, cutoff))


def compute_gap_length(dt: float, cutoff: float) -> float:
    """Return the interval, s, from which on two samples have a gap between them."""
    return max(GAP_SAMPLES * dt, PERIODS / cutoff)


def fill_gaps(log: Log, cutoff: float) -> Filled:
    """Fill the gaps in which ``h²/8 max |a| <= resolution``: no chord is further from a motion of that curvature.

    h is the gap's length and a the acceleration on both sides of it and across it. What fills it is a cubic, which
    lies closer still. Longer gaps than `LONGEST_GAP`, and those with too few samples around them, stay.

    `cutoff`: the highest frequency that will be looked at, Hz.
    """
    found = holes(log, cutoff)
    if not len(found):
        return Filled(log, np.zeros((0, 2)))
    edges = np.concatenate([[-1], found, [len(log) - 1]]).tolist()
    fine = resolution(log)
    closed: list[tuple[int, Side, Side]] = []
    for first, k, last in zip(edges, edges[1:], edges[2:]):
        length = float(log.t[k + 1] - log.t[k])
        near = log.t[k] - GAP_SIDE * length, log.t[k + 1] + GAP_SIDE * length
        begin, end = np.searchsorted(log.t, near, side="right").tolist()
        before = slice(max(begin, first + 1), k + 1)
        after = slice(k + 1, min(end, last + 1))
        if (
            min(before.stop - before.start, after.stop - after.start) < FEWEST_SIDE_SAMPLES
            or length * cutoff > LONGEST_GAP
        ):
            continue
        sides = parabola(log, before, float(log.t[k])), parabola(log, after, float(log.t[k + 1]))
        (_, v, a), (_, w, b) = sides
        if np.all(length**2 / 8 * np.max(np.abs([a, b, (w - v) / length]), axis=0) <= fine):
            closed.append((k, *sides))
    times = np.array([[log.t[k], log.t[k + 1]] for k, *_ in closed]).reshape(-1, 2)
    return Filled(inserted(log, closed) if closed else log, times)


def parabola(log: Log, rows: slice, at: float) -> Side:
    """Least squares of ``q + v (t - at) + a (t - at)²/2`` over some samples."""
    t = log.t[rows] - at
    size = max(float(np.abs(t).max()), 1e-12)
    powers = np.stack([np.ones(len(t)), t / size, (t / size) ** 2 / 2], axis=1)
    q, v, a = np.linalg.lstsq(powers, log.q[rows], rcond=None)[0]
    return q, v / size, a / size**2


def resolution(log: Log) -> Array:
    """Standard deviation of the angles' noise and rounding, from third differences over the true intervals, rad, (n,).

    White noise of deviation s gives s whatever the spacing of the samples.
    """
    n = len(log) - 3
    if n < 1:
        return np.zeros(len(log.joints))
    near = [log.t[i : i + n] for i in range(4)]
    weights = [
        1.0 / np.prod([own - other for other in near if other is not own], axis=0) for own in near
    ]
    size = np.sum([w**2 for w in weights], axis=0)
    least = max(1, int(RESOLUTION_SHARE * n))
    # One joint at a time: of a million samples, all joints' would be the most that an identification holds.
    squares = (sum(w * x[i : i + n] for i, w in enumerate(weights)) ** 2 / size for x in log.q.T)
    return np.array([np.sqrt(np.partition(x, least - 1)[:least].mean()) for x in squares])


def inserted(log: Log, closed: list[tuple[int, Side, Side]]) -> Log:
    """Return the log with the angle's cubic in these gaps, its slope for the rate, and straight lines else."""
    t = [log.t]
    q = [log.q]
    slopes = [log.q[:0] if log.v is None else log.v]
    for k, (start, v, _), (end, w, _) in closed:
        length = float(log.t[k + 1] - log.t[k])
        s = np.arange(1, round(length / log.dt))[:, None] * (log.dt / length)
        s = s[s[:, 0] < 1.0 - 1e-9]
        rise = end - start
        drop = s * (1 - s)
        t.append(log.t[k] + length * s[:, 0])
        q.append(start + (3 - 2 * s) * s * s * rise + length * drop * ((1 - s) * v - s * w))
        slopes.append(6 * drop * rise / length + (1 - s) * (1 - 3 * s) * v + s * (3 * s - 2) * w)
    times = np.concatenate(t)
    order = np.argsort(times, kind="stable")
    times = times[order]
    measured = {
        name: x for name in ("tau", "q_ref", "temperature") if (x := getattr(log, name)) is not None
    }
    values: dict[str, Any] = {name: straight(times, log.t, x) for name, x in measured.items()}
    if log.v is not None:
        values["v"] = np.concatenate(slopes)[order]
    imus = {
        link: Imu(**{name: straight(times, log.t, x) for name, x in imu.channels.items()})
        for link, imu in log.imus.items()
    }
    return replace(log, t=times, q=np.concatenate(q)[order], imus=imus, **values)


def straight(times: Array, t: Array, values: Array) -> Array:
    """Interpolate columns linearly, exact at the samples, (N, n)."""
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)


def inside(closed: Array, t: Array) -> NDArray[np.bool_]:
    """Whether times lie in one of the gaps (k, 2), in order and apart from each other, ends left out."""
    begun = np.searchsorted(closed[:, 0], t, side="left")
    ended = np.searchsorted(closed[:, 1], t, side="right")
    return np.asarray(begun > ended)
