"""Angles of encoders that start over after a turn, and angles beyond a rig's stops."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from gimbal_pin.errors import LogError, digits
from gimbal_pin.log.log import Array
from gimbal_pin.log.mapping import Source
from gimbal_pin.rig.rig import Rig

USUAL_SHARE = 0.99
"""Share of the samples that states where a joint is and how fast: spikes and wraps are rarer."""
RATE_MARGIN = 2.0
"""Largest rate across a wrap, in multiples of the usual rates; 4 would take glitches of 4 usual steps for motion."""
STOP_MARGIN = 0.01
"""Share of the travel between stops by which angles may exceed them: rounding of the limits, not another zero."""
LEAST_SAMPLES = 50
"""Fewer samples are not judged."""
PERIODS = (*(2.0**bits for bits in range(24, 8, -1)), 360.0, 256.0, 2 * pi)
"""Readings at which encoders start over: counts, degrees, rad; the largest that fits is the encoder's."""
OFFSETS = {
    "- pi": pi, "+ pi": -pi, "- 2*pi": 2 * pi, "+ 2*pi": -2 * pi, "- pi/2": pi / 2, "+ pi/2": -pi / 2,
}  # fmt: skip
"""Offsets of encoders that are tried where a joint exceeds its stops, rad: what a mapping adds → the encoder's zero."""


def find_wraps(t: Array, q: Array, period: float) -> Array:
    """Return how many periods the readings gain at each step without the joint, (N - 1,), mostly zero.

    A step is a wrap where it is nearer to a multiple of the period than to zero and the rest of it is a motion like
    that at other steps. Nothing is found where a joint at its usual rates moves a quarter of a period between samples.

    Args:
        t: Times, s, (N,).
        q: Readings, (N,).
        period: Reading at which the encoder starts over.
    """
    steps = np.diff(q)
    times = np.diff(t)
    turns = np.round(steps / period)
    reach = (
        RATE_MARGIN * times * np.quantile(np.abs(steps / times), USUAL_SHARE * np.mean(turns == 0))
    )
    is_motion = np.abs(steps - period * turns) <= reach + 1e-9 * period
    return np.where(is_motion & (reach < RATE_MARGIN * period / 4), turns, 0.0)


def unwrap_angles(
    name: str, rig: Rig, t: Array, q: Array, q_ref: Array | None, sources: Mapping[str, Source]
) -> tuple[Array, Array | None, list[str]]:
    """Return angles and references without the jumps of encoders that start over, rad, (N, n), and notes.

    A joint with stops is moved by whole turns to the middle between them; references follow their angles.

    Raises:
        LogError: A joint's readings start over at 360 or a power of two: they are degrees or counts.
    """
    notes = []
    for j, joint in enumerate(rig.joints):
        if rig.slides[j] or len(t) < LEAST_SAMPLES or np.abs(np.diff(q[:, j])).max() < pi:
            continue
        period, turns = next(
            ((p, x) for p in PERIODS if np.any(x := find_wraps(t, q[:, j], p))), (0.0, None)
        )
        if turns is None:
            continue
        column = f"q_{joint}"
        count = int(np.count_nonzero(turns))
        if period > 2 * pi:
            entry = f"{column}={sources.get(column, Source(column)).times(f'2*pi/{period:g}')}"
            raise LogError(
                f"{name}: {column}",
                f"starts over at {period:g}, not at 2 pi",
                f"map it: --map '{entry}'",
            )
        x = q[:, j] - np.append(0.0, period * np.cumsum(turns))
        if np.isfinite(ends := [float(stop[j]) for stop in rig.stops]).all():
            x -= period * np.round((np.median(x) - sum(ends) / 2) / period)
        q = np.column_stack([*q.T[:j], x, *q.T[j + 1 :]])
        if q_ref is not None:
            follows = q_ref[:, j] - period * np.round((q_ref[:, j] - x) / period)
            q_ref = np.column_stack([*q_ref.T[:j], follows, *q_ref.T[j + 1 :]])
        notes.append(f"{name}: {column} starts over {count} times after a turn: unwrapped")
    return q, q_ref, notes


def check_within_stops(name: str, rig: Rig, q: Array, sources: Mapping[str, Source]) -> list[str]:
    """Return a note on each joint that exceeds its stops, with the zeros of its encoder that would keep it between.

    Of a motion from a to b between stops from l to u these are ``b - u ≤ zero ≤ a - l``. Where a usual offset is among
    them, its mapping is given; where none is, the log does not tell the zero.

    Raises:
        LogError: A joint is beyond its stops all along, though it has room for all of its motion between them.
    """
    notes = []
    ends = np.quantile(q, [1 - USUAL_SHARE, USUAL_SHARE], axis=0).tolist()
    for joint, low, high, lower, upper in zip(rig.joints, *ends, *rig.stops):
        slack = STOP_MARGIN * (upper - lower)
        if (
            len(q) < LEAST_SAMPLES
            or not slack > 0
            or (low >= lower - slack and high <= upper + slack)
        ):
            continue
        source = sources.get(f"q_{joint}", Source(f"q_{joint}"))
        least = high - upper
        most = low - lower
        fits = [text for text, zero in OFFSETS.items() if least <= zero <= most]
        what = f"lies at {digits(low, 3)} to {digits(high, 3)} rad, and its limits are {lower:.3g} and {upper:.3g} rad"
        stated = rig.motors[rig.joint_index(joint)].encoder_zero
        mend = "correct the limits"
        if fits:
            zero = digits(stated + OFFSETS[fits[0]], 5)
            mend = f"--map 'q_{joint}={source.times(1.0)} {fits[0]}', or state encoder_zero: {zero} of this motor in"
            mend = f"{mend} the rig's YAML, or correct the limits"
        elif least <= most:
            span = f"{digits(stated + least, 4)} to {digits(stated + most, 4)} rad"
            mend = f"the log does not tell the encoder's zero, which may be {span}: measure it at a known pose"
            mend = f"{mend}, and state it as encoder_zero of this motor in the rig's YAML, or correct the limits"
        if (low > upper or high < lower) and least <= most:
            raise LogError(
                f"{name}: q_{joint}", rig.in_units(joint, what), rig.in_units(joint, mend)
            )
        notes.append(rig.in_units(joint, f"{name}: q_{joint} {what}; {mend}"))
    return notes
