"""Events of many runs, each kind told once."""

from __future__ import annotations

import re
from collections.abc import Iterable

STAMPED = re.compile(r"(?P<t>-?[\d.]+) s: (?P<what>.*)", re.DOTALL)
FIGURE = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def summed(events: Iterable[str]) -> tuple[str, ...]:
    """Return events ``TIME s: WHAT``, those that differ by nothing but figures as one with their count, in order.

    What is told is the earliest of each kind.
    """
    kinds: dict[str, list[tuple[float, str]]] = {}
    for event in events:
        found = STAMPED.fullmatch(event)
        kind = FIGURE.sub("#", found["what"] if found else event)
        kinds.setdefault(kind, []).append((float(found["t"]) if found else 0.0, event))
    return tuple(told(sorted(several)) for several in kinds.values())


def told(several: list[tuple[float, str]]) -> str:
    """Return the earliest of a kind, and how often that kind happened."""
    (_, event), *rest = several
    return f"{event} ({len(several)} times)" if rest else event
