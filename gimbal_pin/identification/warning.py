"""What has to be known before the parameters of an identification are read: of its logs, and of the parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from gimbal_pin.audit import audit
from gimbal_pin.digits import digits
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from gimbal_pin.rows import chosen

if TYPE_CHECKING:
    from gimbal_pin.identification.identified import Identified

SURE = 3.0
"""Deviations under zero from which a parameter that cannot be negative is said to be: one in 700 is by chance."""
MOST = 0.5
"""Share of a joint's samples that may be masked out before the rest are no longer the log."""
POSITIVE = ("Ixx", "Iyy", "Izz", "m")
"""Parameters of a body that no body has negative; a sum of them is not either."""


def faults(rig: Rig, logs: Sequence[Log]) -> tuple[str, ...]:
    """Audit rectified logs as `diagnose` does, what spoils the physics first; of long ones what `rows.chosen` takes."""
    found = [(log.name, fault) for log in logs for fault in audit(rig, chosen(log).log).faults]
    worst_first = sorted(found, key=lambda each: not each[1].makes_physics_unreliable)
    told = [(name, fault) for name, fault in worst_first if not fault.slight]
    return tuple(
        f"{name + ': ' if len(logs) > 1 else ''}{fault.sentence}"
        + (f"; {fault.next_experiment}" if fault.makes_physics_unreliable else "")
        for name, fault in told
    )


def warnings(found: Identified) -> Iterator[str]:
    """Yield the faults of the logs, then what the parameters and the fit show to be wrong, a sentence each."""
    yield from found.faults
    yield from negative(found)
    if found.held_out is not None:
        for joint, fit in found.held_out.fit_percent.items():
            if fit < 0:
                what = f"the model predicts the held-out torque worse than its mean does (fit {digits(fit, 2)} %)"
                yield f"{joint}: {what}: it holds for nothing but the logs that it was fitted to"
    for body in found.bodies:
        half = 1.96 * body.mass.std
        if not half < abs(body.mass.value):
            figure = f"{digits(body.mass.value, 2)} ± {digits(half, 2)} kg"
            yield f"{body.link}: its mass is not determined by these logs ({figure}): the URDF's is as good"
    for joint, used in found.train.used.items():
        if used < 1 - MOST:
            what = "near standstill, where dry friction is unknown, and left out"
            yield f"{joint}: {100 * (1 - used):.0f} % of the samples are {what}: the parameters are of the rest"


def negative(found: Identified) -> Iterator[str]:
    """Yield the friction and the moments of inertia that are significantly under zero."""
    sums = (
        all(factor > 0 and name.rsplit(".", 1)[1] in POSITIVE for name, factor in terms.items())
        for terms in found.reduction.terms
    )
    positive = ["no body has such an inertia" if only else "" for only in sums]
    coefficients = (c for term in found.model.terms for c in term.effect.coefficients)
    positive += ["friction takes power" if c.lower >= 0 else "" for c in coefficients]
    rows = zip(found.names, positive, found.estimate.theta.tolist(), found.estimate.std.tolist(), found.units)
    for name, why, value, std, unit in rows:
        if why and value < -SURE * std:
            figure = f"{digits(value, 2)} ± {digits(1.96 * std, 2)} {unit}"
            yield f"{name} is negative ({figure}), and {why}: something else acts there, see 'gimbal-pin diagnose'"
