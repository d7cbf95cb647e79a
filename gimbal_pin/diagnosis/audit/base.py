"""What a check of the audit is, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig

MATERIAL = 0.01
"""A fault that moves the torque of the fit by less than this share of the torque's rms is a note."""


@dataclass(frozen=True, eq=False)
class Fault:
    """One thing that is wrong with a log, before any physics.

    Attributes:
        cause: Name in CONTRACT.md, group *data*.
        joint: The joint concerned most; None for the whole log.
        severity: What was measured, with deviations and units.
        makes_physics_unreliable: Whether a fit of the log as it is would name the wrong physics. False: a note.
        sentence: What is wrong, for one who builds rigs.
        next_experiment: What to record or to change.
        mended: The log to go on with, where one can be made from what was recorded.
        answer: Parameters estimated in spite of the fault, where there is such an estimate.
    """

    cause: str
    joint: str | None
    severity: tuple[Parameter, ...]
    makes_physics_unreliable: bool
    sentence: str
    next_experiment: str
    mended: Log | None = None
    answer: tuple[Parameter, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as CONTRACT.md's JSON holds it; what a data fault does not have is null."""
        return {
            "cause": self.cause,
            "joint": self.joint,
            "status": "data",
            "class": [self.cause],
            "parameters": as_json(self.severity),
            "gain": None,
            "p_value": None,
            "selection_frequency": None,
            "explained_share": None,
            "visible_fraction": None,
            "rivals": [],
            "sentence": self.sentence,
            "next_experiment": self.next_experiment,
            "makes_physics_unreliable": self.makes_physics_unreliable,
            "answer": as_json(self.answer),
        }


class Check(Protocol):
    """One cause in the data: how to find it, and how to plant it."""

    name: ClassVar[str]
    shapes: ClassVar[tuple[Parameter, ...]]

    def examine(self, rig: Rig, log: Log) -> Fault | None:
        """Return what is wrong, or None."""

    def corrupt(self, log: Log, rng: np.random.Generator, **shape: float) -> Log:
        """Plant the fault in a log; `shape` overrides the defaults of `shapes`."""


def as_json(parameters: tuple[Parameter, ...]) -> dict[str, dict[str, Any]]:
    """Return ``{name: {"value": .., "std": .., "unit": ..}}``; a deviation that was not estimated is null."""
    return {
        p.name: {"value": p.value, "std": p.std if np.isfinite(p.std) else None, "unit": p.unit} for p in parameters
    }


def stated(check: Check, shape: Mapping[str, float]) -> dict[str, float]:
    """Return a value for each of a check's shapes; `UsageError` for an unknown name or a value out of bounds."""
    known = {parameter.name: parameter for parameter in check.shapes}
    for name, value in shape.items():
        if name not in known:
            raise UsageError(check.name, f"has no parameter '{name}'", f"it has {', '.join(known) or 'none'}")
        if not known[name].lower <= value <= known[name].upper:
            bounds = f"{known[name].lower:g} to {known[name].upper:g} {known[name].unit}"
            raise UsageError(f"{check.name}: {name}", f"is {value:g}", f"give {bounds}")
    return {name: shape.get(name, parameter.value) for name, parameter in known.items()}
