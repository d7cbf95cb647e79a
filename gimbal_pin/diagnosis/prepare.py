"""Logs as a diagnosis reads them: checked, repaired, and with what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gimbal_pin.checks import (
    Alteration,
    Fault,
    ScaleFault,
    check_log,
    collect_alterations,
)
from gimbal_pin.checks.channel_assignment import check_assignment_of_logs, fit_beginning
from gimbal_pin.checks.torque_time import find_shifted_torques, find_time_fault, report_shifts
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.result import Diagnosis, Finding
from gimbal_pin.diagnosis.rows import Rows, choose_band
from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.errors import DataError
from gimbal_pin.identification import greatest_base_motion
from gimbal_pin.log.io.columns import LEAST_TRAVEL, find_joints_asked_to_rest
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import BaseMotion
from gimbal_pin.regression import Filtering, limit_cutoff, subsample_log
from gimbal_pin.rig.rig import Rig

HARMONICS_OF_ANGLE = ("cogging", "position-dependent-friction")
"""Causes that stand out where noise of the acceleration hides inertia and gravity."""


@dataclass(frozen=True, eq=False)
class PreparedLogs:
    """Logs after all checks.

    Attributes:
        logs: The repaired logs.
        filtering: The band, as the checks use it.
        base: How the base moves in them.
        beginning: Arguments of the comparison of scales; None: it cannot be made.
        faults: What is wrong with the logs.
        notes: Remarks on what was done.
        altered: Log → what was altered.
        is_spoilt: Whether nothing can be said of the physics.
        is_reliable: Whether no fault makes the physics unreliable.
    """

    logs: tuple[Log, ...]
    filtering: Filtering
    base: BaseMotion
    beginning: Any
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]
    altered: dict[str, tuple[Alteration, ...]]
    is_spoilt: bool
    is_reliable: bool

    @property
    def makes_physics_unreliable(self) -> bool:
        """True if findings on the repaired logs are not to be relied on."""
        return any(fault.makes_physics_unreliable for fault in self.faults)

    def hides_inertia(self, joint: str | None = None) -> bool:
        """Return whether noise of the acceleration attenuates a joint's inertia; None: that of any joint."""
        return any(
            x.cause == "acceleration-noise" and not x.slight and joint in (None, x.joint)
            for x in self.faults
        )

    def with_fault(self, fault: Fault) -> PreparedLogs:
        """Return the logs with a fault that spoils them, before all others."""
        return replace(self, faults=(fault, *self.faults), is_spoilt=True, is_reliable=False)

    def is_doubtful(self, finding: Finding, scales: Sequence[ScaleFault]) -> bool:
        """Return whether a fault of the data or a difference of scales stands for a finding.

        Noise of the acceleration hides inertia and gravity, which any smooth function of the motion may then imitate.
        """
        if finding.joint is None:
            return False
        if finding.cause == "torque-gain" and any(finding.joint in x.torques for x in scales):
            return True
        if any(x.makes_physics_unreliable for x in self.faults if x.joint == finding.joint):
            return True
        return self.hides_inertia(finding.joint) and finding.cause not in HARMONICS_OF_ANGLE


def prepare_logs(
    rig: Rig, logs: Sequence[Log], filtering: Filtering | None, settings: Settings
) -> PreparedLogs:
    """Subsample, check and repair logs.

    Args:
        rig: The rig.
        logs: Its logs, with its joints in order.
        filtering: The band that was asked for; None: `choose_band`.
        settings: Constants.
    """
    shown = [subsample_log(log) for log in logs]
    short = [one.log for one in shown]
    if filtering is None:
        filtering = Filtering(cutoff=choose_band(short, settings), smoothing=settings.smoothing)
    checked = [check_log(rig, log, filtering=filtering) for log in short]
    notes = [one.note for one in shown if one.note] + [x for one in checked for x in one.notes]
    reliable = [one for one in checked if one.is_usable and one.is_reliable]
    if reliable and len(reliable) < len(checked):
        left_out = [one for one in checked if one not in reliable]
        notes += [f"{one.log.name} is left out: {one.faults[0].sentence}" for one in left_out]
        checked = reliable
    repaired = tuple(one.log for one in checked)
    usable = all(one.is_usable for one in checked)
    base = greatest_base_motion(rig, repaired)
    beginning = None
    spoiling: list[Fault] = []
    if usable:
        shifts = [(log, find_shifted_torques(rig, log, filtering)) for log in repaired]
        times = (find_time_fault(log, found) for log, found in shifts)
        late = next((fault for fault in times if fault is not None), None)
        beginning = fit_beginning(rig, repaired, base, limit_cutoff(Filtering(), repaired))
        exchanged = check_assignment_of_logs(*beginning) if beginning else None
        spoiling = [fault for fault in (late, exchanged) if fault is not None]
        if late is None:
            notes += [note for log, found in shifts for note in report_shifts(log, found)]
    return PreparedLogs(
        logs=repaired,
        filtering=filtering,
        base=base,
        beginning=beginning,
        faults=(*spoiling, *(fault for one in checked for fault in one.faults)),
        notes=tuple(notes),
        altered=collect_alterations(checked),
        is_spoilt=bool(spoiling) or not usable,
        is_reliable=all(one.is_reliable for one in checked),
    )


def report_spoilt_logs(rig: Rig, prepared: PreparedLogs, logs: Sequence[Log]) -> Diagnosis:
    """Return the verdict "data": the logs say nothing about physics that could be relied on."""
    given = nominal(rig)
    return Diagnosis(
        rig=rig.name,
        logs=tuple(log.name for log in prepared.logs),
        verdict="data",
        before=given,
        after=given,
        faults=prepared.faults,
        notes=prepared.notes,
        altered=prepared.altered,
        data=tuple(logs),
    )


def check_joints_move(rows: Rows, prepared: PreparedLogs) -> None:
    """Raise `DataError` if a joint never moved."""
    travel = np.ptp(rows.join("q"), axis=0)
    still = tuple(name for name, size in zip(rows.rig.joints, travel) if size < LEAST_TRAVEL)
    if still:
        raise DataError(
            prepared.logs[0].name,
            "its motion shows nothing of",
            "move every joint: see 'gimbal-pin excite'",
            still,
        )


def check_torque_moves_joints(explanation: Explanation, prepared: PreparedLogs) -> tuple[str, ...]:
    """Return the joints at rest whose torque is noise: neither the model nor a function of the state predicts it.

    ``F = (explained / parameters) / (left / rows)`` of a fit to one joint alone.

    Raises:
        DataError: The torque of a joint has nothing to do with its motion.
    """
    problem = explanation.search.problem
    rows = problem.rows
    joints = problem.rig.joints
    resting = find_joints_asked_to_rest(prepared.logs)
    noisy = list[int]()
    for j in problem.joints:
        columns = explanation.found.first.base[j][rows.inner]
        torque = problem.scale[rows.inner, j]
        coefficients, _, rank, _ = np.linalg.lstsq(columns, torque, rcond=1e-10)
        power = float(np.sum((torque - columns @ coefficients) ** 2))
        explained = (float(torque @ torque) - power) / max(rank, 1)
        each = power / max(len(torque) * float(rows.used[j]), 1.0)
        if (
            explained < problem.settings.min_f_ratio * each + 1e-300
            and explanation.rest[j].predictable == 0.0
        ):
            noisy.append(j)
    idle = tuple(joints[j] for j in noisy if j in resting)
    undriven = tuple(joints[j] for j in noisy if j not in resting)
    if undriven:
        raise DataError(
            "the logs",
            "their torque has nothing to do with the motion of",
            "check the torque's column, sign and time",
            undriven,
        )
    return idle
