"""Which causes look alike on this log: how near what one could explain lies to what another could."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.nearness import cosine, nearness, span
from gimbal_pin.diagnosis.search import spot
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.effects import Cause
from gimbal_pin.log import Array

SHOWN = 8
"""Most causes beside a finding."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """Candidates in a finding's place.

    Attributes:
        joint: Where the finding sits, or None.
        causes: Names: the finding first, then the likest (k).
        correlation: Largest cosine between what two of them can explain beside the model, in [0, 1], (k, k).
    """

    joint: str | None
    causes: tuple[str, ...]
    correlation: Array

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        rows = [[round(value, 4) for value in row] for row in self.correlation.tolist()]
        return {"joint": self.joint, "causes": list(self.causes), "correlation": rows}


def likeness(state: State, cause: Cause, shelf: Library) -> Likeness:
    """Compare a chosen cause with every other at its place, and these with each other.

    Columns are whitened, and freed of all that the rigid model, friction and the other findings explain: what is left
    of two of them is parted by this log only as far as the angle between them is wide.
    """
    base = without(state, cause)
    own = span(base.fit, base.columns(cause))
    others = [columns for columns in shelf.columns(base, spot(cause)) if columns.cause.name != cause.name]
    best: dict[str, tuple[float, Columns]] = {}
    for columns, near in zip(others, nearness(base.fit, own, others).tolist()):
        if near > best.get(columns.cause.name, (0.0, columns))[0]:
            best[columns.cause.name] = near, columns
    ranked = sorted(best.items(), key=lambda entry: -entry[1][0])[:SHOWN]
    spans = [own, *(span(base.fit, columns) for _, (_, columns) in ranked)]
    between = np.array([[cosine(a, b) for b in spans] for a in spans])
    return Likeness(cause.place if cause.of_joint else None, (cause.name, *(name for name, _ in ranked)), between)
