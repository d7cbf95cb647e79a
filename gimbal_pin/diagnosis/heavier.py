"""What the refitted inertia about each joint's axis is, against the given one: a note where it differs by much.

Where a log cannot tell a motor's constant gain from the inertias that it moves, this is all that shows of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.finding import Untestable
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array

MUCH = 0.05
"""Share of the given inertia from which a difference is told."""
SURE = 4.0
"""And deviations."""


def inertias(found: Difference, rows: Array, hidden: Sequence[Untestable] = ()) -> tuple[str, ...]:
    """``m_j = mean over poses of M_jj``, refitted over given: a sentence for each joint where that is not one.

    Args:
        found: Refitted less given base parameters.
        rows: Base parameters → each joint's mean inertia about its axis, (n, b): see `Problem.inertia`.
        hidden: What the logs cannot show: what of it sits at the joint may be the reason.
    """
    rig, given = found.rig, given_beta(found.rig, found.reduction)
    out = []
    for j, joint in enumerate(rig.joints):
        row = rows[j]
        whole = float(row @ given)
        change, std = float(row @ found.change) / whole, float(np.sqrt(row @ found.covariance @ row)) / whole
        if abs(change) > max(MUCH, SURE * std):
            less = f"{100 * abs(change):.3g} ± {max(100 * std, 0.01):.1g} % {'more' if change > 0 else 'less'}"
            others = [one.cause for one in hidden if one.joint == joint]
            instead = f"; {' or '.join(others)}, which this log cannot show, may look like that" if others else ""
            out.append(f"{joint}: the inertia about its axis is {less} than the URDF's{instead}")
    return tuple(out)
