"""Lone wild samples, and stretches of garbage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.checks.harm import spoils_torque
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.checks.series import (
    WORDS,
    compute_medians,
    compute_trimmed_rms,
    find_runs,
    get_channels,
    leave_out,
)
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, Flags, dilate_flags
from gimbal_pin.rig.rig import Rig

NOISE_WINDOW = 0.5
"""Length of the windows whose own noise a sample is judged by, s."""
SPIKE_OVER_WINDOW, SPIKE_OVER_LOG = 12.0, 6.0
"""A spike exceeds its window's median by the first factor, and the log's noise by the second."""
SPIKE_HEIGHT = float(np.sqrt(1.0 + 34.0 / 36.0))
"""Height of a spike per unit of what `leave_out` leaves of it on an even grid."""
LONE = 0.5
"""Its neighbours differ by less than this share of it."""
RARE = 0.02
"""More spikes than this share of the samples are the channel's nature."""
GROSS = 1.0
"""Spikes of so many standard deviations of their channel are reported even where they do no harm."""
SHORT = 0.1
"""Length of the windows whose roughness is compared, s: the median's, for a knock is rough for a few samples only."""
GARBAGE_ROUGHNESS, GARBAGE_SPREAD = 12.0, 0.7
"""Garbage is rougher than the median window by the first factor, and than its signal's spread by the second."""
OWN = 3.0
"""A rate is as rough as so many times its angle's differences through no fault of its own."""
LARGEST_GARBAGE = 0.25
"""More than this share of the log is no stretch."""


class Wild(NamedTuple):
    """Wild rows of one joint's channel, (N,), and their largest size in standard deviations of it."""

    channel: str
    joint: int
    rows: Flags
    size: float


def check_outliers(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``|x_k - cubic through its four neighbours|`` far above its window's: a bit error, a lost message, a knock.

    Also stretches in which this roughness is far above the rest of the log. The harm is the torque error that goes
    away with the samples.
    """
    if len(log) < 8 * NOISE_WINDOW / log.dt:
        return None
    names, values = zip(*get_channels(log).items())
    left = dict(zip(names, np.split(leave_out(log.t, np.hstack(values)), len(names), axis=1)))
    found = find_spikes(log, left)
    smooth = interpolate_spikes(log, found)
    left |= {
        name: leave_out(log.t, getattr(smooth, name)) for name in {wild.channel for wild in found}
    }
    bad = find_garbage(smooth, left)
    if not found and not bad:
        return None
    mended = (
        smooth.part(np.flatnonzero(~np.any([wild.rows for wild in bad], axis=0))) if bad else smooth
    )
    harmful = spoils_torque(rig, log, mended, filtering)
    if not bad and not harmful and max(wild.size for wild in found) < GROSS:
        return None
    worst = max(bad or found, key=lambda wild: wild.size * int(wild.rows.sum()))
    count = sum(int(wild.rows.sum()) for wild in found)
    unreliable = harmful or bool(bad)
    seconds = sum(end - begin for wild in bad for begin, end in find_runs(wild.rows)) * log.dt
    figures = (
        Parameter("spikes", float(count), "samples"),
        Parameter("garbage", float(seconds), "s"),
        Parameter("size", worst.size, "standard deviations"),
    )
    parts = [f"{count} lone wild sample{'s' * (count > 1)}"] if count else []
    parts += [f"{digits(seconds, 2)} s of garbage"] if bad else []
    end = "they spoil the torque" if unreliable else "the filter takes care of them"
    joint = log.joints[worst.joint]
    sentence = f"{joint}: {' and '.join(parts)}, worst in the {WORDS[worst.channel]}; {end}"
    mend = "look for bit errors, loose plugs and knocks at those times; record again, or go on without the samples"
    fault = Fault("outliers", joint, sentence, figures, worst.size / GROSS, unreliable, mend)
    return Examined(fault, (mended,))


def find_spikes(log: Log, left: Mapping[str, Array]) -> list[Wild]:
    """Return the channels that have lone wild samples, by what `leave_out` leaves of each, (N - 4, n).

    A lone torque counts where it is larger than the whole range of the others: smaller ones a drive delivers when its
    rate jumps from one encoder step to the next, or when it chatters.
    """
    out = []
    for name, values in get_channels(log).items():
        for j, (column, rough) in enumerate(zip(values.T, np.abs(left[name]).T)):
            hit = np.zeros(len(log), bool)
            hit[2:-2] = find_lone_samples(column, rough, log.dt)
            if name == "tau" and hit.any():
                hit[2:-2] &= SPIKE_HEIGHT * rough > np.ptp(column[~hit])
            if hit.any() and np.mean(hit) < RARE:
                size = SPIKE_HEIGHT * rough[hit[2:-2]].max() / max(float(np.std(column)), 1e-300)
                out.append(Wild(name, j, hit, float(size)))
    return out


def find_lone_samples(column: Array, left: Array, dt: float) -> Flags:
    """Samples far from the cubic through their neighbours, which agree with each other, (N - 4,)."""
    from scipy.ndimage import convolve1d

    wild = left > SPIKE_OVER_LOG * compute_trimmed_rms(left)
    if not wild.any():
        return wild
    length = max(8, min(round(NOISE_WINDOW / dt), len(left)))
    window = np.repeat(compute_medians(left[:, None], length)[:, 0] / 0.6745, length)[: len(left)]
    # A step has one of these on either side of it, a spike none.
    near = np.abs(column[3:-1] - column[1:-3])
    far = np.abs(column[4:] - column[:-4])
    agree = np.maximum(near, far) < LONE * SPIKE_HEIGHT * left
    hit = wild & (left > SPIKE_OVER_WINDOW * window) & agree
    # Of a channel that changes its sign with every sample all neighbours but the nearest agree.
    neighbours = convolve1d(hit.astype(int), [1, 0, 1], mode="constant")
    return np.asarray(hit & (neighbours == 0))


def interpolate_spikes(log: Log, found: Sequence[Wild]) -> Log:
    """Return the log with lone samples interpolated from their neighbours."""
    values: dict[str, Any] = {wild.channel: np.array(getattr(log, wild.channel)) for wild in found}
    for name, j, hit, _ in found:
        values[name][hit, j] = np.interp(log.t[hit], log.t[~hit], values[name][~hit, j])
    return replace(log, **values)


def find_garbage(log: Log, left: Mapping[str, Array]) -> list[Wild]:
    """Return stretches in which an angle or a rate is far rougher than in the median window.

    Not of torques: a drive that chatters makes them as rough as garbage would. `left` is as in `find_spikes`.
    """
    length = max(8, round(SHORT / log.dt))
    out = []

    def compute_roughness(name: str, j: int) -> Array:
        return (
            compute_medians(np.pad(np.abs(left[name][:, [j]]), ((2, 2), (0, 0))), length)[:, 0]
            / 0.6745
        )

    for name in ("q", "v") if log.v is not None else ("q",):
        values = getattr(log, name)
        for j, spread in enumerate(np.maximum(np.std(values, axis=0), 1e-300).tolist()):
            if (
                np.sum(np.abs(left[name][:, j]) > 0.6745 * GARBAGE_SPREAD * spread)
                < length // 2 - 2
            ):
                continue  # no window's median can be so large
            window = compute_roughness(name, j)
            wild = (window > GARBAGE_ROUGHNESS * np.median(window)) & (
                window > GARBAGE_SPREAD * spread
            )
            if name == "v":
                wild &= window > OWN * compute_roughness("q", j) / log.dt
            rows = np.repeat(wild, length)[: len(log)]
            if wild.any() and np.mean(rows) < LARGEST_GARBAGE:
                rows = dilate_flags(rows[:, None], length // 2)[:, 0]
                out.append(Wild(name, j, rows, float(window.max()) / spread))
    return out
