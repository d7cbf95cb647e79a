"""A rate that is the angle's derivative behind a low-pass, or late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks.harm import spoils_torque
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering, split_segments
from gimbal_pin.rig.rig import Rig

CORNERS = np.geomspace(0.5, 100.0, 41)
"""Corner frequencies that are tried, Hz."""
FLAT = 0.15
"""A corner above this share of the sampling rate is no filter."""
LOWPASS_IMPROVEMENT = 0.5
"""A low-pass must leave less than this share of the power that the best pure delay leaves, and
a delay of what the derivative itself leaves."""
OVER_NOISE = 10.0
"""And differ from it by so many times the power of the angle's noise."""
VISIBLE = 0.005
"""And change the rate by more than this share of its rms."""
SHORTEST_STRETCH = 3.0
"""Length of an uninterrupted stretch that is worth comparing, s."""


class LowPass(NamedTuple):
    """A filter of the rate: corner, Hz, and order."""

    corner: float
    order: int


class Lag(NamedTuple):
    """What makes one joint's rate of its angle: a low-pass, or a delay, s; and its change of the rate's rms."""

    cause: LowPass | float
    change: float


def check_filtered_velocity(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``v = H(s) dq/dt`` with H a low-pass of first or second order, or a delay.

    Slow motion fits a low-pass better than any pure delay, which keeps the shape of the rate. A low-pass does not harm
    a fit that differentiates the angle: the mended log has no rate. Of a rate that is late by more than a sample, which
    differences are anyway, the mended log has it in time.
    """
    if log.v is None:
        return None
    found = {j: lag for j in range(rig.n) if (lag := find_lag(log, j, filtering)) is not None}
    if not found:
        return None
    worst = max(found, key=lambda j: found[j].change)
    delays = {j: lag.cause for j, lag in found.items() if not isinstance(lag.cause, LowPass)}
    if len(delays) == len(found):
        mended = advance_rates(log, delays)
    else:
        worst = max(found.keys() - delays.keys(), key=lambda j: found[j].change)
        mended = replace(log, v=None)
    unreliable = spoils_torque(rig, log, mended, filtering)
    joint = rig.joints[worst]
    (cause, change) = found[worst]
    if isinstance(cause, LowPass):
        figures = [
            Parameter("corner", cause.corner, "Hz"),
            Parameter("order", float(cause.order), "1"),
        ]
        what = f"is the angle behind a low-pass of {digits(cause.corner, 2)} Hz"
        mend = "leave the rate out: the angle's own derivative is better; or switch the drive's velocity filter off"
    else:
        figures = [Parameter("delay", cause, "s")]
        what = f"is {digits(1e3 * cause, 2)} ms later than the angle"
        mend = "leave the rate out, or log rates with the time that they are of: drives average over the time before"
    others = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    harm = "it spoils the torque" if unreliable else "it does little harm here"
    sentence = (
        f"{joint}{others}: the rate {what}, which changes it by {digits(100 * change, 2)} %; {harm}"
    )
    every = (*figures, Parameter("rate_changed", change, "1"))
    return Examined(
        Fault("filtered-velocity", joint, sentence, every, change / VISIBLE, unreliable, mend),
        (mended,),
    )


def advance_rates(log: Log, delays: Mapping[int, float]) -> Log:
    """Return a log with the rates of these joints earlier by their delays, s, as far as it then goes."""
    assert log.v is not None
    v = log.v.copy()
    for j, delay in delays.items():
        v[:, j] = signals.resample(log.t - delay, v[:, j : j + 1], log.t)[:, 0]
    last = int(np.searchsorted(log.t, log.t[-1] - max(delays.values()), side="right"))
    return replace(log, v=v).part(slice(0, last))


def find_lag(log: Log, j: int, filtering: Filtering) -> Lag | None:
    """Return the lag in one joint's rate, or None where there is none, or none that one could see."""
    assert log.v is not None
    longest = max(split_segments(log, 1.0), key=lambda stretch: stretch.length, default=None)
    if (
        longest is None
        or longest.length * longest.dt < SHORTEST_STRETCH
        or np.ptp(log.q[:, j]) == 0.0
    ):
        return None
    dt = longest.dt
    rows = longest.rows
    grid = longest.start + dt * np.arange(longest.length)
    t = longest.log.t[rows]
    q = longest.log.q[rows, j]
    v = np.asarray(longest.log.v)[rows, j]
    qv = signals.resample(t, np.stack([q, v], axis=1), grid)
    sections = signals.lowpass(filtering.cutoff, 1.0 / dt)
    slow = signals.zero_phase(qv, sections)
    edge = min(round(signals.compute_lowpass_settling(filtering.cutoff) / dt), len(qv) // 4)
    derived = signals.differentiate(slow[:, :1], dt)[edge:-edge, 0]
    rate = slow[edge:-edge, 1]
    change = float(
        np.sqrt(np.mean((rate - derived) ** 2) / np.maximum(np.mean(derived**2), 1e-300))
    )
    if change < VISIBLE:
        return None
    noise = float(signals.noise_std(qv)[0]) * signals.compute_noise_gain(sections, 1.0 / dt, 1)
    cause = find_low_pass_or_delay(derived, rate, dt, noise, filtering.cutoff)
    return Lag(cause, change) if cause is not None else None


def find_low_pass_or_delay(
    derived: Array, rate: Array, dt: float, noise: float, cutoff: float
) -> LowPass | float | None:
    """Return the low-pass that fits slow motion better than any delay, or else the delay, s, that fits; or None.

    Args:
        derived: The angle's derivative after the default filter, (m,).
        rate: The rate after the same filter, (m,).
        dt: Interval, s.
        noise: Standard deviation of the derivative's noise.
        cutoff: Of that filter, Hz.
    """
    step = max(1, int(0.05 / (cutoff * dt)))
    d = derived[::step]
    r = rate[::step]
    sample = dt
    dt = dt * step
    times = dt * np.arange(len(d))
    settled = slice(round(1.0 / (CORNERS[0] * dt)) // 2, None)
    if d[settled] @ d[settled] == 0.0:  # a joint at rest shows no lag
        return None
    shifts = 1.0 / (2.0 * np.pi * CORNERS)
    tried = [
        fit_shape(signals.resample(times, d[:, None], times - shift)[:, 0], r, dt, settled)
        for shift in shifts
    ]
    best = min(range(len(tried)), key=lambda k: tried[k].left)
    delayed = tried[best]
    delay = float(shifts[best]) + tried[best].delay
    # |lagged - delayed| is at most the sum of what the two leave: where that cannot be visible, no lag need be tried.
    if delayed.left * (1.0 + np.sqrt(LOWPASS_IMPROVEMENT)) ** 2 > OVER_NOISE * noise**2:
        shapes = [LowPass(float(f), order) for order in (1, 2) for f in CORNERS]
        lags = {
            shape: fit_shape(apply_low_pass(d, shape.corner, shape.order, dt), r, dt, settled)
            for shape in shapes
        }
        low_pass = min(lags, key=lambda shape: lags[shape].left)
        lag = lags[low_pass]
        visible = float(np.mean((lag.fit - delayed.fit) ** 2)) > OVER_NOISE * noise**2
        if (
            visible
            and lag.left < LOWPASS_IMPROVEMENT * delayed.left
            and low_pass.corner < FLAT / sample
        ):
            return low_pass
    gain = float(d[settled] @ r[settled] / (d[settled] @ d[settled]))
    moved = float(np.mean((delayed.fit - gain * d[settled]) ** 2))
    undelayed = float(np.mean((r[settled] - gain * d[settled]) ** 2))
    is_late = (
        delay > sample
        and moved > OVER_NOISE * noise**2
        and delayed.left < LOWPASS_IMPROVEMENT * undelayed
    )
    return delay if is_late else None


def apply_low_pass(signal: Array, corner: float, order: int, dt: float) -> Array:
    """Return a signal, (m,), after a causal Butterworth low-pass of `corner` Hz that starts at rest."""
    from scipy.signal import butter, sosfilt

    sections = butter(order, min(corner * dt, 0.45), fs=1.0, output="sos")
    return np.asarray(sosfilt(sections, signal - signal[0]) + signal[0])


class Remainder(NamedTuple):
    """What a shape of the rate leaves, (rad/s)²; what is fitted, rad/s, (m,); and its delay, s."""

    left: float
    fit: Array
    delay: float


def fit_shape(shaped: Array, rate: Array, dt: float, settled: slice) -> Remainder:
    """``mean (rate - g (x - d dx/dt))²`` over a gain g and a small delay d."""
    columns = np.stack([shaped, signals.differentiate(shaped[:, None], dt)[:, 0]], axis=1)[settled]
    gain, slope = np.linalg.lstsq(columns, rate[settled], rcond=None)[0].tolist()
    fit = columns @ np.array([gain, slope])
    return Remainder(
        float(np.mean((rate[settled] - fit) ** 2)), fit, -slope / gain if gain else 0.0
    )
