"""Logs in, what the simulation gets wrong out."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.checks import CheckedLog, Fault, check_log, compare_scales
from gimbal_pin.checks.channel_assignment import check_assignment_of_logs, fit_beginning
from gimbal_pin.checks.torque_time import find_shifted_torques, find_time_fault, report_shifts
from gimbal_pin.diagnosis.agreement import find_disagreement
from gimbal_pin.diagnosis.band import alternate_blocks, choose_band
from gimbal_pin.diagnosis.counterfactual import add_sensor_findings
from gimbal_pin.diagnosis.engine import Explained, explain
from gimbal_pin.diagnosis.engine.alignment import retimed
from gimbal_pin.diagnosis.evidence import Evidence, gather, gather_for_judgement
from gimbal_pin.diagnosis.findings import report_findings, report_unusable_logs
from gimbal_pin.diagnosis.given_model import compare_given_model, state_payload_with_causes
from gimbal_pin.diagnosis.result import Diagnosis
from gimbal_pin.diagnosis.reversals import open_turns
from gimbal_pin.diagnosis.state import Problem, solve_causes
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import CAUSES, Cause
from gimbal_pin.errors import DataError
from gimbal_pin.identification import greatest_base_motion, split_logs
from gimbal_pin.identification.validation import LEAST_JUDGED_SHARE
from gimbal_pin.log.io.columns import LEAST_TRAVEL, find_joints_asked_to_rest
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering, limit_cutoff, subsample_log
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.types import Rng

DRIVEN = 5.0
"""Least F by which the rigid model and friction must explain a joint's torque."""


@limit_to_one_thread()
@check_arguments
def diagnose(
    rig: Rig,
    logs: Log | Sequence[Log],
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    rng: Rng = None,
    holdout: str | None = None,
    filtering: Filtering | None = None,
    mass: float | None = None,
) -> Diagnosis:
    """Say what the refitted rigid model with Coulomb and viscous friction gets wrong, and why.

    Long logs are subsampled, see `samples.subsample_log`; a note says how. The band is `band.choose_band` where no
    filtering is given. `rng` has no effect: nothing is drawn at random.

    Args and errors: as `diagnose_short_logs`; `logs`: one or several; `mass`: of the payload, kg, where it was weighed.
    """
    logs = [log.ordered(rig) for log in ([logs] if isinstance(logs, Log) else logs)]
    shown = [subsample_log(log) for log in logs]
    band = choose_band(rig, logs) if filtering is None else filtering
    found = diagnose_short_logs(rig, [one.log for one in shown], causes, holdout, band)
    filters = (
        None
        if filtering is None or filtering.alignment is None
        else Filtering(alignment=filtering.alignment)
    )
    given = state_payload_with_causes(found, rig, logs, holdout, filters, mass)
    notes = (*(one.note for one in shown if one.note), *found.notes)
    return replace(found, given=given, notes=notes, data=tuple(logs))


def diagnose_short_logs(
    rig: Rig,
    logs: Sequence[Log],
    causes: Mapping[str, type[Cause]],
    holdout: str | None,
    filtering: Filtering,
) -> Diagnosis:
    """Diagnose logs of some minutes at most.

    Everything is chosen and fitted on the training part; the held-out part is touched once, for the gain.

    Args:
        rig: The rig.
        logs: Its logs.
        causes: The causes to look for.
        holdout: As in `identify`.
        filtering: The band; its cutoff is the highest frequency looked at.

    Raises:
        DataError: The logs are too short, or a joint never moved.
        LogError: A log lacks a joint of the rig.
    """
    checked = [check_log(rig, log, filtering=filtering) for log in logs]
    whole = holdout is None and len(logs) == 1  # its blocks are parted
    mended = [one.log for one in checked]
    train, test = (mended, ()) if whole else split_logs(mended, holdout, filtering)[:2]
    fitted = {log.name for log in train}
    checked = [one if one.log.name in fitted else one.judged_only() for one in checked]
    reliable = all(one.is_reliable for one in checked)
    shifts = [(log, find_shifted_torques(rig, log, filtering)) for log in mended]
    late = next(
        (fault for log, found in shifts if (fault := find_time_fault(log, found)) is not None), None
    )
    if late is not None or not all(one.is_usable for one in checked):
        return report_unusable_logs(
            rig, logs, checked if late is None else with_fault(checked, late), filtering
        )
    noticed = tuple(note for log, found in shifts for note in report_shifts(log, found))
    try:
        said = diagnose_checked_logs(
            rig, logs, causes, filtering, Parted(checked, train, test, whole)
        )
    except DataError:
        if reliable:
            raise
        return report_unusable_logs(rig, logs, checked, filtering)
    return replace(said, notes=(*said.notes, *noticed))


class Parted(NamedTuple):
    """Checked logs, and what of them is fitted.

    Attributes:
        checked: Every log.
        train: Logs, or parts of them, that are fitted.
        test: What is reported on.
        whole: Whether alternate blocks of the one log are parted instead.
    """

    checked: Sequence[CheckedLog]
    train: Sequence[Log]
    test: Sequence[Log]
    whole: bool


def diagnose_checked_logs(
    rig: Rig,
    logs: Sequence[Log],
    causes: Mapping[str, type[Cause]],
    filtering: Filtering,
    parted: Parted,
) -> Diagnosis:
    """Diagnose logs that were checked and mended; arguments and errors as in `diagnose_short_logs`."""
    checked, train, test, whole = parted
    wholes = {one.log.name: one.log for one in checked}
    evidence = gather(rig, train, filtering, wholes)
    check_moved(evidence, train[0].name)
    base = greatest_base_motion(rig, train)
    beginning = fit_beginning(rig, train, base, limit_cutoff(Filtering(), train))
    exchanged = check_assignment_of_logs(*beginning) if beginning else None
    if exchanged is not None:
        return report_unusable_logs(rig, logs, with_fault(checked, exchanged), filtering)
    held = gather_for_judgement(rig, test, filtering, wholes) if test else evidence
    if np.all(held.used < LEAST_JUDGED_SHARE):
        raise DataError(
            test[0].name,
            "no joint moves where the gain is to be judged",
            "give another --holdout",
            rig.joints,
        )
    reduction = reduce_parameters(rig, base=base)
    fitted = alternate_blocks(evidence, filtering)[0] if whole else evidence
    if np.all(fitted.used < LEAST_JUDGED_SHARE):
        what = "moves in hardly a sample of the part that is fitted to, by the filters' memory"
        raise DataError(
            train[0].name, what, "record longer, faster, or more samples a second", rig.joints
        )
    gliding = solve_causes(Problem.of(fitted, reduction), ())
    evidence, held = (open_turns(one, gliding, filtering) for one in (evidence, held))
    if whole:
        evidence, held = alternate_blocks(evidence, filtering)
    found = explain(evidence, reduction, of_refitted(causes), timed=filtering.alignment is None)
    apart = find_disagreement(rig, [one.log for one in checked], filtering, found.final.causes)
    if apart is not None:
        return report_unusable_logs(rig, logs, with_fault(checked, apart), filtering)
    idle = check_torque_moves_joints(found, find_joints_asked_to_rest(train))
    resting = tuple(
        f"{joint}: not excited, as its reference asks for rest: nothing is said of it"
        for joint in idle
    )
    held = retimed(held, found.alignment)
    said = report_findings(found, held, checked, filtering)
    scaled = compare_scales(*beginning) if beginning else ()
    another = [joint for one in scaled for joint in one.torques]
    findings = [
        one for one in said.findings if not (one.cause == "torque-gain" and one.joint in another)
    ]
    statements = (*(one.sentence for one in scaled), *said.statements)
    said = replace(said, statements=statements)
    notes = (*said.notes, *resting, *(unjudged(held) if held is not evidence else ()))
    said = replace(said, idle=idle, notes=notes, findings=tuple(findings))
    state = said.state
    assert state is not None
    said = add_sensor_findings(said, checked, train, test, filtering)
    return compare_given_model(said, state, causes)


def of_refitted(causes: Mapping[str, type[Cause]]) -> dict[str, type[Cause]]:
    """Leave out what compares the given model with the data: the refitted one has taken that up."""
    return {name: kind for name, kind in causes.items() if not kind.of_given_model}


def with_fault(checked: Sequence[CheckedLog], fault: Fault) -> list[CheckedLog]:
    """Put a fault of all logs before those of the first."""
    return [replace(checked[0], faults=(fault, *checked[0].faults)), *checked[1:]]


def unjudged(held: Evidence) -> list[str]:
    """Say of which joints the held-out part shows nothing, so that no error there is one."""
    dumb = [joint for joint, used in zip(held.rig.joints, held.used) if used < LEAST_JUDGED_SHARE]
    what = "in the held-out part hardly a sample tells its direction: its errors before and after say nothing"
    return [f"{', '.join(dumb)}: {what}; give another --holdout"] if dumb else []


def check_moved(evidence: Evidence, name: str) -> None:
    """Raise `DataError` if a joint never moved."""
    joints = evidence.rig.joints
    still = tuple(joint for joint, seen in zip(joints, evidence.seen) if seen.travel < LEAST_TRAVEL)
    if still:
        raise DataError(
            name, "its motion shows nothing of", "move every joint: see 'gimbal-pin excite'", still
        )
    dumb = tuple(joint for joint, used in zip(joints, evidence.used) if used < LEAST_JUDGED_SHARE)
    if dumb:
        what = "so slow, or turning round so often, that hardly a sample tells its direction"
        raise DataError(name, what, "move faster; of a loop that swings, lower its gains", dumb)


def check_torque_moves_joints(found: Explained, resting: Collection[int]) -> tuple[str, ...]:
    """Return the joints at rest whose torque is noise; raise `DataError` if another joint's torque is.

    Of a joint whose reference asks for rest that is no wonder.

    ``F = (explained / parameters) / (left / rows)`` of a fit to that joint alone: noise gives one, any rig hundreds.
    Where a function of the state predicts what is left, it is not noise, but unknown.
    """
    now = found.first.fit
    evidence = found.first.problem.evidence
    dumb = list[str]()
    for j, joint in enumerate(evidence.rig.joints):
        columns = now.stack[now.rows(j)]
        torque = now.target[now.rows(j)]
        columns = columns[:, np.any(columns != 0, axis=0)]
        left = torque - columns @ np.linalg.lstsq(columns, torque, rcond=1e-10)[0]
        rest = max(float(left @ left), 1e-300) / max(evidence.rows * float(evidence.used[j]), 1.0)
        explained = (float(torque @ torque) - float(left @ left)) / max(columns.shape[1], 1)
        if explained < DRIVEN * rest and not found.structured[j]:
            dumb.append(joint)
    idle = tuple(evidence.rig.joints[j] for j in resting if evidence.rig.joints[j] in dumb)
    if len(dumb) > len(idle):
        what, mend = (
            "their torque has nothing to do with the motion of",
            "check the torque's column, sign and time",
        )
        raise DataError("the logs", what, mend, tuple(joint for joint in dumb if joint not in idle))
    return idle
