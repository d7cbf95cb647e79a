"""Channels that do not belong together, planted in a finished log: to be told as *data*."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .rigs import Array

Columns = dict[str, Array]


@dataclass(frozen=True)
class Damage:
    """A damaged log, and the sizes of what was done to it."""

    columns: Columns
    parameters: dict[str, float] = field(default_factory=dict)


def late_torque(columns, rng):
    """Every torque column 50–200 ms behind the others; the rows before the first torque are not in the log."""
    late = rng.uniform(0.05, 0.2)
    t = columns["t"]
    kept = t >= t[0] + late
    torques = {name: x for name, x in columns.items() if name.startswith("tau_")}
    delayed = {name: np.interp(t - late, t, x) for name, x in torques.items()}
    return Damage({name: x[kept] for name, x in (columns | delayed).items()}, {"late": late})


def exchanged_joints(columns, rng):
    """Two joints' columns stand under each other's name, in every channel."""
    joints = [name.removeprefix("tau_") for name in columns if name.startswith("tau_")]
    first, second = (str(joint) for joint in rng.choice(joints, 2, replace=False))
    exchanged = dict(columns)
    for kind in ("q", "dq", "tau", "q_ref", "temp"):
        if (one := f"{kind}_{first}") in columns:
            other = f"{kind}_{second}"
            exchanged |= {one: columns[other], other: columns[one]}
    return Damage(exchanged)


MISMATCHES = {
    ("late-torque", "resampled"): late_torque,
    ("exchanged-joints", "all-channels"): exchanged_joints,
}
"""(cause, form) → what it does to a log."""
