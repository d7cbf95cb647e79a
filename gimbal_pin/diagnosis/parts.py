"""Which time of a log is fitted to, and which is kept to report on: alternate blocks.

Blocks of the whole log show all of its angles, where a last third may show some that nothing before it has seen.
Between two blocks of different use half of what a row depends on is left out on either side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.evidence import TAPER, Evidence, Part
from gimbal_pin.estimation.rows import Filtering, Flags, dilated, mask, settling

BLOCKS = 15
"""Blocks of a log, unless they would be shorter than `SHORTEST`."""
SHORTEST = 2.5
"""Shortest block, s: ten times the correlation of a noise with a corner of 0.6 Hz, which drives' currents may have."""
LEAST = 3
"""Fewest blocks: every third, the middle one first, is reported on."""


def alternate(evidence: Evidence, filtering: Filtering) -> tuple[Evidence, Evidence]:
    """Return the blocks that are fitted to, two of three, and those that are reported on."""
    seconds = sum(part.dt * len(part.gate) for part in evidence.parts)
    count = max(LEAST, min(BLOCKS, round(seconds / SHORTEST)))
    fitted: list[Part] = []
    kept: list[Part] = []
    before = 0.0
    for part in evidence.parts:
        time = before + part.dt * np.arange(len(part.gate))
        before += part.dt * len(part.gate)
        reported = np.minimum(time * count / seconds, count - 1).astype(int) % LEAST == 1
        fitted.append(open_in(part, ~reported, filtering))
        kept.append(open_in(part, reported, filtering))
    return replace(evidence, parts=tuple(fitted)), replace(evidence, parts=tuple(kept))


def open_in(part: Part, block: Flags, filtering: Filtering) -> Part:
    """Return a part whose gate is open in some blocks only, (m,); elsewhere no rollout goes, either."""
    reach = round(settling(filtering) / 2 / part.dt)
    shut = dilated(~block[:, None], reach)
    gate = part.gate * mask(shut, round(TAPER / filtering.cutoff / part.dt))
    lost = ~block if part.channels.lost is None else part.channels.lost | ~block
    return part._replace(gate=np.asfortranarray(gate), channels=part.channels._replace(lost=lost))
