"""Time stamps: jitter, lost samples, repeated rows."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from gimbal_pin.checks.harm import spoils_torque
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.checks.series import get_channels, leave_out
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import PAUSE, Array, Log
from gimbal_pin.regression import Filtering, Flags, split_segments
from gimbal_pin.rig.rig import Rig

CLOCK_WINDOW = 51
"""Samples over which a clock is taken to be steady."""
CLOCK_PARTS = 24
"""Parts of the log, the worst of which is judged."""
JITTER, LOST, STALE = 0.07, 0.02, 0.05
"""Worth telling: jitter in periods (rms), lost samples and repeated rows (shares). Less is in every log."""
HOLE, HOLE_SAMPLES = 0.015, 4
"""And a hole of so many seconds and samples."""
SPREAD, SLACK = 4.5, 0.3
"""Where stamps jitter, a long interval is a lost sample only beyond so many median deviations, less so many periods."""
MOVING_STEPS = 8.0
"""Steps of its resolution by which a channel must change over four samples to be moving."""
USABLE = 0.5
"""Share of the time that must lie in stretches long enough for the filter."""


class Ticks(NamedTuple):
    """What the time stamps say of themselves.

    Attributes:
        steady: Stamps of a clock that runs evenly over `CLOCK_WINDOW` samples but for lost ones, s, (N,).
        missing: Samples lost before each sample, (N,).
        jitter: Rms of the stamps about `steady` in the worst part, in periods.
    """

    steady: Array
    missing: Array
    jitter: float


def check_clock(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``t_k = k dt`` but for holes: how far are the stamps from that, and are they or the samples at fault?

    Jitter alone does no harm: samples taken at odd times and stamped so are resampled without loss. Whether the stamps
    or the samples jitter, the angle tells: with true stamps it is smoother over the stamps, with false ones over the
    count. The harm is the torque error that false stamps and repeated rows make.
    """
    if len(log) < 2 * CLOCK_WINDOW:
        return None
    seen = separate_jitter(log.t)
    old = find_repeated_rows(log)
    lost = np.where(seen.missing * log.dt < PAUSE, seen.missing, 0.0)
    figures = (
        Parameter("jitter", seen.jitter, "periods"),
        Parameter("lost", float(lost.sum() / (len(log) + lost.sum())), "1"),
        Parameter("longest_gap", float(lost.max() * log.dt), "s"),
        Parameter(
            "stale", max(float(part.mean()) for part in np.array_split(old, CLOCK_PARTS)), "1"
        ),
    )
    hole = max(HOLE, HOLE_SAMPLES * log.dt)
    beyond = [figure.value / limit for figure, limit in zip(figures, (JITTER, LOST, hole, STALE))]
    if max(beyond) <= 1.0:
        return None
    repairs = list[Log]()
    if beyond[0] > 1.0 and has_false_stamps(log, seen.steady):
        repairs.append(replace(log, t=seen.steady))
    if beyond[3] > 1.0:
        repairs.append((repairs[-1] if repairs else log).part(np.flatnonzero(~old)))
    harmful = bool(repairs) and spoils_torque(rig, log, repairs[-1], filtering)
    sparse = not harmful and is_scattered(log, filtering)
    jitter, shed, gap, stale = (figure.value for figure in figures)
    texts = (
        f"stamps jitter by {100 * jitter:.0f} % of a period",
        f"{digits(100 * shed, 2)} % of the samples are lost",
        f"up to {1000 * gap:.0f} ms are lost in a row",
        f"{100 * stale:.0f} % of the rows of a stretch repeat the row before",
    )
    end = "resampling takes care of it"
    if harmful or sparse:
        end = (
            "this alone spoils the torque"
            if harmful
            else "what is left in one piece is too short for the filters"
        )
    sentence = f"clock: {'; '.join(text for text, size in zip(texts, beyond) if size > 1.0)}; {end}"
    mend = "stamp samples where they are taken (drive or bus time), and log at the bus's rate"
    fault = Fault("clock", None, sentence, figures, max(beyond), harmful or sparse, mend)
    return Examined(fault, tuple(repairs))


def separate_jitter(t: Array) -> Ticks:
    """Take the stamps apart: an even clock, lost samples, jitter."""
    gaps = np.diff(t)
    dt = float(np.median(gaps))
    # A late sample makes a long interval and a short one, a lost sample only a long one.
    short = np.minimum(np.append(gaps[1:], dt), np.append(dt, gaps[:-1]))
    rough = max(SPREAD * float(np.median(np.abs(gaps - dt))) - SLACK * dt, 0.0)
    lost = (gaps > 1.5 * dt + rough) & (gaps + short > 2.5 * dt + rough)
    missing = np.append(0.0, np.where(lost, np.maximum(np.round(gaps / dt) - 1.0, 1.0), 0.0))
    holes = np.cumsum(missing) * dt
    steady = savgol_filter(t - holes, CLOCK_WINDOW, 1)
    squares = np.array_split((t - holes - steady) ** 2, CLOCK_PARTS)
    jitter = max(np.sort(part)[: max(1, int(0.98 * len(part)))].mean() for part in squares)
    return Ticks(steady + holes, missing, float(np.sqrt(jitter)) / dt)


def has_false_stamps(log: Log, steady: Array, certain: float = 4.0) -> bool:
    """Whether the angles are smoother over an even clock than over the stamps, but for their spikes."""
    for stamped, even in zip((leave_out(log.t, log.q) ** 2).T, (leave_out(steady, log.q) ** 2).T):
        largest = np.maximum(stamped, even)
        worse = (stamped - even)[largest <= np.quantile(largest, 0.98)]
        if worse.mean() > certain * max(float(np.std(worse)) / np.sqrt(len(worse)), 1e-300):
            return True
    return False


def find_repeated_rows(log: Log) -> Flags:
    """Rows in which no channel of a moving rig changed since the row before, (N,): a logger faster than its bus."""
    values = np.concatenate(list(get_channels(log).values()), axis=1)
    changes = np.abs(np.diff(values, axis=0))
    same = np.append(False, np.all(changes == 0.0, axis=1))
    if not same.any():
        return same
    # Where the samples around change by several steps of their resolution, a repeated value is no resolution limit.
    step = np.array([x[x > 0].min() if np.any(x > 0) else np.inf for x in changes.T])
    moving = np.zeros(len(log), bool)
    moving[2:-2] = np.any(np.abs(values[4:] - values[:-4]) > MOVING_STEPS * step, axis=1)
    return same & moving


def is_scattered(log: Log, filtering: Filtering) -> bool:
    """Whether gaps leave less than `USABLE` of the time in stretches without any."""
    spans = [s.dt * s.length for s in split_segments(log, filtering.cutoff)]
    covered = sum(span for span in spans if span > 1.0 / filtering.cutoff)
    intervals = np.diff(log.t)
    return bool(covered < USABLE * np.sum(intervals[intervals < PAUSE]))
