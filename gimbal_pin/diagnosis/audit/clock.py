"""Time stamps: jitter, lost and repeated samples, drift."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from gimbal_pin import signals
from gimbal_pin.diagnosis.audit.base import Fault, stated
from gimbal_pin.diagnosis.audit.harm import Harm, harm
from gimbal_pin.diagnosis.audit.local import left_out
from gimbal_pin.diagnosis.audit.mend import noted, taken
from gimbal_pin.log import Array, Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering, Flags, stretches

WINDOW = 51
"""Samples over which a clock is taken to be steady."""
JITTER, STALE, DRIFT = 0.01, 0.02, 0.002
"""From here on it is worth a note: jitter in periods (rms), repeated rows (share), change of the interval (share)."""
SURE = 0.6
"""Step of the stamps' median, in periods, that is a lost sample."""
ROUGH = 0.15
"""Jitter in periods from which a long interval alone is no lost sample."""
CERTAIN = 4.0
"""Deviations by which the stamps must be worse, or better, than counting samples."""
TRIM = 0.98
"""Share of the samples that are compared: the others may be spikes."""
PARTS = 8
"""Parts of the log whose intervals are compared."""
STEPS = 8.0
"""Steps of its resolution by which a channel must change over four samples to be moving."""
USABLE = 0.5
"""Share of the time that must lie in stretches long enough for the filter."""


class Ticks(NamedTuple):
    """What the time stamps say of themselves.

    Attributes:
        steady: Stamps of a clock that runs evenly over `WINDOW` samples but for lost ones, s, (N,).
        missing: Samples lost before each sample, (N,).
        jitter: Rms of the stamps about `steady`, in periods.
        drift: Largest change of the interval between parts of the log, as a share.
        intervals: Interval of each part, s, (PARTS,).
    """

    steady: Array
    missing: Array
    jitter: float
    drift: float
    intervals: Array


@dataclass(frozen=True)
class Clock:
    """``t_k = k dt`` is what a fit differentiates with; stamps that a busy host writes are not.

    Jitter alone is no fault: samples taken at odd times and stamped so are resampled without loss. Whether the stamps
    or the samples jitter, the angle tells: with true stamps it is smoother over the stamps, with false ones over the
    count. The fault is as large as the torque error that the false stamps make, against the noise floor.
    """

    name: ClassVar[str] = "clock"
    shapes: ClassVar[tuple[Parameter, ...]] = (
        Parameter("jitter", 0.25, "periods", 0.0, 0.45),
        Parameter("lost", 0.01, "1", 0.0, 0.5),
        Parameter("drift", 0.0, "1", -0.5, 0.5),
        Parameter("stale", 0.0, "1", 0.0, 0.9),
    )

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return the fault, a note where it does no harm, or None."""
        if len(log) < 2 * WINDOW:
            return None
        seen, old = ticks(log.t), repeated(log)
        severity = figures(log, seen, old)
        if not severity:
            return None
        mended = with_even_stamps(log, seen)
        if np.mean(old) > STALE:
            mended = noted(taken(mended, np.flatnonzero(~old)), "repeated rows were left out")
        if mended is log:
            return told(severity, scattered(log), None, None)
        cost = harm(rig, log, mended)
        return told(severity, scattered(log) or cost.serious, cost, mended)

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Stamp the samples with a clock that jitters and drifts, lose some, and repeat some rows."""
        size, n = stated(self, shape), len(log)
        kept = np.flatnonzero(rng.random(n) >= size["lost"])
        row = np.maximum(np.arange(n) - (rng.random(n) < size["stale"]), 0)
        span = log.t - log.t[0]
        slow = log.t + 0.5 * size["drift"] * span**2 / span[-1]
        late = np.clip(size["jitter"] * rng.standard_normal(n), -0.49, 0.49) * log.dt
        return taken(taken(log, row, slow + late), kept)


def figures(log: Log, seen: Ticks, old: Flags) -> tuple[Parameter, ...]:
    """Return what is worth a note; nothing if nothing is."""
    stale = float(np.mean(old)) if np.mean(old) > STALE else 0.0
    lost = float(seen.missing.sum() / (len(log) + seen.missing.sum()))
    if seen.jitter < JITTER and lost == 0.0 and seen.drift < DRIFT and stale == 0.0:
        return ()
    return (
        Parameter("jitter", seen.jitter, "periods"),
        Parameter("lost", lost, "1"),
        Parameter("longest_gap", float(np.diff(log.t).max()), "s"),
        Parameter("drift", seen.drift, "1"),
        Parameter("stale", stale, "1"),
    )


def scattered(log: Log) -> bool:
    """Whether gaps leave less than `USABLE` of the time in stretches without any."""
    cutoff = Filtering().cutoff
    covered = sum(s.dt * (s.length - 1) for s in stretches(log, cutoff) if s.dt * s.length > 1.0 / cutoff)
    return bool(covered < USABLE * (log.t[-1] - log.t[0]))


def with_even_stamps(log: Log, seen: Ticks) -> Log:
    """Return the log with an even clock's stamps where its own are false; else the log itself."""
    if seen.drift > DRIFT and false_drift(log, seen):
        return noted(replace(log, t=counted(log.t, seen)), "time stamps were replaced by counting samples")
    if seen.jitter > JITTER and false_jitter(log, seen):
        return noted(replace(log, t=seen.steady), "time stamps were evened")
    return log


def ticks(t: Array) -> Ticks:
    """Take the stamps apart: an even clock, lost samples, jitter and drift."""
    dt = float(np.median(np.diff(t)))
    missing = lone_gaps(t, dt)
    steady, jitter = evened(t, missing * dt)
    if ROUGH * dt < jitter < dt:
        none = np.zeros(len(t))
        (steady, jitter), missing = evened(t, none), none
        stepped = steps(t, dt)
        if jitter > evened(t, stepped * dt)[1]:
            (steady, jitter), missing = evened(t, stepped * dt), stepped
    even = t - np.cumsum(missing) * dt
    parts = np.array([np.polyfit(np.arange(len(part)), part, 1)[0] for part in np.array_split(even, PARTS)])
    return Ticks(steady, missing, jitter / dt, float((parts.max() - parts.min()) / dt), parts)


def lone_gaps(t: Array, dt: float) -> Array:
    """Samples lost before each sample, (N,): a late sample makes a long and a short interval, a lost one a long one."""
    gaps = np.diff(t)
    short = np.minimum(np.append(gaps[1:], dt), np.append(dt, gaps[:-1]))
    lost = (gaps > 1.5 * dt) & (gaps + short > 2.5 * dt)
    return np.append(0.0, np.where(lost, np.maximum(np.round(gaps / dt) - 1.0, 1.0), 0.0))


def steps(t: Array, dt: float) -> Array:
    """The same where the jitter is so large that single intervals do not tell: the stamps step up for good, (N,)."""
    half = WINDOW // 4
    late = t / dt - np.arange(len(t))
    level = median_filter(late, half, mode="nearest")
    step = np.zeros(len(t))
    step[half:-half] = (
        level[half + half // 2 : len(t) - half + half // 2] - level[half - 1 - half // 2 : -half - 1 - half // 2]
    )
    peak = (step == maximum_filter1d(step, 2 * half + 1)) & (step > SURE)
    return np.where(peak, np.maximum(np.round(step), 1.0), 0.0)


def evened(t: Array, lost: Array) -> tuple[Array, float]:
    """Return the stamps of a clock that runs evenly but for the time `lost` before each sample, and the jitter, s."""
    holes = np.cumsum(lost)
    even, half = t - holes, WINDOW // 2
    steady = uniform_filter1d(even, WINDOW)
    steady = straightened(even, steady, half)
    squares = np.sort((even - steady) ** 2)
    return steady + holes, float(np.sqrt(squares[: max(1, int(0.99 * len(squares)))].mean()))


def straightened(even: Array, steady: Array, half: int) -> Array:
    """Replace the ends, where the moving average has no window, by straight lines through the samples there."""
    out, n = steady.copy(), np.arange(2 * half)
    for part in (slice(0, 2 * half), slice(len(even) - 2 * half, len(even))):
        line = np.polyval(np.polyfit(n, even[part], 1), n)
        ends = slice(0, half) if part.start == 0 else slice(half, 2 * half)
        out[part][ends] = line[ends]
    return out


def counted(t: Array, seen: Ticks) -> Array:
    """Time by counting samples, lost ones too, over the same span, s, (N,)."""
    count = np.arange(len(t)) + np.cumsum(seen.missing)
    return np.asarray(t[0] + (t[-1] - t[0]) * count / count[-1])


def false_jitter(log: Log, seen: Ticks) -> bool:
    """Whether the angles are smoother over an even clock than over the stamps; spikes are left out."""
    stamped, even = left_out(log.t, log.q) ** 2, left_out(seen.steady, log.q) ** 2
    for a, b in zip(stamped.T, even.T):
        largest = np.maximum(a, b)
        worse = (a - b)[largest <= np.quantile(largest, TRIM)]
        if worse.mean() > CERTAIN * max(float(np.sqrt(np.mean(worse**2) / len(worse))), 1e-300):
            return True
    return False


def false_drift(log: Log, seen: Ticks) -> bool:
    """Whether the measured rate says that the interval's drift is the stamps' and not the sampling's.

    Stamps that run slow make the angle's derivative large: ``rate / derivative`` follows the intervals with slope one
    where the stamps are false, and does not where they are true. Without a measured rate the stamps are believed.
    """
    if log.v is None:
        return False
    derived = np.gradient(signals.zero_phase(log.q, signals.lowpass(8.0, 1.0 / log.dt)), log.t, axis=0)
    rate = signals.zero_phase(log.v, signals.lowpass(8.0, 1.0 / log.dt))
    scale = [
        np.sum(d * r) / max(np.sum(d * d), 1e-300)
        for d, r in zip(np.array_split(derived, PARTS), np.array_split(rate, PARTS))
    ]
    x = seen.intervals / seen.intervals.mean() - 1.0
    slope, _ = np.polyfit(x, scale, 1)
    rest = np.asarray(scale) - np.polyval(np.polyfit(x, scale, 1), x)
    std = np.sqrt(np.sum(rest**2) / (PARTS - 2) / np.sum(x**2))
    return bool(abs(slope - 1.0) < abs(slope) and slope > CERTAIN * std)


def repeated(log: Log) -> Flags:
    """Rows in which no channel of a moving rig changed since the row before, (N,): a logger faster than its bus."""
    values = np.concatenate([x for x in (log.q, log.v, log.tau) if x is not None], axis=1)
    same = np.append(False, np.all(np.diff(values, axis=0) == 0.0, axis=1))
    # Where the samples around change by several steps of their resolution, a repeated value is no resolution limit.
    travel, ordinary = np.abs(values[4:] - values[:-4]), np.abs(np.diff(values, axis=0))
    step = np.array([x[x > 0].min() if np.any(x > 0) else np.inf for x in ordinary.T])
    moving = np.zeros(len(log), bool)
    moving[2:-2] = np.any(travel > STEPS * step, axis=1)
    return same & moving


def told(severity: tuple[Parameter, ...], serious: bool, cost: Harm | None, mended: Log | None) -> Fault:
    """Return the fault with its figures and what to do."""
    jitter, lost, gap, drift, stale = (parameter.value for parameter in severity)
    parts = [
        text
        for text, there in (
            (f"stamps jitter by {100 * jitter:.0f} % of a period", JITTER < jitter < 1.0),
            (f"samples come at odd times, up to {1000 * gap:.0f} ms apart", jitter >= 1.0),
            (f"{100 * lost:.2g} % of the samples are lost, at most {1000 * gap:.0f} ms in a row", lost > 0),
            (f"the interval drifts by {100 * drift:.2g} %", drift > DRIFT),
            (f"{100 * stale:.0f} % of the rows repeat the row before", stale > 0),
        )
        if there
    ]
    end = "this alone spoils the torque" if serious else "resampling takes care of it"
    figures = severity if cost is None else severity + cost.severity
    mend = "stamp samples where they are taken (drive or bus time), and log at the bus's rate"
    return Fault(Clock.name, None, figures, serious, f"clock: {'; '.join(parts)}; {end}", mend, mended)
