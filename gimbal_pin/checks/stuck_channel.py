"""A channel that repeats its value, or ends at a rail, while the joint goes on moving."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks.harm import build_design
from gimbal_pin.checks.record import Examined, Fault
from gimbal_pin.checks.refusals import find_driven
from gimbal_pin.checks.series import (
    JOINT_CHANNELS,
    WORDS,
    compute_trimmed_rms,
    find_runs,
    find_step,
    get_channels,
)
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import GAP_SAMPLES, Array, Log
from gimbal_pin.regression import (
    Filtering,
    Flags,
    classify_base_motion,
    compute_residuals,
    dilate_flags,
    fit_weighted,
)
from gimbal_pin.rig.rig import Rig

RUN_SAMPLES, RUN_SECONDS = 8, 0.02
"""A run of equal values is long from so many samples, and from so long, on."""
SHORTEST_JUDGED = 1.0
"""A log of fewer seconds is not judged."""
RAIL_SHARE, RAIL_RUN = 0.003, 3.0
"""A rail holds this share of the samples, in runs of so many on average."""
LOUD = 4.0
"""What the other channels deny must be so many times what they differ by elsewhere."""
SHARE = 0.05
"""And this share of the channel's own spread."""
UNSEEN_STEPS = 4.0
"""Steps of its encoder by which an angle must have moved on unseen."""


class HeldRows(NamedTuple):
    """Rows in which one channel of one joint does not change, (N,), and how far the other channels deny it."""

    channel: str
    joint: int
    rows: Flags
    loudness: float


def check_stuck_channel(rig: Rig, log: Log, filtering: Filtering) -> Examined | None:
    """``x_k = x_{k-1}`` over a stretch in which the other channels say that x must change.

    Angle and rate deny each other: over the run, ``q - ∫ v dt`` travels further than over other windows of its length.
    A rate that is held where the angle moves evenly is coarse at most. A torque is denied by the model that the other
    samples give, where that leaves the torque's quantum: a motor that is switched off, or a drive at its limit, holds
    its torque too, and the model agrees; a joint without a motor has a torque of zero all along. Without a rate, an
    angle is stuck if it jumps when it is released.
    """
    if log.t[-1] - log.t[0] < SHORTEST_JUDGED:
        return None
    found = [held for held in find_constant_channels(rig, log, filtering) if held.loudness > LOUD]
    if not found:
        return None
    worst = max(found, key=lambda held: int(held.rows.sum()))
    bad = dilate_flags(np.any([held.rows for held in found], axis=0)[:, None], 2)[:, 0]
    joint = rig.joints[worst.joint]
    what = WORDS[worst.channel]
    share = float(np.mean(worst.rows))
    longest = max(end - begin for begin, end in find_runs(worst.rows)) * log.dt
    figures = (
        Parameter(
            "channel", float(JOINT_CHANNELS.index(worst.channel)), "0 angle, 1 rate, 2 torque"
        ),
        Parameter("longest", longest, "s"),
        Parameter("share", share, "1"),
    )
    column = get_channels(log)[worst.channel][:, worst.joint]
    railed = np.all(np.isin(column[worst.rows], (column.min(), column.max())))
    where = f" ({len(found)} channels in all)" * (len(found) > 1)
    sentence = (
        f"{joint}: the {what} {'ends at a rail' if railed else 'stands still'} for up to {digits(longest, 2)} s "
        f"({digits(100 * share, 2)} % of the log) while the joint moves on{where}"
    )
    mend = f"check the {what} sensor's wiring, range and bus messages, and record again"
    if worst.channel == "tau" and not column.any():
        sentence = f"{joint}: the torque is zero all along while the joint moves{where}"
        mend = "log what its drive reports"
    fault = Fault("stuck-channel", joint, sentence, figures, worst.loudness / LOUD, True, mend)
    return Examined(fault, () if bad.mean() > 0.5 else (log.part(np.flatnonzero(~bad)),))


def find_constant_channels(rig: Rig, log: Log, filtering: Filtering) -> Iterator[HeldRows]:
    """Yield every channel that is constant somewhere, with what the others say to it."""
    for j in range(rig.n):
        constants = {
            name: find_constant_rows(x[:, j], log.dt) for name, x in get_channels(log).items()
        }
        for name in ("q", "v"):
            if log.v is not None and constants[name].any():
                yield HeldRows(name, j, *find_contradicted_runs(log, j, name, constants[name]))
        if log.v is None and constants["q"].any():
            yield HeldRows("q", j, *find_released_runs(log.q[:, j], constants["q"]))
        if "tau" in constants and constants["tau"].any():
            yield HeldRows("tau", j, *find_denied_runs(rig, log, j, constants["tau"], filtering))


def find_constant_rows(column: Array, dt: float) -> Flags:
    """Rows in long runs of one value, or at a rail, (N,)."""
    same = np.append(False, np.diff(column) == 0.0)
    out = np.zeros(len(column), bool)
    for begin, end in find_runs(same):
        if end - begin + 1 >= max(RUN_SAMPLES, RUN_SECONDS / dt):
            out[begin - 1 : end] = True
    written = 1e-7 * float(np.abs(column).max(initial=0.0))  # a file holds some digits of a value
    for rail in (column.min(), column.max()):
        there = np.abs(column - rail) <= written
        if np.mean(there) > RAIL_SHARE and there.sum() > RAIL_RUN * len(find_runs(there)):
            out |= there
    return out


def iterate_runs(column: Array, rows: Flags) -> Iterator[tuple[int, int]]:
    """Yield begin and end of every run of one value among these rows."""
    for begin, end in find_runs(rows):
        cuts = begin + 1 + np.flatnonzero(np.diff(column[begin:end]))
        yield from itertools.pairwise([begin, *cuts.tolist(), end])


def find_contradicted_runs(log: Log, j: int, name: str, rows: Flags) -> tuple[Flags, float]:
    """Return the runs over which ``q - ∫ v dt`` travels too far, (N,), and how far, over its usual travel.

    A rate that is held has missed nothing where its joint turns evenly: one that changes by d over a time T bends the
    angle by ``d T / 8``.
    """
    from scipy.ndimage import median_filter

    assert log.v is not None
    # A lone wild rate is an outlier; it says nothing of where the angle went.
    q = log.q[:, j]
    v = median_filter(log.v[:, j], 3, mode="nearest")
    steps = np.diff(log.t)
    # A hole in the log tells nothing of what the rate was in it.
    whole = steps < GAP_SAMPLES * log.dt
    apart = np.append(
        0.0, np.cumsum(np.where(whole, np.diff(q) - 0.5 * (v[1:] + v[:-1]) * steps, 0.0))
    )
    step = find_step(q)
    spread = SHARE * float(np.std(v)) * log.dt
    quantum = find_step(log.v[:, j])
    out = np.zeros(len(rows), bool)
    loudness = 0.0
    for begin, end in iterate_runs(get_channels(log)[name][:, j], rows):
        if name == "v":
            bend = np.ptp(q[begin:end] - np.linspace(q[begin], q[end - 1], end - begin))
            if bend <= step + quantum * (log.t[end - 1] - log.t[begin]) / 8:
                continue
        travel = float(np.ptp(apart[begin:end]))
        # An angle that came there by a step rests on it until the next.
        least = UNSEEN_STEPS * max(step, abs(float(q[begin] - q[max(begin - 1, 0)])))
        if travel > max(least, spread * (end - begin)):
            usual = compute_usual_travel(apart, ~rows, begin, end)
            if travel > LOUD * usual:
                out[begin:end] = True
                loudness = max(loudness, travel / max(usual, 1e-300))
    return out, loudness


def compute_usual_travel(apart: Array, free: Flags, begin: int, end: int) -> float:
    """Travel over windows as long as this one: the median of 200 of them, or the most of those nearby if that is more.

    In a fifth of such a window at most the channel may be held.
    """
    length = end - begin
    everywhere = range(0, max(len(apart) - length, 1), max(length, len(apart) // 200))
    nearby = (
        begin + k * length
        for k in (-3, -2, -1, 1, 2, 3)
        if 0 <= begin + k * length <= len(apart) - length
    )
    far, near = (
        [float(np.ptp(apart[k : k + length])) for k in starts if free[k : k + length].mean() > 0.8]
        for starts in (everywhere, nearby)
    )
    return max(float(np.median(far)) if far else 0.0, max(near, default=0.0))


def find_released_runs(column: Array, rows: Flags) -> tuple[Flags, float]:
    """Runs that an angle leaves with a jump, (N,), and the largest jump over its ordinary change between samples."""
    changes = np.abs(np.diff(column))
    ordinary = max(float(np.quantile(changes, 0.99)), 1e-300)
    out = np.zeros(len(rows), bool)
    loudness = 0.0
    for begin, end in iterate_runs(column, rows):
        jump, arrival = (changes[k] if 0 <= k < len(changes) else 0.0 for k in (end - 1, begin - 1))
        if jump > max(LOUD * ordinary, LOUD * arrival, SHARE * float(np.std(column))):
            out[begin:end] = True
            loudness = max(loudness, float(jump / ordinary))
    return out, loudness


def find_denied_runs(
    rig: Rig, log: Log, j: int, rows: Flags, filtering: Filtering
) -> tuple[Flags, float]:
    """Return the runs over which a model of the other rows leaves the torque's quantum, (N,), and its residual there.

    The residual is taken over what it should be: the residual elsewhere and the model's own uncertainty there. A motor
    that was off while the pendulum swung, and on only in slow motion, denies nothing; nor does a residual that as many
    rows in sequence have elsewhere, or one that is little.
    """
    assert log.tau is not None
    column = log.tau[:, j]
    nothing = np.zeros(len(rows), bool), 0.0
    base = classify_base_motion(rig, log)
    if rows.all():
        is_moving = np.ptp(log.q[:, j]) > 0
        design = build_design(rig, log, filtering, base)
        is_stuck = is_moving and (column.any() or find_driven(design, list(design))[j])
        return (rows, float("inf")) if is_stuck else nothing
    logs = (log, log.part(np.flatnonzero(~rows)))
    every, fitted = (list(build_design(rig, one, filtering, base)) for one in logs)
    if not fitted or sum(block.b.size for block in fitted) < 3 * fitted[0].A.shape[2]:
        return nothing
    found = fit_weighted(fitted)
    parts = [(b.t, compute_residuals(b, found.theta)[:, j], b.b[:, j], b.A[:, j]) for b in every]
    t, error, torque, A = (np.concatenate(x) for x in zip(*parts))
    held = np.interp(t, log.t, rows.astype(float)) > 0.5
    if not held.any() or held.all() or not np.isfinite(found.covariance).all():
        return nothing
    step = find_step(column)
    unsure = np.einsum("tk,kl,tl->t", A[held], found.covariance, A[held]).mean()
    # A torque in coarse steps rests on one for long, and is off by up to half of it there.
    usual = np.sqrt(compute_trimmed_rms(error[~held]) ** 2 + unsure + (step / 2) ** 2)
    model = np.interp(log.t, t, torque - error)
    denied = np.zeros(len(rows), bool)
    for begin, end in iterate_runs(column, rows):
        denied[begin:end] = np.ptp(model[begin:end]) > step + LOUD * usual
    inside = error[np.interp(t, log.t, denied.astype(float)) > 0.5]
    size = np.sqrt(np.mean(inside**2)) if len(inside) else 0.0
    elsewhere = error[~held]
    length = min(len(inside), len(elsewhere))
    if size <= SHARE * np.std(torque) or size <= compute_largest_rms(elsewhere, length):
        return nothing
    return denied, float(size / max(usual, 1e-300))


def compute_largest_rms(values: Array, length: int) -> float:
    """Return the largest root mean square of `length` values in sequence."""
    total = np.cumsum(np.append(0.0, values**2))
    return float(np.sqrt(np.max(total[length:] - total[:-length]) / length))
