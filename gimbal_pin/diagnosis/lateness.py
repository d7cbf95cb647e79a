"""What a log shows of drives' delays, and what a wider band of it would."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple


class Late(NamedTuple):
    """What a log shows of one joint's delay.

    Attributes:
        least: The least that would be found, s; inf where the rigid model and friction take up any.
        shown: The one that is there, s; 0 where none is sure.
    """

    least: float
    shown: float = 0.0


@dataclass(frozen=True)
class Timing:
    """What of drives' delays a wider band would show.

    Attributes:
        cutoff: The wider band's, Hz.
        joints: Joint → here, there; only where there is worth telling.
    """

    cutoff: float
    joints: Mapping[str, tuple[Late, Late]]

    @property
    def sentence(self) -> str:
        """All of it for a person."""
        here = ", ".join(f"{found(late)} at {joint}" for joint, (late, _) in self.joints.items())
        there = ", ".join(found(late) for _, late in self.joints.values())
        seen = [f"{1e3 * late.shown:.2g} ms at {joint}" for joint, (_, late) in self.joints.items() if late.shown]
        more = f"; there one of some {', '.join(seen)} shows" if seen else ""
        return f"a delay or lag would be found {here}; with --cutoff {self.cutoff:g} {there}{more}"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds, s; null for a delay that no band shows."""
        figures = {
            joint: {
                "least": here.least if isfinite(here.least) else None,
                "least_there": there.least if isfinite(there.least) else None,
                "shown_there": there.shown or None,
            }
            for joint, (here, there) in self.joints.items()
        }
        return {"cutoff_hz": self.cutoff, "joints": figures}


def found(late: Late) -> str:
    """``from 2.8 ms on``."""
    return f"from {1e3 * late.least:.2g} ms on" if isfinite(late.least) else "of no length"
