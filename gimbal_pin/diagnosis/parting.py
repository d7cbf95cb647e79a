"""What a next experiment is expected to part: a finding from each cause that the logs so far cannot tell it from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gimbal_pin.digits import digits
from gimbal_pin.log import Motion

NAMED = 4.0
"""Standard deviations between two causes from which one is named: Vuong's z, half of that, is then two."""
IDENTICAL = 1e-3
"""Share of what a cause adds under which its rival is the same torque, wherever the rig is moved."""


class Apart(NamedTuple):
    """How far two causes are apart.

    Attributes:
        deviations: ``|f - best explanation by rival, rigid model and friction| / noise``, f the found cause's torque:
            the separation in standard deviations, over all samples. Half of it is the Vuong z that is expected.
        share: The same over ``|f - best explanation by rigid model and friction| / noise``, in [0, 1].
    """

    deviations: float
    share: float

    @property
    def named(self) -> bool:
        """Whether a diagnosis would name the cause."""
        return self.deviations >= NAMED

    @property
    def worth(self) -> float:
        """``d/(d + 4)``, d deviations: grows ever less beyond what names a cause."""
        return self.deviations / (self.deviations + NAMED)


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
        alone: Whether the next experiment is to be diagnosed alone, and parts them so.
    """

    cause: str
    joint: str | None
    rival: str
    now: Apart
    expected: Apart | None
    instead: tuple[str, ...]
    alone: bool = False

    @property
    def sentence(self) -> str:
        """All of it for a person."""
        return together([self])

    @property
    def same(self) -> bool:
        """Whether the two are the same torque on the logs so far, to the last digits."""
        return self.now.share <= IDENTICAL

    @property
    def kind(self) -> tuple[object, ...]:
        """What partings have in common of which one sentence speaks."""
        return self.joint, self.cause, self.outcome, self.same and self.expected is not None

    @property
    def outcome(self) -> str:
        """What is to be said of the next experiment."""
        if self.expected is None:
            return "none"
        if self.expected.named:
            return "named"
        return "few" if self.expected.deviations < NAMED else "alike"

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
            "sentence": self.sentence,
        }


def together(partings: Sequence[Parting]) -> str:
    """What is to be said of a finding and some of its rivals that the next experiment does the same to."""
    first = partings[0]
    who = f"{first.joint or 'rig'}: {first.cause} and {', '.join(one.rival for one in partings)}"
    instead = "; or ".join(once(way for one in partings for way in one.instead))
    after = [one.expected.deviations for one in partings if one.expected is not None]
    if not after:
        return f"{who} can be the same torque in every motion that was tried; what else may part them: {instead}"
    expected = ", ".join(digits(x) for x in after)
    beside = "on the next experiment's log alone" if first.alone else "with the next experiment"
    if first.same:
        said = f"{who} are one torque on these logs, {expected} standard deviations apart {beside}"
    elif first.alone and first.outcome == "named":
        said = f"{who} look much alike on these logs, and do not on the next experiment's alone: they lie {expected}"
        return f"{said} standard deviations apart there"
    elif all(one.now.deviations >= NAMED for one in partings):  # so many tell nothing while the share is small
        said = f"{who} add nearly the same torque on these logs, {expected} standard deviations apart {beside}"
    else:
        now = ", ".join(digits(one.now.deviations, 2) for one in partings)
        said = f"{who} lie {now} standard deviations apart so far, {expected} {beside}"
    more = {
        "named": "",
        "few": f": too few to name one; try also {instead}",
        "alike": f". That tells which fits better, but they add nearly the same torque: try also {instead}",
    }
    return said + more[first.outcome]


def once(ways: Iterable[str]) -> list[str]:
    """Experiments in words, each told once: those that differ by their reasons alone, behind a colon, as one."""
    reasons: dict[str, list[str]] = {}
    for way in dict.fromkeys(ways):
        what, _, why = way.partition(": ")
        reasons.setdefault(what, []).extend([why] if why else [])
    return [f"{what} ({'; '.join(why)})" if why else what for what, why in reasons.items()]


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

    @property
    def seconds(self) -> float:
        """Length of the motion, s."""
        return 0.0 if self.motion is None else float(self.motion.t[-1] - self.motion.t[0])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {
            "seconds": self.seconds,
            "finished": self.finished,
            "alone": any(parting.alone for parting in self.partings),
            "partings": [parting.to_dict() for parting in self.partings],
        }

    @property
    def settles(self) -> bool:
        """Whether a finding would be named by it: parted from every rival."""
        outcomes: dict[tuple[str | None, str], set[str]] = {}
        for one in self.partings:
            outcomes.setdefault((one.joint, one.cause), set()).add(one.outcome)
        return {"named"} in outcomes.values()

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it for a person."""
        groups: dict[tuple[object, ...], list[Parting]] = {}
        for one in self.partings:
            groups.setdefault((one.joint, one.cause, one.outcome, one.same and one.expected is not None), []).append(
                one
            )
        told = tuple(together(group) for group in groups.values())
        if self.motion is None:
            return told
        how = f"the motion lasts {digits(self.seconds)} s, from rest to rest within the rig's limits"
        how += "" if self.finished else "; the search for it was interrupted, it is the best so far"
        how += "" if self.settles else "; it names no cause, as each keeps a rival, and can but rule out others"
        if any(one.alone for one in self.partings):
            return (*told, f"{how}: play it, and diagnose its log alone; what either diagnosis rules out is ruled out")
        return (*told, f"{how}: play it, and diagnose its log with the others by --holdout last-third")
