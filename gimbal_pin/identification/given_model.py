"""Sentences on how the given model's inertias and friction differ from the refitted one's."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.stats import norm

from gimbal_pin.dynamics.model import Model, build_friction_effects
from gimbal_pin.errors import format_estimate
from gimbal_pin.identification.difference import FALSE_ALARM
from gimbal_pin.identification.payload import DEVIATIONS, is_physical_inertia

LEAST_CHANGE = 0.05
"""Share of a joint's given inertia from which a difference is told: few URDFs are nearer."""
LEAST_PERCENT = 0.01
"""Smallest deviation of a difference that is printed, per cent."""


def describe_inertia(
    joint: str, given: float, change: float, std: float, imitators: Sequence[str] = ()
) -> str | None:
    """Say by how much a joint's inertia differs from the URDF's; None: not by a clear and material part.

    Args:
        joint: The joint.
        given: The URDF's inertia about its axis, kg m².
        change: The refitted one's difference from it, kg m².
        std: Standard deviation of that, kg m².
        imitators: Causes that look like another inertia and that the logs cannot show there.
    """
    is_clear = 2 * norm.sf(abs(change) / max(std, 1e-300)) < FALSE_ALARM
    if not (given > 0 and is_clear and abs(change) > LEAST_CHANGE * given):
        return None
    if not is_physical_inertia(given + change):
        return (
            f"{joint}: the log does not determine the inertia about its axis; "
            "noise in the motion or torque that the model lacks may be why"
        )
    percent = format_estimate(100 * abs(change) / given, max(100 * std / given, LEAST_PERCENT))
    way = "more" if change > 0 else "less"
    instead = (
        f"; {' or '.join(imitators)}, which this log cannot show, may look like that"
        if imitators
        else ""
    )
    return f"{joint}: the inertia about its axis is {percent} % {way} than the URDF's{instead}"


def describe_friction(refitted: Model, unexplained: Collection[str]) -> str | None:
    """Say in one sentence the refitted friction of joints whose URDF states none; None: there is nothing to say.

    Joints that are not explained are left out, and so are those at which a coefficient is negative by two deviations:
    no friction gives power.
    """
    known = refitted.estimated
    assert known is not None
    friction = {
        f"{effect.joint}.{effect.name}.{coefficient.name}"
        for effect in build_friction_effects(refitted.rig.joints)
        for coefficient in effect.coefficients
    }
    every = zip(known.names, known.theta.tolist(), known.std.tolist(), known.units)
    rows = [row for row in every if row[0] in friction]
    parts = list[str]()
    for joint, stated in zip(refitted.rig.joints, refitted.rig.friction):
        own = [row for row in rows if row[0].startswith(f"{joint}.")]
        gives_power = any(value < -DEVIATIONS * std for _, value, std, _ in own)
        if np.any(stated) or joint in unexplained or gives_power:
            continue
        shown = [
            f"{format_estimate(value, std)} {unit}"
            for _, value, std, unit in own
            if value > DEVIATIONS * std
        ]
        if shown:
            parts.append(f"{joint} {' and '.join(shown)}")
    if not parts:
        return None
    stated_not = f"the URDF states no friction where there is some: {', '.join(parts)} (± 95 %)"
    return f"{stated_not}; identify --urdf writes it in"
