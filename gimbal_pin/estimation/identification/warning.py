"""What has to be known before the parameters of an identification are read: of its logs, and of the parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from gimbal_pin.errors import digits
from gimbal_pin.estimation.audit import audit
from gimbal_pin.estimation.rows import chosen
from gimbal_pin.log.log import Log
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from gimbal_pin.estimation.identification.identified import Identified

SURE = 3.0
"""Deviations under zero from which a parameter that cannot be negative is said to be: one in 700 is by chance."""
EXPLAINED = 90.0
"""Held-out fit, %, from which a joint's misfit is a matter of accuracy: a tenth of the torque's deviation is what rigid
bodies with dry and viscous friction leave of a real arm (double pendulum: 0.18 of 1.8 N m)."""
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
    """Yield which joints are not explained, the faults of the logs, then what else is wrong, a sentence each."""
    yield from unexplained(found)
    yield from found.faults
    yield from negative(found)
    if found.held_out is not None:
        for joint, fit in found.held_out.fit_percent.items():
            if fit < 0:
                what = f"the model predicts the held-out torque worse than its mean does (fit {digits(fit, 2)} %)"
                yield f"{joint}: {what}: it holds for nothing but the logs that it was fitted to"
    for joint, used in found.train.used.items():
        if used < 1 - MOST:
            what = "near standstill, where dry friction is unknown, and left out"
            yield f"{joint}: {100 * (1 - used):.0f} % of the samples are {what}: the parameters are of the rest"


def unexplained(found: Identified) -> Iterator[str]:
    """Yield the joints whose torque follows from their motion in a way that the model does not hold."""
    judged = found.held_out or found.train
    for joint, one in found.missed.items():
        fit = judged.fit_percent[joint]
        if one.size > one.noise and not fit > EXPLAINED:
            size = f"{digits(one.size, 2)} N m rms of its torque are a function of its motion that the model lacks"
            yield f"{joint} is not explained: {digits(fit, 2)} %; run diagnose ({size}; deviations hold it)"


def negative(found: Identified) -> Iterator[str]:
    """Yield the friction and the moments of inertia that are significantly under zero; then those that only may be.

    A value under zero that its deviation explains is a value that the logs do not determine.
    """
    sums = (
        all(factor > 0 and name.rsplit(".", 1)[1] in POSITIVE for name, factor in terms.items())
        for terms in found.reduction.terms
    )
    positive = ["no body has such an inertia" if only else "" for only in sums]
    coefficients = (c for term in found.model.terms for c in term.effect.coefficients)
    positive += ["friction takes power" if c.lower >= 0 else "" for c in coefficients]
    rows = zip(found.names, positive, found.estimate.theta.tolist(), found.estimate.std.tolist(), found.units)
    vague = []
    for name, why, value, std, unit in rows:
        figure = f"{digits(value, 2)} ± {digits(1.96 * std, 2)} {unit}"
        if why and value < -SURE * std:
            yield f"{name} is negative ({figure}), and {why}: something else acts there, see 'gimbal-pin diagnose'"
        elif why and value < 0:
            vague.append(f"{name} ({figure})")
    if vague:
        yield f"undetermined, for their values are under zero and no such thing exists: {', '.join(vague)}"
