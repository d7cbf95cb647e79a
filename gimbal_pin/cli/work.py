"""What a call will cost, before it starts."""

from __future__ import annotations

import os

from gimbal_pin.errors import UsageError

PATIENCE = 600.0
"""Longest work that starts without being asked for twice, s."""
COSTS = {
    "simulated second of a joint": (0.035, 0.3),  # simulate thesis, 10 and 100 s
    "second of a joint on a platform": (0.25, 0.0),  # track turret, 1 and 6 s, one and three controllers
    "second of a joint in a demo": (0.06, 0.4),  # demo --rig turret, 30 and 60 s
    "frame": (5e-5, 2e-4),  # animate to HTML, 30 and 240 frames a second
    "rendered frame": (0.4, 0.0),  # animate to GIF, 20 and 100 frames, no graphics card
    "squared variable of a start": (4.7e-4, 0.0),  # excite, two and three joints, 5 to 50 harmonics
    "sample of a motion": (1.2e-4, 1.2e-3),  # excite turret, 60 and 600 s
    "sample of a repetition": (2e-6, 0.0),  # identify turret --bootstrap, 0 to 120
}
"""Kind of work → s on one core and MB that a piece takes, measured with the call beside it (2.5 GHz)."""


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
        what = f"would take about {took} and {memory / 1e9:.1f} GB"
        raise UsageError("this call", what, "add --yes to go on, or ask for less")
