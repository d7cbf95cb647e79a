"""Where the baseline's error goes: what each thing that a controller knows takes off it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

from gimbal_pin.control.controllers import BASELINE

FRICTION = "friction"
STEPS = (
    ("base motion", "without-hidden"),
    ("hidden parameters", "computed-torque"),
    (FRICTION, "with-friction"),
    ("prediction", "with-prediction"),
    ("several gyros", "with-gyros"),
    ("foreknowledge", "oracle"),
)
"""What the controller of each name knows that the one before it does not, from the baseline on."""
ORACLES, LEFT = "the oracle's own", "what is left"
"""The last part: the oracle's error, or that of the last controller which ran."""


@dataclass(frozen=True)
class Budget:
    """The baseline's mean square jitter in parts that add up: what knowing one thing more takes off, and what is left.

    Attributes:
        baseline: Jitter of the world-frame PID, rad rms.
        parts: What → its share of the mean square; negative where knowing it did harm; the last is what is left.
        left: Jitter of the last of them, the oracle where it ran, rad rms.
    """

    baseline: float
    parts: Mapping[str, float]
    left: float

    @property
    def telling(self) -> bool:
        """Whether it parts the error at all: one controller beside the baseline leaves one part and the rest."""
        return len(self.parts) > 2

    @property
    def note(self) -> str:
        """Why parts may be more than all of it, where one is; else nothing."""
        harm = [what for what, share in self.parts.items() if share < 0]
        return f"all parts are 100 %: {', '.join(harm)} did harm, which the others make up for" if harm else ""

    @staticmethod
    def of(jitter: Mapping[str, float], beside: Sequence[str] = ()) -> Budget | None:
        """Part the error by controllers' jitter, rad rms; steps whose controller did not run are told with the next.

        Args:
            jitter: Controller → rad rms.
            beside: Causes that are compensated with friction, as cogging: their share is in friction's.
        """
        if BASELINE not in jitter or not any(name in jitter for _, name in STEPS):
            return None
        whole, parts, before, since = jitter[BASELINE], {}, jitter[BASELINE], ""
        for step, name in STEPS:
            what = " and ".join(filter(None, [step, ", ".join(beside)])) if step == FRICTION else step
            since = since or what
            if name in jitter:
                parts[what if since == what else f"{since} to {what}"] = (before**2 - jitter[name] ** 2) / whole**2
                before, since = jitter[name], ""
        parts[ORACLES if STEPS[-1][1] in jitter else LEFT] = before**2 / whole**2
        return Budget(whole, parts, before)

    def size(self, what: str) -> float:
        """A part as jitter, rad rms, with the sign of its share."""
        share = self.parts[what]
        return self.baseline * (sqrt(share) if share >= 0 else -sqrt(-share))
