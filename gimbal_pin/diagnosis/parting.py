"""What a next experiment is expected to part: a finding from each cause that the logs so far cannot tell it from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from gimbal_pin.log import Motion

NAMED = 4.0
"""Standard deviations between two causes from which one is named: Vuong's z, half of that, is then two."""
UNLIKE = 0.31
"""Share of what a cause adds that its rival must leave unexplained: their correlation is then 0.95."""
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
        """Whether a diagnosis would name the cause: it takes both the deviations and the share."""
        return self.deviations >= NAMED and self.share >= UNLIKE

    @property
    def worth(self) -> float:
        """``d/(d + 4) + s/(s + 0.31)``, d deviations, s share: grows with both, ever less beyond what names a cause."""
        return self.deviations / (self.deviations + NAMED) + self.share / (self.share + UNLIKE)


@dataclass(frozen=True)
class Parting:
    """A finding and one of its rivals.

    Attributes:
        cause: Name of the finding.
        joint: Where it sits; None for a cause of the whole rig.
        rival: Name of the cause that the logs cannot tell from it.
        now: How far the logs so far part them.
        expected: How far they and the next experiment will; None where no motion parts the two.
        instead: What parts them where no motion does: experiments in words.
    """

    cause: str
    joint: str | None
    rival: str
    now: Apart
    expected: Apart | None
    instead: str

    @property
    def sentence(self) -> str:
        """All of it for a person."""
        who = f"{self.joint or 'rig'}: {self.cause} and {self.rival}"
        if self.expected is None:
            return f"{who} can be the same torque however the rig is moved: no motion parts them; try {self.instead}"
        said = f"{who} lie {self.now.deviations:.2g} standard deviations apart so far"
        said += f", {self.expected.deviations:.3g} are expected with the next experiment"
        if self.expected.named:
            return said
        if self.expected.deviations < NAMED:
            return f"{said}: too few to name one; try also {self.instead}"
        return f"{said}: that tells which fits better, yet the two look much alike; try also {self.instead}"

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
            "partings": [parting.to_dict() for parting in self.partings],
        }

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it for a person."""
        told = tuple(parting.sentence for parting in self.partings)
        if self.motion is None:
            return told
        how = f"the motion lasts {self.seconds:.3g} s, from rest to rest within the rig's limits"
        how += "" if self.finished else "; the search for it was interrupted, it is the best so far"
        return (*told, f"{how}: play it, and diagnose its log with the others by --holdout last-third")
