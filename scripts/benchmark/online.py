"""Time that the online estimator takes of a sample: one by one, and in blocks as a file or pipe gives them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from benchmark.data import DT, noisy_log
from benchmark.figure import Figure
from benchmark.timing import alternating
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.identification import LogMemory, Online
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig

SETTLED, MEASURED = 30_000, 10_000
"""Samples before, when everything is known and watched, and those that are timed."""
ROUNDS = 9
AT_MOST = 60.0
"""Requirement, µs."""


def measure() -> Iterator[Figure]:
    """Yield the median time of a sample, µs."""
    rig = Rig.load("thesis")
    log = noisy_log(nominal(rig), SETTLED + MEASURED, np.random.default_rng(0))
    online = Online.of(rig)
    start = online.advance(online.start(), log.part(slice(0, SETTLED)))
    assert online.is_ready(start), "the motion does not show every parameter"
    cuts = {"one by one": 1, "in blocks of 50 ms": round(0.05 / DT)}
    parts = {name: blocks(log, SETTLED, size) for name, size in cuts.items()}
    ways = {name: (lambda part=part: advanced(online, start, part)) for name, part in parts.items()}
    times = alternating(ways, ROUNDS, "online estimator")
    for name in ways:
        taken = 1e6 * times.median(name) / MEASURED
        yield Figure(f"online estimator, three axes, samples {name}", taken, "us", at_most=AT_MOST)


def blocks(log: Log, begin: int, size: int) -> Sequence[Log]:
    """Cut what follows the sample `begin` into blocks."""
    return [log.part(slice(k, k + size)) for k in range(begin, len(log), size)]


def advanced(online: Online, memory: LogMemory, parts: Sequence[Log]) -> LogMemory:
    """Take the blocks in."""
    for part in parts:
        memory = online.advance(memory, part)
    return memory
