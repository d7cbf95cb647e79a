"""What a log shows of drives' delays, and what a wider band of it would, of these and of what else is fast."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from gimbal_pin.digits import digits

ASKED = "gimbal-pin diagnose RIG LOG"
"""The call that asks for a diagnosis, where nobody knows its arguments."""


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
    """What a wider band would show.

    Attributes:
        cutoff: The wider band's, Hz.
        joints: Joint → here, there, of its drive's delay; only where there is worth telling.
        more: Joints at which noise is left here, and more than that there: what rings above this band.
    """

    cutoff: float
    joints: Mapping[str, tuple[Late, Late]]
    more: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it for a person."""
        if not self.joints:
            return f"{self.option} more than noise is left at {', '.join(self.more)}"
        here = ", ".join(f"{found(late)} at {joint}" for joint, (late, _) in self.joints.items())
        there = ", ".join(found(late) for _, late in self.joints.values())
        more = f"; there one of some {self.seen} shows" if self.seen else ""
        return f"a delay or lag would be found {here}; {self.option} {there}{more}"

    @property
    def seen(self) -> str:
        """The delays that the wider band shows and this one does not; nothing where there is none."""
        rows = [(joint, there.shown) for joint, (_, there) in self.joints.items() if there.shown]
        return ", ".join(f"{digits(1e3 * shown, 2)} ms at {joint}" for joint, shown in rows)

    @property
    def option(self) -> str:
        """How one asks for the wider band, within a sentence."""
        return f"with --cutoff {self.cutoff:g}"

    def next(self, command: str = "") -> tuple[str, ...]:
        """Where the wider band shows something, the call that looks there, by the one that did not; else nothing.

        It comes before what is said without it: a cause that is named beside a delay nobody knows may stand for it.
        """
        late = f"a delay or lag of some {self.seen} shows" if self.seen else ""
        left = (
            f"more than noise is left at {', '.join(self.more)}, as of what rings above this band" if self.more else ""
        )
        why = f"there {' and '.join(filter(None, (late, left)))}; what is said here is said without it"
        return (f"{command or ASKED} --cutoff {self.cutoff:g} ({why})",) if late or left else ()

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
        return {"cutoff_hz": self.cutoff, "joints": figures, "more": list(self.more)}


def found(late: Late) -> str:
    """``from 2.8 ms on``."""
    return f"from {digits(1e3 * late.least, 2)} ms on" if isfinite(late.least) else "of no length"
