"""Which frequencies and which time are looked at.

The band is 12 Hz, or less where the log's sampling rate cannot carry that, or as wide as the lines of a turning joint's
torque ask for. Of one log alternate blocks are fitted
to and reported on: they show all of its angles, where a last third may show some that nothing before has seen. Between
two blocks of different use half of what a row depends on is left out on either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import welch

from gimbal_pin.diagnosis.evidence import TAPER, Evidence, LogStretch
from gimbal_pin.log.limited import MOSTLY, compute_share_near_limit
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    Filtering,
    Flags,
    build_mask,
    compute_settling_time,
    dilate_flags,
    limit_cutoff,
)
from gimbal_pin.rig.rig import Rig

DIAGNOSIS_BAND = Filtering(cutoff=12.0, smoothing=2.5)
"""Wider than identification's filter: drives and teeth show above 5 Hz, and whitening makes up for the noise there."""
WIDEST_BAND = 0.1
"""Widest band that is chosen, as a share of the sampling rate: the smoother's corner is at a quarter of it then."""
SPECTRUM_SEGMENT, AROUND = 8.0, 33
"""Length of the spectrum's segments, s, and frequencies around each that its median is of."""
LINE_POWER = 20.0
"""Power over that median from which it is a line: one of noise is under 2^-20 likely to be."""
MOST_BLOCKS = 15
"""Blocks of a log, unless they would be shorter than `SHORTEST_BLOCK`."""
SHORTEST_BLOCK = 2.5
"""Shortest block, s: ten times the correlation of a noise with a corner of 0.6 Hz, which drives' currents may have."""
FEWEST_BLOCKS = 3
"""Fewest blocks: every third, the middle one first, is reported on."""


def limit_band(logs: Sequence[Log]) -> Filtering:
    """Return `DIAGNOSIS_BAND`, or as much of it as the sampling rates of some logs carry."""
    return limit_cutoff(DIAGNOSIS_BAND, logs, WIDEST_BAND)


def choose_band(rig: Rig, logs: Sequence[Log]) -> Filtering:
    """Return the filter for logs where none is asked for.

    Doubled while some joint has more power in lines beyond the band than it has in the band: its teeth pass by at k
    times its rate, 72 of them at 52 Hz where it turns 0.7 times a second. A joint that swings between its drive's
    limits has lines, too, which are its loop's.
    """
    band = limit_band(logs)
    cutoff = band.cutoff
    for log in logs:
        if log.tau is not None and len(log) > AROUND:
            frequency, power = welch(
                log.tau, 1 / log.dt, nperseg=min(len(log), round(SPECTRUM_SEGMENT / log.dt)), axis=0
            )
            free = compute_share_near_limit(log.tau, rig.tau_max) < MOSTLY
            while 2 * cutoff <= WIDEST_BAND / log.dt and has_lines_beyond(
                frequency, power[:, free], cutoff
            ):
                cutoff *= 2
    return replace(band, cutoff=cutoff)


def has_lines_beyond(frequency: Array, power: Array, cutoff: float) -> bool:
    """Whether the lines above a cutoff, Hz, hold more of any joint's power, (f, n), than all that is below it."""
    lines = np.where(power > LINE_POWER * median_filter(power, (AROUND, 1)), power, 0.0)
    above = frequency > cutoff
    return bool(np.any(lines[above].sum(axis=0) > power[~above].sum(axis=0)))


def alternate_blocks(evidence: Evidence, filtering: Filtering) -> tuple[Evidence, Evidence]:
    """Return the blocks that are fitted to, two of three, and those that are reported on."""
    seconds = evidence.seconds
    count = max(FEWEST_BLOCKS, min(MOST_BLOCKS, round(seconds / SHORTEST_BLOCK)))
    fitted: list[LogStretch] = []
    kept: list[LogStretch] = []
    before = 0.0
    for part in evidence.parts:
        time = before + part.dt * np.arange(len(part.gate))
        before += part.dt * len(part.gate)
        reported = np.minimum(time * count / seconds, count - 1).astype(int) % FEWEST_BLOCKS == 1
        fitted.append(open_blocks(part, ~reported, filtering))
        kept.append(open_blocks(part, reported, filtering))
    return replace(evidence, parts=tuple(fitted)), replace(evidence, parts=tuple(kept))


def open_blocks(part: LogStretch, block: Flags, filtering: Filtering) -> LogStretch:
    """Return a part whose gate is open in some blocks only, (m,); elsewhere no rollout goes, either."""
    reach = round(compute_settling_time(filtering) / 2 / part.dt)
    shut = dilate_flags(~block[:, None], reach)
    gate = part.gate * build_mask(shut, round(TAPER / filtering.cutoff / part.dt))
    lost = ~block if part.channels.lost is None else part.channels.lost | ~block
    return part._replace(gate=np.asfortranarray(gate), channels=part.channels._replace(lost=lost))
