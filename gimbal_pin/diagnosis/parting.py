"""What a next experiment is expected to part: a finding from each cause that the logs so far cannot tell it from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gimbal_pin.diagnosis.fit import CRITICAL_Z
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Motion
from gimbal_pin.rig.brief import brief

NAMED = 2 * CRITICAL_Z
"""Standard deviations between two causes from which one is named: half of them is Vuong's z to be expected."""


class Apart(NamedTuple):
    """Standard deviations between two causes, and their share of what the found one adds to all that is refitted."""

    deviations: float
    share: float


@dataclass(frozen=True)
class Parting:
    """A finding and one of its rivals.

    Attributes:
        cause: Name of the finding.
        joint: Where it sits; None for a cause of the whole rig.
        rival: Name of the cause that the logs cannot tell from it.
        now: How far the logs so far part them.
        expected: How far they and the next experiment will; None where no motion parts the two.
        instead: What may part them where that motion does not: experiments in words.
    """

    cause: str
    joint: str | None
    rival: str
    now: Apart
    expected: Apart | None
    instead: tuple[str, ...]

    @property
    def outcome(self) -> str:
        """Whether the next experiment names the finding or leaves the two too near, or no motion parts them."""
        if self.expected is None:
            return "none"
        return "named" if self.expected.deviations >= NAMED else "few"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        after = self.expected
        return {
            "cause": self.cause,
            "joint": self.joint,
            "rival": self.rival,
            "deviations_now": self.now.deviations,
            "deviations_expected": None if after is None else after.deviations,
            "share_now": self.now.share,
            "share_expected": None if after is None else after.share,
            "sentence": together([self]),
        }


def together(partings: Sequence[Parting]) -> str:
    """What is to be said of a finding and some of its rivals that the next experiment does the same to."""
    first = partings[0]
    who = f"{first.joint or 'rig'}: {first.cause} and {', '.join(one.rival for one in partings)}"
    instead = "; or ".join(dict.fromkeys(way for one in partings for way in one.instead))
    if first.expected is None:
        return f"{who} can be the same torque in every motion that was tried; what else may part them: {instead}"
    after = ", ".join(digits(one.expected.deviations) for one in partings if one.expected is not None)
    # A small share of a loud torque is many deviations, and no more than either formula may be off.
    said = f"add nearly the same torque on these logs, {after} standard deviations apart"
    if all(one.now.deviations < NAMED for one in partings):
        now = ", ".join(digits(round(one.now.deviations, 2), 2) for one in partings)
        said = f"lie {now} standard deviations apart so far, {after}"
    said = f"{who} {said} with the next experiment"
    return said if first.outcome == "named" else f"{said}: too few to name one; try also {instead}"


@dataclass(frozen=True, eq=False)
class NextExperiment:
    """The motion that parts what is ambiguous.

    Attributes:
        joints: Joint names (n).
        motion: From rest to rest within the rig's limits; None where no motion parts anything.
        partings: What it is expected to part, and what no motion can.
        finished: False if the search was interrupted: the motion is then the best so far.
    """

    joints: tuple[str, ...]
    motion: Motion | None
    partings: tuple[Parting, ...]
    finished: bool = True

    __repr__ = brief

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return 0.0 if self.motion is None else float(self.motion.t[-1] - self.motion.t[0])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {
            "seconds": self.seconds,
            "finished": self.finished,
            "alone": False,  # whether the logs so far are to be left out: more rows never bring two causes nearer
            "partings": [parting.to_dict() for parting in self.partings],
        }

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it for a person."""
        groups: dict[tuple[str | None, str], dict[str, list[Parting]]] = {}
        for one in self.partings:
            groups.setdefault((one.joint, one.cause), {}).setdefault(one.outcome, []).append(one)
        told = tuple(together(group) for outcomes in groups.values() for group in outcomes.values())
        if self.motion is None:
            return told
        how = f"the motion lasts {digits(self.seconds)} s, from rest to rest within the rig's limits"
        how += "" if self.finished else "; the search for it was interrupted, it is the best so far"
        settled = any({*outcomes} == {"named"} for outcomes in groups.values())
        how += "" if settled else "; it names no cause, as each keeps a rival, and can but rule out others"
        how += ": play it, and diagnose its log with the others by --holdout last-third, and by itself"
        return (*told, f"{how}; what either rules out is ruled out")
