"""What a call will cost, before it starts."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from gimbal_pin.errors import UsageError

LONGEST_UNASKED = 600.0
"""Longest work that starts without being asked for twice, s."""
COSTS = {
    "simulated second of a joint": (0.035, 0.3),  # simulate thesis, 10 and 100 s
    "second of a joint on a platform": (0.25, 0.0),  # track turret, 1 and 6 s, one and three controllers
    "second of a joint in a fleet": (0.085, 0.0),  # montecarlo turret --count 40 --workers 1
    "identified log": (1.0, 0.0),  # fleet --quick --workers 1, turret, 10 s
    "diagnosed log": (5.0, 0.0),  # fleet --workers 1, turret, 10 s
    "second of a joint in a demo": (0.06, 0.4),  # demo --rig turret, 30 and 60 s
    "frame of a joint": (3e-5, 6e-4),  # animate one, two and three joints to HTML, 30 and 240 frames a second
    "rendered frame": (0.12, 0.0),  # animate to MP4, 361 frames in 40 s on busy cores, no graphics card
    "squared variable of a start": (4.7e-4, 0.0),  # excite, two and three joints, 5 to 50 harmonics
    "sample of a motion": (1.2e-4, 1.2e-3),  # excite turret, 60 and 600 s
    "sample of a repetition": (2e-6, 0.0),  # identify turret --bootstrap, 0 to 120
}
"""Kind of work → s on one core and MB that a piece takes, measured with the call beside it (2.5 GHz)."""


def check_cost(yes: bool, processes: int = 1, /, **amounts: float) -> None:
    """Raise `UsageError` where work takes over `LONGEST_UNASKED`, or over half of the memory it may have, unless `yes`.

    Args:
        yes: Whether it was asked for twice.
        processes: How many share the work.
        amounts: Kind of `COSTS`, spaces as underscores → how many pieces.
    """
    each = [(number, COSTS[kind.replace("_", " ")]) for kind, number in amounts.items()]
    seconds = sum(number * cost for number, (cost, _) in each) / min(processes, os.cpu_count() or 1)
    memory = sum(number * cost for number, (_, cost) in each) * 1e6
    if not yes and (seconds > LONGEST_UNASKED or memory > measure_memory() / 2):
        took = f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.0f} hours"
        what = f"would take about {took} and {memory / 1e9:.1f} GB"
        raise UsageError("this call", what, "add --yes to go on, or ask for less")


def measure_memory() -> float:
    """Return the memory of the machine, or what a limit of this process (``ulimit -v``) leaves of it, B."""
    page = os.sysconf("SC_PAGE_SIZE")
    machine = page * os.sysconf("SC_PHYS_PAGES")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return machine
    used = Path("/proc/self/statm")  # Linux's; elsewhere the whole limit counts
    return min(machine, limit - page * int(used.read_text().split()[0]) if used.exists() else limit)
