"""What the refitted inertia about each joint's axis is, against the given one: a note where it differs by much.

Where a log cannot tell a motor's constant gain from the inertias that it moves, this is all that shows of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot
from types import MappingProxyType

import numpy as np

from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.finding import Untestable
from gimbal_pin.identification import given_beta
from gimbal_pin.log import Array
from gimbal_pin.regressor import inertia_columns
from gimbal_pin.rows import columns_of

POSES = 50
"""Poses over which an inertia is averaged."""
MUCH = 0.05
"""Share of the given inertia from which a difference is told."""
SURE = 4.0
"""And deviations."""
EXACT: Mapping[str, float] = MappingProxyType({})


def inertias(
    found: Difference, q: Array, hidden: Sequence[Untestable] = (), off: Mapping[str, float] = EXACT
) -> tuple[str, ...]:
    """``m_j = mean over poses of M_jj``, refitted over given: a sentence for each joint where that is not one.

    Args:
        found: Refitted less given base parameters.
        q: Angles of the logs, rad, (N, n).
        hidden: What the logs cannot show: what of it sits at the joint may be the reason.
        off: Joint → standard deviation of a factor on its inertia that the difference does not hold.
    """
    rig, given = found.rig, given_beta(found.rig, found.reduction)
    out = []
    for j, joint in enumerate(rig.joints):
        row = inertia_row(found, q, j)
        whole = float(row @ given)
        change, std = float(row @ found.change) / whole, float(np.sqrt(row @ found.covariance @ row)) / whole
        std = hypot(std, (1 + change) * off.get(joint, 0.0))
        if abs(change) > max(MUCH, SURE * std):
            less = f"{100 * abs(change):.3g} ± {max(100 * std, 0.01):.1g} % {'more' if change > 0 else 'less'}"
            others = [one.cause for one in hidden if one.joint == joint]
            instead = f"; {' or '.join(others)}, which this log cannot show, may look like that" if others else ""
            out.append(f"{joint}: the inertia about its axis is {less} than the URDF's{instead}")
    return tuple(out)


def inertia_row(found: Difference, q: Array, joint: int) -> Array:
    """Base parameters → mean of M_jj over some of the poses q, (b,): torque of a unit acceleration, less gravity's."""
    some = q[np.linspace(0, len(q) - 1, POSES).astype(int)]
    columns = inertia_columns(found.rig, some, joint)[:, joint, columns_of(found.rig, found.reduction)]
    return np.asarray(np.mean(columns, axis=0))
