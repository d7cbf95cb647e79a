"""What a call will cost, before it starts."""

from __future__ import annotations

import os

from gimbal_pin.errors import UsageError

PATIENCE = 600.0
"""Longest work that starts without being asked for twice, s."""
COSTS = {
    "simulated second of a joint": (0.035, 0.3),
    "second on a platform": (0.3, 0.3),
    "diagnosed second of a joint": (0.5, 1.0),
    "frame": (5e-5, 0.002),
    "rendered frame": (0.2, 0.002),
    "descent per squared variable": (4.7e-4, 0.0),
    "sample of a motion": (1e-5, 1e-3),
    "row of a repetition": (1e-5, 0.0),
}
"""Kind of work → s on one core (2.x GHz) and MB that each piece takes."""


def affordable(yes: bool, processes: int = 1, /, **amounts: float) -> None:
    """Raise `UsageError` where work takes over `PATIENCE`, or over half of the machine's memory, unless `yes`.

    Args:
        yes: Whether it was asked for twice.
        processes: How many share the work.
        amounts: Kind of `COSTS`, spaces as underscores → how many pieces.
    """
    each = [(number, COSTS[kind.replace("_", " ")]) for kind, number in amounts.items()]
    seconds = sum(number * cost for number, (cost, _) in each) / min(processes, os.cpu_count() or 1)
    memory = sum(number * cost for number, (_, cost) in each) * 1e6
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if not yes and (seconds > PATIENCE or memory > whole / 2):
        took = f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.0f} hours"
        what = f"would take about {took} and {memory / 1e9:.1g} GB"
        raise UsageError("this call", what, "add --yes to go on, or ask for less")
