"""Does the torque belong to the motion beside it? A column that is far too late gives friction, springs and limits.

``min_θ ‖b_j(t - a) - A_j θ‖²`` over shifts a of a joint's torque, on the rows of the log: A is computed once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import orth

from gimbal_pin.checks.harm import build_design
from gimbal_pin.checks.record import Fault
from gimbal_pin.effects.delay import LONGEST_DRIVE_DELAY
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import LogError, digits
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    LARGEST_LAG,
    Block,
    Design,
    Filtering,
    Flags,
    compute_settling_time,
    count_effective_rows,
    find_moving_base,
    smooth_samples,
    split_segments,
    subsample_log,
)
from gimbal_pin.rig.rig import Rig

LARGEST_SHIFT = 5e-3
"""Shift that is the log's, s: angles and currents of one sample are as far apart on a bus of 200 Hz. A torque that acts
later is a drive's."""
LARGEST_TIME_SHIFT, TIME_SHIFT_STEP = 0.25, 0.01
"""Shifts that are tried, to either side, s, and from one to the next: at 4 Hz that is a quarter of a radian."""
CLEARER = 0.25
"""Share of the squared error within the bounds that the best shift may leave.

Of 23 measured logs of eight devices a shift beyond the bounds leaves less than half of it at one joint: a third, of a
pendulum that swings for some seconds.
"""
AS_LIKELY = 1.5
"""Shifts whose squared error is within this factor of the least are as likely: of a motion of one tone they are half a
period apart, and the smallest is taken."""
SHIFT_BLOCKS, AGREEING_BLOCKS = 20, 16
"""Stretches of time, and how many must each be explained better: by chance one in 170 logs has so many."""
ROWS = 3
"""Least number of rows per parameter."""
SHIFT_TIME = 60.0
"""Time of each log that is looked at, s."""


class Shift(NamedTuple):
    """When a joint's torque acts, where that is clearly not at its stamp.

    Attributes:
        joint: The joint.
        by: How much later than its stamp, s.
        left: What of the torque's square is left there, as a share.
        within: The same at the best of the shifts that it is compared with.
        beyond: Whether these are all that a drive and its report allow; else those that are the log's, `LARGEST_SHIFT`.
    """

    joint: str
    by: float
    left: float
    within: float
    beyond: bool


def check_time(rig: Rig, logs: Sequence[Log], filtering: Filtering) -> tuple[str, ...]:
    """Raise `LogError` if a torque acts too early or late to be this motion's; say where it is noticeably so."""
    return tuple(
        said
        for log in logs
        for said in report_shifts(log, find_shifted_torques(rig, log, filtering))
    )


def report_shifts(log: Log, found: Sequence[Shift]) -> tuple[str, ...]:
    """Raise `LogError` if a torque acts beyond the bounds; say by how much where it is within them."""
    if beyond := [one for one in found if one.beyond]:
        raise LogError(log.name, *describe_shifts(log, beyond))
    return (f"{log.name}: {'; '.join(describe_shifts(log, found))}",) if found else ()


def find_time_fault(log: Log, found: Sequence[Shift]) -> Fault | None:
    """Return the fault of a log with a torque beyond the bounds, or None."""
    if not (beyond := [one for one in found if one.beyond]):
        return None
    worst = find_clearest(beyond)
    (said, mend) = describe_shifts(log, beyond)
    figures = (Parameter("late", -worst.by, "s"), Parameter("left", worst.left / worst.within, "1"))
    sentence = f"{log.name}: {said}; no physics is looked for in it"
    return Fault("clock", worst.joint, sentence, figures, abs(worst.by / LARGEST_LAG), True, mend)


def find_clearest(found: Sequence[Shift]) -> Shift:
    """Return the shift that explains most."""
    return min(found, key=lambda one: one.left / one.within)


def describe_shifts(log: Log, found: Sequence[Shift]) -> tuple[str, str]:
    """Say by how much which torques are late or early, and what mends that: all joints have one alignment."""
    worst = find_clearest(found)
    columns = ", ".join(f"tau_{one.joint}" for one in found)
    size = digits(1e3 * abs(worst.by), 3)
    when = "late" if worst.by < 0 else "early"
    left, within = (digits(100 * float(np.sqrt(share)), 2) for share in (worst.left, worst.within))
    gain = f"the model misses {left} % of the torque then instead of {within} %"
    by = digits(worst.by, 3)
    every = len(found) == len(log.joints)
    mend = f"say so with --alignment {by}" if every else f"shift it in time by {by} s"
    return f"{columns} {'is' if len(found) == 1 else 'are'} {size} ms {when}: {gain}", mend


def find_shifted_torques(rig: Rig, log: Log, filtering: Filtering) -> tuple[Shift, ...]:
    """Return the joints whose torque acts noticeably early or late, as far as the log clearly says so.

    A log that fits as well within the bounds says nothing of the time: a slow one, or a motion of one tone. Where the
    alignment is given, it is known.
    """
    if log.tau is None or filtering.alignment is not None:
        return ()
    slow = Filtering(cutoff=min(filtering.cutoff, Filtering().cutoff))
    shifts = np.arange(
        -LARGEST_TIME_SHIFT, LARGEST_TIME_SHIFT + TIME_SHIFT_STEP / 2, TIME_SHIFT_STEP
    )
    rows, shifted, added = build_shifted_rows(
        build_design(rig, subsample_log(log, SHIFT_TIME).log, slow), shifts
    )
    if not rows:
        return ()
    torque = np.concatenate(shifted)
    columns = np.concatenate([np.concatenate([x.A, y], axis=2) for x, y in zip(rows, added)])
    used = count_effective_rows(rows)
    late = shifts + log.dt / 2
    found = []
    for j, joint in enumerate(rig.joints):
        A = columns[:, j, columns[:, j].any(axis=0)]
        if A.shape[1] == 0 or used[j] <= ROWS * A.shape[1]:
            continue
        left = compute_errors(A, torque[:, j])
        total = left.sum(axis=0)
        sharp = np.ptp(shifts[total <= AS_LIKELY * total.min()]) < 3 * TIME_SHIFT_STEP
        for beyond, lower in ((True, -LARGEST_LAG), (False, -LARGEST_SHIFT)):
            inside = (late >= lower) & (late <= LONGEST_DRIVE_DELAY)
            k = find_best_outside(left, inside)
            if k is not None and (beyond or (sharp and -LARGEST_LAG <= late[k] < 0)):
                by = float(late[k] + TIME_SHIFT_STEP * find_vertex(total, k))
                within = float(total[inside].min())
                found.append(Shift(joint, by, float(total[k]), within, beyond))
                break
    return tuple(found)


def build_shifted_rows(
    design: Design, shifts: Array
) -> tuple[list[Block], list[Array], list[Array]]:
    """Return the rows of each segment, their torques at some shifts, s, (m, n, s), and further columns, (m, n, 2).

    A torque that acts later is the same torque, read earlier under the same mask: the columns are computed once. The
    further columns are an inertia and an offset of each joint: a rotor that the URDF does not state looks like a shift.
    """
    rows = list[Block]()
    torques = list[Array]()
    added = list[Array]()
    filtering = design.filtering
    for log in design.logs:
        carrier = find_moving_base(design.rig, log)
        for segment in split_segments(log, filtering.cutoff):
            dt = segment.dt
            pad = int(np.ceil((compute_settling_time(filtering) + LARGEST_TIME_SHIFT) / dt))
            step = max(1, int(1 / (2 * filtering.cutoff * dt)))
            keep = slice(pad, segment.length - pad, step)
            if keep.start >= keep.stop:
                continue
            samples = smooth_samples(segment, filtering, 0, segment.length, carrier)
            way = design.build_row_filter(samples, keep, 1 / dt)
            block = design.build_block(samples, keep, 1 / dt)
            few = samples.t[way.few]
            tau = samples.tau
            each = [
                np.stack([np.interp(few - by, samples.t, x) for x in tau.T], axis=1)
                for by in shifts
            ]
            rows.append(block)
            torques.append(np.stack([way.filter_torque(one) - block.known for one in each], axis=2))
            rotor = samples.a[way.few]
            laws = [way.filter_torque(x) for x in (rotor, np.ones_like(rotor))]
            added.append(np.stack(laws, axis=2))
    return rows, torques, added


def compute_errors(A: Array, b: Array) -> Array:
    """Return the share of torques' squares, (m, s), that columns, (m, k), leave in each block, (blocks, s)."""
    left = orth(A / np.linalg.norm(A, axis=0), rcond=1e-9)
    squares = (b - left @ (left.T @ b)) ** 2 / np.maximum(np.sum(b**2, axis=0), 1e-300)
    return np.stack([part.sum(axis=0) for part in np.array_split(squares, SHIFT_BLOCKS)])


def find_best_outside(left: Array, inside: Flags) -> int | None:
    """Return the number of the shift outside the bounds that clearly leaves less than any within, or None.

    Args:
        left: What each block is left, (blocks, s).
        inside: Which shifts are within the bounds, (s,).
    """
    total = left.sum(axis=0)
    least = 1 + np.flatnonzero((total[1:-1] <= total[2:]) & (total[1:-1] <= total[:-2]))
    least = least[total[least] <= AS_LIKELY * total.min()]
    if not len(least):
        return None
    k = int(min(least, key=lambda i: abs(i - len(total) // 2)))
    within = int(np.argmin(np.where(inside, total, np.inf)))
    better = int(np.sum(left[:, k] < left[:, within]))
    return (
        k
        if not inside[k] and total[k] < CLEARER * total[within] and better >= AGREEING_BLOCKS
        else None
    )


def find_vertex(y: Array, k: int) -> float:
    """Return how far beyond place k a parabola through it and its neighbours is least, in places."""
    bend = float(y[k - 1] - 2 * y[k] + y[k + 1])
    return float(y[k - 1] - y[k + 1]) / (2 * bend) if bend > 0 else 0.0
