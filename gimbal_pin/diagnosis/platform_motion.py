"""A platform that moves: what its IMU measured, against the model of a rig whose base stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.engine.rivals import APART
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.finding import MEASURED, Finding
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.otherwise import clarity, known, otherwise
from gimbal_pin.diagnosis.state import State
from gimbal_pin.log import Log
from gimbal_pin.parameter import Parameter
from gimbal_pin.platform import LEANS, Platform
from gimbal_pin.rig import GRAVITY, Rig
from gimbal_pin.rows import Filtering

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
    carried: State, held: Evidence, train: Sequence[Log], test: Sequence[Log], filtering: Filtering
) -> Ridden | None:
    """Refit the rig as if its base stood, and compare; None where no IMU says that it moves, or where that is nothing.

    Args:
        carried: The refitted model on the base's measured motion with what was found, beside which it is compared.
        held: The held-out evidence, with that motion.
        train: The logs that were trained on.
        test: The held-out ones; none where the training logs stand for them.
        filtering: The band.
    """
    if carried.problem.reduction.base == "fixed":
        return None
    rig = carried.problem.evidence.rig
    standing_train, standing_test = ([standing(rig, log) for log in logs] for logs in (train, test))
    without = otherwise(carried, held, standing_train, standing_test, filtering, "fixed")
    before, after = measured(without.held, extended(without.state)), measured(held, extended(carried))
    ratios = [before["torque_rmse"][joint] / max(after["torque_rmse"][joint], 1e-300) for joint in rig.joints]
    j = int(np.argmax(ratios))
    clear = clarity(without.state, carried, j)
    if ratios[j] < CONFIRMED or clear < APART:
        return None
    baseline = measured(without.held, extended(without.plain)) if carried.causes else before
    return Ridden(told(rig, rig.joints[j], (baseline, before, after), motion(rig, train), clear), baseline)


def standing(rig: Rig, log: Log) -> Log:
    """Return a log without what the base's IMU says."""
    return replace(log, imus={link: imu for link, imu in log.imus.items() if link != rig.base})


def motion(rig: Rig, logs: Sequence[Log]) -> tuple[float, float]:
    """Root mean square of the base's rate, rad/s, and of its specific force off what an upright base feels, m/s²."""
    moves = [Platform.measured(log.t, log.imus[rig.base], log.name) for log in logs if rig.base in log.imus]
    w, f = (np.concatenate([getattr(move, name) for move in moves]) for name in ("w", "f"))
    off = f - np.array([0.0, 0.0, GRAVITY])
    rate, force = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (w, off))
    return rate, force


def told(
    rig: Rig, joint: str, figures: tuple[Figures, Figures, Figures], moved: tuple[float, float], clear: float
) -> Finding:
    """Describe the platform's motion by the joint at which it matters most; figures of nothing, without it, with it."""
    rate, force = moved
    baseline, *each = figures
    felt = f" and feels {force:.3g} m/s² beside its weight" if force > LEANS else ""
    said = (
        f"rig: platform-motion, the platform turns at {rate:.3g} rad/s{felt} (rms, by its IMU), and the model has that"
    )
    parameters = (Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2"))
    whole, (before, after) = baseline["torque_rmse"][joint], each
    return known(MEASURED, None, joint, (before, after), whole, clear, parameters, said)
