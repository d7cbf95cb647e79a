"""What a gimbal must reach, and what it should (CONTROL, targets)."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

from gimbal_pin.control.controllers import OURS
from gimbal_pin.pointing.contest import Contest
from gimbal_pin.pointing.sight import Sight

APART = 0.01
"""Axes that miss each other by more than this make uneven arms, m."""
LATE = 0.004
"""Delay beyond one sample from which the targets are those of a late drive, s."""
MUST, LATE_MUST = 5.0, 4.0
"""How many times stiller than a PID, and of a late drive."""


@dataclass(frozen=True)
class Target:
    """One figure beside what it must be and what it should be.

    Attributes:
        name: What it is.
        value: The figure, None where a controller that it takes did not run.
        must: The bound.
        aim: The better bound.
        least: True where larger is better.
        note: What is to be known beside it, as sentences, or nothing.
    """

    name: str
    value: float | None
    must: float
    aim: float
    least: bool
    note: str = ""

    @property
    def verdict(self) -> str:
        """Whether it is "aim", "must" or "missed"; "–" without a figure."""
        if self.value is None:
            return "–"
        sign = 1 if self.least else -1
        met = [sign * self.value >= sign * bound for bound in (self.aim, self.must)]
        return "aim" if met[0] else "must" if met[1] else "missed"


def targets(found: Contest, sight: Sight, late: float = 0.0) -> tuple[Target, ...]:
    """Return the targets that a contest is judged by.

    Args:
        found: The contest.
        sight: The rig's kinematics: they say whether its arms are uneven.
        late: Delay of the drives beyond one sample, s.
    """
    ours = found.jitter.get(OURS)
    jitter = None if ours is None else degrees(ours)
    platform = found.rows[0].runs[0].platform
    uneven = sight.apart > APART
    gain = (LATE_MUST, 10.0) if late >= LATE else (MUST, 20.0 if uneven else 10.0)
    still = (0.006, 0.0035) if platform == "log" else (0.012, 0.005) if uneven else (0.005, 0.003)
    where = "recorded motion: " if platform == "log" else ""
    ratios = (
        Target(f"{where}world-frame PID over {OURS}", found.gain, *gain, True, about_delay(late)),
        Target(f"{where}{OURS} over the oracle", found.distance, 2.5, 1.3, False),
    )
    # How still a late drive must stand nobody has stated: only how much stiller than with a PID.
    return ratios if late >= LATE else (*ratios, Target(f"{where}jitter, ° rms", jitter, *still, False))


def about_delay(late: float) -> str:
    """Say what a delay that is known, s beyond one sample, does to the ratio of a PID over ours, and to its bound."""
    if late <= 0:
        return ""
    told = (
        f"the PID, too, is given its margins with the {1e3 * late:.3g} ms of delay that are known: slower for it, it "
        "shakes more than one that is not told, so that part of this ratio is not the model's"
    )
    less = f"must is {LATE_MUST:g}, not {MUST:g}: the motion must be foreseen that much further, which is less sure"
    return f"{less}; {told}" if late >= LATE else told
