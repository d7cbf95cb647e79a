"""A platform that moves: what its IMU measured, against the model of a rig whose base stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.counterfactual import counterfactual
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.finding import MEASURED, Finding
from gimbal_pin.diagnosis.heldout import Figures
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.estimation.rows import Filtering
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import LEANS, Platform
from gimbal_pin.rig.rig import GRAVITY, Rig

COMPENSATION = "a controller that reads the platform's IMU: see 'gimbal-pin track RIG --platform'"


class Ridden(NamedTuple):
    """The platform's motion as a finding.

    Attributes:
        finding: It.
        baseline: Held-out figures of the refitted model whose base stands.
    """

    finding: Finding
    baseline: Figures


def ridden(
    found: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering
) -> Ridden | None:
    """Refit the rig as if its base stood, and compare; None where no IMU says that it moves, or where that is nothing.

    Args:
        found: The refitted model on the base's measured motion with what was found, beside which it is compared.
        held: The reporting part, with that motion.
        train: The logs that were fitted.
        test: The reporting ones; none where blocks of the fitted logs stand for them.
        filtering: The band.
    """
    if found.problem.reduction.base == "fixed":
        return None
    rig = found.problem.evidence.rig
    fitted, other = (
        [replace(log, imus={link: imu for link, imu in log.imus.items() if link != rig.base}) for log in logs]
        for logs in (train, test)
    )
    without = counterfactual(found, held, fitted, other, filtering, "fixed")
    if without is None:
        return None
    rate, force = motion(rig, train)
    felt = f" and feels {force:.3g} m/s² beside its weight" if force > LEANS else ""
    said = f"rig: platform-motion, the platform turns at {rate:.3g} rad/s{felt} (rms, by its IMU)"
    figures = (Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2"))
    finding = without.finding(MEASURED, None, without.plain, figures, f"{said}, and the model has that")
    return Ridden(finding, without.plain)


def motion(rig: Rig, logs: Sequence[Log]) -> tuple[float, float]:
    """Root mean square of the base's rate, rad/s, and of its specific force off what an upright base feels, m/s²."""
    moves = [Platform.measured(log.t, log.imus[rig.base], log.name) for log in logs if rig.base in log.imus]
    w, f = (np.concatenate([getattr(move, name) for move in moves]) for name in ("w", "f"))
    off = f - np.array([0.0, 0.0, GRAVITY])
    rate, force = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (w, off))
    return rate, force
