"""What a check of the audit returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a log.

    Attributes:
        cause: Name in CONTRACT.md, group *data*.
        joint: The joint concerned most; None for the whole log.
        sentence: What is wrong, for one who builds rigs.
        parameters: What was measured, with deviations and units.
        strength: How far beyond what is admissible: over one is found.
        makes_physics_unreliable: Whether a fit of the log as it was recorded would show the wrong physics.
        next_experiment: What to record or to change.
        sparse: Whether the fault is only that samples lie too far apart to be fitted: each of them is true.
        slight: Whether it is worth a note only: it does this log no harm, though it might another.
        answer: Base parameters and friction estimated in spite of the fault, where there is such an estimate.
    """

    cause: str
    joint: str | None
    sentence: str
    parameters: tuple[Parameter, ...]
    strength: float
    makes_physics_unreliable: bool
    next_experiment: str
    answer: tuple[Parameter, ...] = ()
    sparse: bool = False
    slight: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds of a data finding; CONTRACT's figures of physical findings are null."""
        physical = ("gain", "p_value", "selection_frequency", "explained_share", "visible_fraction")
        return {
            "cause": self.cause,
            "joint": self.joint,
            "status": "data",
            "class": [self.cause],
            "parameters": as_json(self.parameters),
            **dict.fromkeys(physical),
            "rivals": [],
            "sentence": self.sentence,
            "next_experiment": self.next_experiment,
            "strength": self.strength,
            "makes_physics_unreliable": self.makes_physics_unreliable,
            "answer": as_json(self.answer),
        }


class Examined(NamedTuple):
    """A fault, and the log to go on with."""

    fault: Fault
    log: Log


Check = Callable[[Rig, Log, Filtering], "Examined | None"]
"""Examines one trajectory for one cause."""


def as_json(parameters: tuple[Parameter, ...]) -> dict[str, dict[str, Any]]:
    """Return ``{name: {"value": .., "std": .., "unit": ..}}``; a deviation that was not estimated is null."""
    return {p.name: {"value": p.value, "std": p.std if isfinite(p.std) else None, "unit": p.unit} for p in parameters}
