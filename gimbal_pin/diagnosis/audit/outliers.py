"""Lone wild samples, and stretches of garbage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from gimbal_pin.diagnosis.audit.base import Fault, stated
from gimbal_pin.diagnosis.audit.harm import Harm, harm
from gimbal_pin.diagnosis.audit.local import constant, left_out, level
from gimbal_pin.diagnosis.audit.mend import CHANNELS, changed, noted, taken
from gimbal_pin.diagnosis.audit.probe import probe, rows_at
from gimbal_pin.estimators.base import residuals
from gimbal_pin.estimators.robust import robust
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering, Flags, dilated

WINDOW = 0.5
"""Length of the windows whose own noise a sample is judged by, s."""
NEAR, WIDE = 12.0, 6.0
"""A spike exceeds its window's median by the first factor, and the log's noise by the second."""
HEIGHT = float(np.sqrt(1.0 + 34.0 / 36.0))
"""Height of a spike per unit of what `left_out` leaves of it on an even grid."""
LONE = 0.5
"""Its neighbours differ by less than this share of it."""
RARE = 0.02
"""More spikes than this share of the samples are the channel's nature."""
ROUGH, WILD = 12.0, 0.3
"""A stretch of garbage is rougher than the median window by the first factor, and than its signal's spread by this."""
DENIED = 10.0
"""Or its filtered torque leaves so many times the median window's residual."""
SECONDS = 1.0
"""Length of the windows of filtered torque, s."""
PART = 0.1
"""More than this share of the log is no stretch."""


class Found(NamedTuple):
    """Lone samples per channel and joint, and rows of garbage, (N,), with the joint that shows most of it."""

    spikes: tuple[tuple[str, int, Flags], ...]
    rows: Flags
    joint: int


@dataclass(frozen=True)
class Outliers:
    """``|x_k - cubic through its four neighbours|`` far above its window's: a bit error, a lost message, a knock.

    Also stretches in which this roughness, or the residual of a robust fit, is far above the rest of the log. The
    fault is as large as the torque error that goes away with the samples.
    """

    name: ClassVar[str] = "outliers"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", 0.002, "1", 0.0, 0.01),
        Parameter("size", 8.0, "standard deviations of the channel", 0.1, 100.0),
        Parameter("seconds", 0.0, "s of garbage", 0.0, 60.0),
        Parameter("channel", 2.0, "0 angle, 1 rate, 2 torque", 0.0, 2.0),
    )

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return the fault, a note where it does no harm, or None."""
        if len(log) < 4 * SECONDS / log.dt:
            return None
        spikes = tuple(lone(log))
        smooth = bridged(log, spikes)
        rough, at = garbage(smooth)
        denied, by = denials(rig, smooth, rough)
        rows = rough | denied
        if not spikes and not rows.any():
            return None
        mended = taken(smooth, np.flatnonzero(~rows)) if rows.any() else smooth
        mended = noted(mended, "outliers were interpolated or cut out")
        joint = at if rough.any() else by if denied.any() else most(spikes)
        return told(rig, log, Found(spikes, rows, joint), harm(rig, log, mended), mended)

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Add spikes to one channel of one joint, or noise over a stretch of it."""
        size = stated(self, shape)
        name = CHANNELS[int(size["channel"])]
        values = np.array(getattr(log, name))
        j, n = int(rng.integers(len(log.joints))), len(log)
        spread = size["size"] * float(np.std(values[:, j]))
        if size["seconds"]:
            length = min(round(size["seconds"] / log.dt), n // 12)
            begin = int(rng.integers(n // 8, 7 * n // 8 - length))
            values[begin : begin + length, j] += 0.25 * spread * rng.standard_normal(length)
        else:
            hit = rng.choice(n, max(1, round(size["share"] * n)), replace=False)
            values[hit, j] += spread * rng.choice([-1.0, 1.0], len(hit)) * rng.uniform(0.5, 1.5, len(hit))
        return changed(log, {name: values})


def lone(log: Log) -> Iterator[tuple[str, int, Flags]]:
    """Yield the channels that have lone wild samples, with these, (N,)."""
    for name in CHANNELS:
        if (values := getattr(log, name)) is None:
            continue
        left = np.abs(left_out(log.t, values))
        for j in range(values.shape[1]):
            bound = np.maximum(NEAR * windowed(left[:, j], log.dt), WIDE * level(left[:, j]))
            # A step has one of these on either side of it, a spike none.
            near, far = np.abs(values[3:-1, j] - values[1:-3, j]), np.abs(values[4:, j] - values[:-4, j])
            hit = np.zeros(len(log), bool)
            hit[2:-2] = (left[:, j] > bound) & (np.maximum(near, far) < LONE * HEIGHT * left[:, j])
            if hit.any() and np.mean(hit) < RARE:
                yield name, j, hit


def windowed(column: Array, dt: float) -> Array:
    """Median of the window that a sample lies in, as a deviation, (m,)."""
    length = max(8, min(round(WINDOW / dt), len(column)))
    edges = np.arange(0, len(column), length)
    medians = np.array([np.median(column[k : k + length]) for k in edges]) / 0.6745
    return np.repeat(medians, np.diff(np.append(edges, len(column))))


def bridged(log: Log, spikes: tuple[tuple[str, int, Flags], ...]) -> Log:
    """Return the log with lone samples interpolated from their neighbours."""
    values = {name: np.array(getattr(log, name)) for name, _, _ in spikes}
    for name, j, hit in spikes:
        values[name][hit, j] = np.interp(log.t[hit], log.t[~hit], values[name][~hit, j])
    return changed(log, values)


def garbage(log: Log) -> tuple[Flags, int]:
    """Rows of windows that are far rougher than the median window, (N,), and the joint."""
    bad, worst, joint = np.zeros(len(log), bool), 0.0, 0
    length = max(8, round(0.1 / log.dt))
    edges = np.arange(0, len(log), length)
    counts = np.diff(np.append(edges, len(log)))
    for name in CHANNELS:
        if (values := getattr(log, name)) is None:
            continue
        left = np.zeros(values.shape)
        left[2:-2] = left_out(log.t, values)
        for j in range(values.shape[1]):
            rough = np.sqrt(np.add.reduceat(left[:, j] ** 2, edges) / counts)
            spread = np.std(values[:, j])
            wild = (rough > ROUGH * np.median(rough)) & (rough > WILD * spread)
            if wild.any() and np.mean(wild) < PART:
                bad |= np.repeat(wild, counts)
                if (size := float(rough.max() / max(spread, 1e-300))) > worst:
                    worst, joint = size, j
    return (dilated(bad[:, None], length // 2)[:, 0] if bad.any() else bad), joint


def denials(rig: Rig, log: Log, known: Flags) -> tuple[Flags, int]:
    """Rows of windows whose filtered torque a robust fit denies, (N,), and the joint that does so most.

    A torque that does not change there is none of this check's business.
    """
    bad = np.zeros(len(log), bool)
    if log.tau is None:
        return bad, 0
    rows = rows_at(probe(rig, taken(log, np.flatnonzero(~known))), Filtering().cutoff)
    if not rows or sum(block.b.size for block in rows) < 6 * rows[0].A.shape[2]:
        return bad, 0
    theta = robust(rows).theta
    t, error, torque = (np.concatenate(x) for x in zip(*((b.t, residuals(b, theta), b.b) for b in rows)))
    place = np.floor((t - log.t[0]) / SECONDS).astype(int)
    windows = np.unique(place)
    size = np.array([np.sqrt(np.mean(error[place == w] ** 2, axis=0)) for w in windows])
    held = np.any([constant(column, log.dt) for column in log.tau.T], axis=0)
    free = ~np.isin(windows, np.floor((log.t[held] - log.t[0]) / SECONDS).astype(int))[:, None]
    over = free & (size > DENIED * np.median(size, axis=0)) & (size > WILD * np.std(torque, axis=0))
    if not over.any() or np.mean(over.any(axis=1)) > PART:
        return bad, 0
    for w in windows[over.any(axis=1)]:
        bad |= (log.t >= log.t[0] + w * SECONDS) & (log.t <= log.t[0] + (w + 1) * SECONDS)
    return bad, int(np.argmax(over.sum(axis=0)))


def most(spikes: tuple[tuple[str, int, Flags], ...]) -> int:
    """The joint with the most lone samples."""
    return max(spikes, key=lambda each: int(each[2].sum()))[1]


def told(rig: Rig, log: Log, found: Found, cost: Harm, mended: Log) -> Fault:
    """Return the fault with its figures and what to do."""
    count = int(sum(hit.sum() for _, _, hit in found.spikes))
    seconds = float(found.rows.sum()) * log.dt
    joint = rig.joints[found.joint]
    severity = (Parameter("spikes", float(count), "samples"), Parameter("garbage", seconds, "s"), *cost.severity)
    parts = ([f"{count} lone wild samples"] if count else []) + ([f"{seconds:.2g} s of garbage"] if seconds else [])
    end = "they spoil the torque" if cost.serious or seconds else "the filter takes care of them"
    sentence = f"{joint}: {' and '.join(parts)}; {end}"
    mend = "look for bit errors, loose plugs and knocks at those times; record again, or go on without the samples"
    return Fault(Outliers.name, joint, severity, cost.serious or bool(seconds), sentence, mend, mended)
