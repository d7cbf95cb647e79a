"""Which causes look alike on this log: how near what one explains lies to what another could in its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.engine.criterion import without
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.fit import project
from gimbal_pin.effects import Cause
from gimbal_pin.log.log import Array


@dataclass(frozen=True, eq=False)
class Likeness:
    """A finding and its rivals.

    Attributes:
        joint: Where the finding sits, or None.
        causes: Names: the finding first, then its rivals, the nearest first (k).
        correlation: Largest cosine between what two of them can explain beside the model, in [0, 1], (k, k).
    """

    joint: str | None
    causes: tuple[str, ...]
    correlation: Array

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        rows = [[round(value, 4) for value in row] for row in self.correlation.tolist()]
        return {"joint": self.joint, "causes": list(self.causes), "correlation": rows}


def likeness(found: Explained, cause: Cause) -> Likeness:
    """Compare a cause and its rivals by whitened columns without what all other columns explain."""
    base = without(found.final, cause)
    rivals = {one.cause.name: one.cause for one in reversed(found.rivals_of(cause))}
    every = [cause, *(one for name, one in reversed(rivals.items()) if name != cause.name)]
    columns = [base.columns(one) for one in every]
    spans = [span(project(base.fit, one.own, one.joint)) for one in columns]
    between = np.array([[cosine(a, b) for b in spans] for a in spans])
    return Likeness(cause.place if cause.of_joint else None, tuple(one.name for one in every), between)


def span(columns: Array) -> Array:
    """Return orthonormal columns that span some, (rows, k)."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size.max(initial=1e-300)])


def cosine(a: Array, b: Array) -> float:
    """Cosine of the smallest angle between two spans, in [0, 1]."""
    return float(np.linalg.svd(a.T @ b, compute_uv=False).max(initial=0.0))
