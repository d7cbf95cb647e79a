"""What a next experiment is expected to part: a finding from each cause that the logs so far cannot tell it from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gimbal_pin.diagnosis.probability import SURE
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Motion
from gimbal_pin.rig.brief import brief


class Apart(NamedTuple):
    """How far a finding and a rival are told apart.

    Attributes:
        deviations: Standard deviations of the noise between their torques.
        share: The same as a share of what the finding adds to all that is refitted.
        probability: That of the finding beside the rival; of logs to come, if it is there, what 19 of 20 give at least.
        median: The same of half of them.
    """

    deviations: float
    share: float
    probability: float
    median: float


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
        return "named" if self.expected.probability >= SURE else "few"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        both = {"now": self.now, "expected": self.expected}
        figures = {
            f"{name}_{when}": None if one is None else getattr(one, name)
            for name in ("probability", "deviations", "share")
            for when, one in both.items()
        }
        own = {"cause": self.cause, "joint": self.joint, "rival": self.rival}
        return {**own, **figures, "sentence": describe_partings([self])}


def describe_partings(partings: Sequence[Parting]) -> str:
    """Say what the next experiment does to a finding and some of its rivals, the same to all."""
    first = partings[0]
    who = first.joint or "rig"
    rivals = ", ".join(one.rival for one in partings)
    instead = "; or ".join(dict.fromkeys(way for one in partings for way in one.instead))
    after = join_odds(
        [str(int(compute_odds(one.expected))) for one in partings if one.expected is not None]
    )
    if not after:
        same = f"{who}: {first.cause} and {rivals} can be the same torque in every motion that was tried"
        return f"{same}; what else may part them: {instead}"
    now = join_odds([digits(compute_odds(one.now), 2) for one in partings])
    said = f"{who}: {first.cause} is {now} times as likely as {rivals} so far and, if it is there, at least "
    said += f"{after} times with the next experiment, in 19 of 20 logs"
    return (
        said if first.outcome == "named" else f"{said}: too little to name it; try also {instead}"
    )


def join_odds(each: Sequence[str]) -> str:
    """One figure where all are the same, else each rival's."""
    return each[0] if len(set(each)) == 1 else ", ".join(each)


def compute_odds(apart: Apart) -> float:
    """Return how many times as likely a finding is as its rival, a hundred times at most."""
    return min(apart.probability / max(1.0 - apart.probability, 1e-9), 100.0)


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
        partings = [parting.to_dict() for parting in self.partings]
        return {"seconds": self.seconds, "finished": self.finished, "partings": partings}

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it for a person."""
        groups: dict[tuple[str | None, str], dict[str, list[Parting]]] = {}
        for one in self.partings:
            groups.setdefault((one.joint, one.cause), {}).setdefault(one.outcome, []).append(one)
        told = tuple(
            describe_partings(group) for outcomes in groups.values() for group in outcomes.values()
        )
        if self.motion is None:
            return told
        cut = "" if self.finished else "; the search for it was interrupted, it is the best so far"
        names = any({*outcomes} == {"named"} for outcomes in groups.values())
        vain = (
            ""
            if names
            else "; it names no cause, as each keeps a rival, and can but rule out others"
        )
        return (
            *told,
            f"the motion lasts {digits(self.seconds)} s, from rest to rest within the rig's limits{cut}{vain}: play "
            "it, and diagnose its log with the others by --holdout last-third, and by itself; what either rules out is "
            "ruled out",
        )
