"""A rate that is the angle's derivative behind a low-pass: a lag, not a delay."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.estimation.audit.base import Examined, Fault, noted
from gimbal_pin.estimation.audit.probe import spoils_torque
from gimbal_pin.estimation.rows import Filtering, stretches
from gimbal_pin.log import signals
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig

NAME = "filtered-velocity"
CORNERS = np.geomspace(0.5, 100.0, 41)
"""Corner frequencies that are tried, Hz."""
EXACT = 0.05
"""A recursion with the angle's increments leaves less than this share of what the rate's past alone leaves."""
PARTS, LEAST = 40, 60
"""Parts of a log in which a recursion is looked for, and their least length in samples."""
FLAT = 0.15
"""A corner above this share of the sampling rate is no filter."""
BETTER = 0.5
"""Where no recursion fits, a lag must leave less than this share of the power that the best pure delay leaves."""
SURE = 10.0
"""And differ from it by so many times the power of the angle's noise."""
VISIBLE = 0.005
"""And change the rate by more than this share of its rms."""
SHORTEST = 3.0
"""Length of an uninterrupted stretch that is worth comparing, s."""
PASSES, TRIM = 3, 4.0
"""Fits of the recursion, each without the samples beyond so many deviations of the last."""


class Lag(NamedTuple):
    """The low-pass that makes one joint's rate of its angle: corner, Hz, order, and its change of the rate's rms."""

    corner: float
    order: int
    change: float


def examine(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``v = H(s) dq/dt`` with H a low-pass of first or second order.

    Two tests. A drive that filters the counts that it logs leaves an exact recursion,
    ``v_k = a₁ v_{k-1} + a₂ v_{k-2} + Σ b_l (q_{k-l} - q_{k-l-1})``, encoder noise and all; a gyro has noise of its
    own. A drive that filters counts of its own leaves a lag: slow motion fits a low-pass better than any pure delay,
    which keeps the shape of the rate. Neither harms a fit that differentiates the angle: the mended log has no rate.
    """
    if log.v is None or len(log) < 2 * LEAST:
        return None
    found = {j: lag for j in range(rig.n) if (lag := lag_of(log, j, filtering)) is not None}
    if not found:
        return None
    worst = max(found, key=lambda j: found[j].change)
    mended = noted(replace(log, v=None), "the filtered rate was left out")
    unreliable = spoils_torque(rig, log, mended, filtering)
    return Examined(fault_of(rig.joints[worst], found[worst], len(found), unreliable), mended)


def corrupt(log: Log, rng: np.random.Generator, *, corner: float = 8.0, order: int = 1) -> Log:
    """Replace the rate by the angle's differences behind a causal Butterworth low-pass."""
    raw = np.diff(log.q, axis=0, prepend=log.q[:1]) / log.dt
    return replace(log, v=lowpassed(raw, min(corner, 0.45 / log.dt), order, log.dt))


def lag_of(log: Log, j: int, filtering: Filtering) -> Lag | None:
    """Return the low-pass in one joint's rate, or None where there is none, or none that one could see."""
    assert log.v is not None
    longest = max(stretches(log, 1.0), key=lambda stretch: stretch.length, default=None)
    if longest is None or longest.length * longest.dt < SHORTEST or np.ptp(log.q[:, j]) == 0.0:
        return None
    dt, rows = longest.dt, longest.rows
    grid = longest.start + dt * np.arange(longest.length)
    t, q, v = longest.log.t[rows], longest.log.q[rows, j], np.asarray(longest.log.v)[rows, j]
    qv = signals.resample(t, np.stack([q, v], axis=1), grid)
    sections = signals.lowpass(filtering.cutoff, 1.0 / dt)
    slow = signals.zero_phase(qv, sections)
    edge = min(round(signals.settling(filtering.cutoff) / dt), len(qv) // 4)
    derived, rate = signals.differentiate(slow[:, :1], dt)[edge:-edge, 0], slow[edge:-edge, 1]
    change = float(np.sqrt(np.mean((rate - derived) ** 2) / np.maximum(np.mean(derived**2), 1e-300)))
    if change < VISIBLE:
        return None
    noise = float(signals.noise_std(qv)[0]) * signals.noise_gain(sections, 1.0 / dt, 1)
    lag = recursions(log.q[:, j], log.v[:, j], dt) or lagging(derived, rate, dt, noise, filtering.cutoff)
    return Lag(*lag, change) if lag is not None else None


def recursions(q: Array, v: Array, dt: float) -> tuple[float, int] | None:
    """Return corner and order of the filter that makes the rate in any part of a log, or None."""
    count = max(1, min(PARTS, len(q) // LEAST))
    parts = zip(np.array_split(q, count), np.array_split(v, count))
    found = [low_pass for part in parts if (low_pass := recursion(*part, dt)) is not None]
    return sorted(found)[len(found) // 2] if found else None


def recursion(q: Array, v: Array, dt: float) -> tuple[float, int] | None:
    """Return corner and order of a filter that gives the rate exactly from the angle's increments, or None."""
    past = np.stack([v[2:-1], v[1:-2]], axis=1)
    increments = np.stack([np.diff(q)[k : len(q) - 3 + k] for k in (2, 1, 0)], axis=1)
    target = v[3:]
    _, alone = trimmed(past, target)
    for order in (1, 2):
        coefficients, left = trimmed(np.concatenate([past[:, :order], increments[:, : order + 1]], axis=1), target)
        if left < EXACT * alone:
            poles = np.roots(np.append(1.0, -coefficients[:order]))
            poles = poles[np.abs(poles) > 1e-6]
            corner = float(np.abs(np.log(poles.astype(complex))).min() / (2.0 * np.pi * dt)) if len(poles) else np.inf
            return (corner, order) if corner < FLAT / dt else None
    return None


def trimmed(columns: Array, target: Array) -> tuple[Array, float]:
    """Least squares without what the last fit left furthest off; coefficients, and the deviation of the rest."""
    kept = np.ones(len(target), bool)
    for _ in range(PASSES):
        coefficients = np.linalg.lstsq(columns[kept], target[kept], rcond=1e-12)[0]
        error = np.abs(target - columns @ coefficients)
        size = float(np.median(error)) / 0.6745
        kept = error <= TRIM * size + 1e-300
    return coefficients, size


def lagging(derived: Array, rate: Array, dt: float, noise: float, cutoff: float) -> tuple[float, int] | None:
    """Return corner and order of the low-pass that fits slow motion better than any delay, or None.

    Args:
        derived: The angle's derivative after the default filter, (m,).
        rate: The rate after the same filter, (m,).
        dt: Interval, s.
        noise: Standard deviation of the derivative's noise.
        cutoff: Of that filter, Hz.
    """
    step = max(1, int(0.05 / (cutoff * dt)))
    d, r, dt = derived[::step], rate[::step], dt * step
    times = dt * np.arange(len(d))
    settled = slice(round(1.0 / (CORNERS[0] * dt)) // 2, None)
    delays = (signals.resample(times, d[:, None], times - 1.0 / (2.0 * np.pi * f))[:, 0] for f in CORNERS)
    apart, delayed = min((remainder(x, r, dt, settled) for x in delays), key=lambda pair: pair[0])
    # |lagged - delayed| is at most the sum of what the two leave: where that cannot be visible, no lag need be tried.
    if apart * (1.0 + np.sqrt(BETTER)) ** 2 <= SURE * noise**2:
        return None
    shapes = [(order, float(f)) for order in (1, 2) for f in CORNERS]
    lags = [(order, f, remainder(lowpassed(d, f, order, dt), r, dt, settled)) for order, f in shapes]
    order, corner, (left, lagged) = min(lags, key=lambda each: each[2][0])
    visible = float(np.mean((lagged - delayed) ** 2)) > SURE * noise**2
    return (corner, order) if visible and left < BETTER * apart and corner < FLAT / dt else None


def lowpassed(signal: Array, corner: float, order: int, dt: float) -> Array:
    """A causal Butterworth low-pass along the first axis, at rest at its first value."""
    from scipy.signal import sosfilt

    return np.asarray(sosfilt(butterworth(order, min(corner * dt, 0.45)), signal - signal[0], axis=0) + signal[0])


@cache
def butterworth(order: int, corner: float) -> Array:
    """Second-order sections of the low-pass, corner in shares of the sampling rate; every joint tries the same ones."""
    from scipy.signal import butter

    return np.asarray(butter(order, corner, fs=1.0, output="sos"))


def remainder(shaped: Array, rate: Array, dt: float, settled: slice) -> tuple[float, Array]:
    """``mean (rate - g x - d dx/dt)²`` over a gain g and a small delay d, and what is fitted."""
    columns = np.stack([shaped, signals.differentiate(shaped[:, None], dt)[:, 0]], axis=1)[settled]
    fit = columns @ np.linalg.lstsq(columns, rate[settled], rcond=None)[0]
    return float(np.mean((rate[settled] - fit) ** 2)), fit


def fault_of(joint: str, lag: Lag, count: int, unreliable: bool) -> Fault:
    """Return the fault, described."""
    figures = (
        Parameter("corner", lag.corner, "Hz"),
        Parameter("order", float(lag.order), "1"),
        Parameter("rate_changed", lag.change, "1"),
    )
    joints = f" (and {count - 1} more)" if count > 1 else ""
    sentence = (
        f"{joint}{joints}: the rate is the angle behind a low-pass of {digits(lag.corner, 2)} Hz, which changes it by "
        f"{digits(100 * lag.change, 2)} %; {'it spoils the torque' if unreliable else 'it does little harm here'}"
    )
    mend = "leave the rate out: the angle's own derivative is better; or switch the drive's velocity filter off"
    return Fault(NAME, joint, sentence, figures, lag.change / VISIBLE, unreliable, mend)
