"""Logs in, what the simulation gets wrong out: prepare → rows → noise and search → findings → held out → verdict."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from gimbal_pin.checks import compare_scales
from gimbal_pin.diagnosis.answer import choose_verdict, list_findings
from gimbal_pin.diagnosis.explanation import Explanation, choose_explanation
from gimbal_pin.diagnosis.given_model import compare_given_model, state_payload_with_causes
from gimbal_pin.diagnosis.held_out import measure_held_out
from gimbal_pin.diagnosis.model import build_model
from gimbal_pin.diagnosis.prepare import (
    PreparedLogs,
    check_joints_move,
    check_torque_moves_joints,
    prepare_logs,
    report_spoilt_logs,
)
from gimbal_pin.diagnosis.rest import Rest, describe_rest
from gimbal_pin.diagnosis.result import Candidate, Diagnosis, Finding, Residual, Slight
from gimbal_pin.diagnosis.rows import build_rows
from gimbal_pin.diagnosis.search import Solution
from gimbal_pin.diagnosis.settings import SETTINGS, Settings
from gimbal_pin.diagnosis.several import find_disagreement
from gimbal_pin.diagnosis.uncertainty import compute_covariance
from gimbal_pin.diagnosis.visibility import get_joint
from gimbal_pin.dynamics.model import is_parameter
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import RigEffect
from gimbal_pin.errors import DataError, UsageError
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.rig import Rig


@limit_to_one_thread()
@check_arguments
def diagnose(
    rig: Rig,
    logs: Log | Sequence[Log],
    *,
    holdout: str | None = None,
    filtering: Filtering | None = None,
    mass: float | None = None,
    settings: Settings = SETTINGS,
) -> Diagnosis:
    """Find what the refitted rigid model with dry and viscous friction gets wrong, and name the cause.

    Args:
        rig: The rig.
        logs: One log or several, with torques.
        holdout: Rows that only the shown errors are taken from: "last-third", "log:N" for the N-th log, or "none".
            None: every fifth block of logs of 25 s and more.
        filtering: Its cutoff is the highest frequency that is looked at, its alignment the known delay of the torque.
            None: 12 Hz, a fifth of the sampling rate where that is less, or more where teeth are heard above.
        mass: Mass of the payload where it was weighed, kg.
        settings: Constants that decide what is found.

    Returns:
        Verdict, findings, extended model and held-out errors.

    Raises:
        DataError: The logs are too short, or a joint never moved.
        LogError: A log lacks a joint of the rig, or torques.
    """
    given = [log.ordered(rig) for log in ([logs] if isinstance(logs, Log) else logs)]
    prepared = prepare_logs(rig, given, filtering, settings)
    if prepared.is_spoilt:
        return report_spoilt_logs(rig, prepared, given)
    try:
        timed = replace(prepared.filtering, smoothing=settings.smoothing)
        kept = find_kept_log(holdout, given, prepared.logs)
        rows = build_rows(rig, prepared.logs, timed.cutoff, settings, kept, timed)
        if kept != holdout:
            rows = replace(rows, how=f"{str(holdout).replace(':', ' ')} of {len(given)}")
        check_joints_move(rows, prepared)
        explanation = choose_explanation(rig, rows, prepared.base, settings)
        idle = check_torque_moves_joints(explanation, prepared)
    except DataError:
        if prepared.is_reliable:
            raise
        return report_spoilt_logs(rig, prepared, given)
    disagreement = find_disagreement(explanation, prepared)
    if disagreement is not None:
        return report_spoilt_logs(rig, prepared.with_fault(disagreement), given)
    diagnosis = describe_explanation(explanation, prepared, idle)
    notes = (*diagnosis.notes, *compare_given_model(diagnosis, explanation, prepared))
    diagnosis = replace(diagnosis, notes=notes, data=tuple(given), mass=mass)
    if mass is not None:
        # A mass in another unit is refused here, not where the payload is read.
        state_payload_with_causes(explanation, diagnosis.after, mass)
    return diagnosis


def find_kept_log(holdout: str | None, given: Sequence[Log], kept: Sequence[Log]) -> str | None:
    """Return ``log:N`` of the given logs as that of those that are kept; any other holdout as it is.

    Raises:
        UsageError: The log is not kept.
    """
    match = re.fullmatch(r"log:(\d+)", holdout or "")
    if match is None or len(kept) == len(given) or not 1 <= int(match[1]) <= len(given):
        return holdout
    names = [log.name for log in kept]
    name = given[int(match[1]) - 1].name
    if name not in names:
        raise UsageError("--holdout", f"{name} is left out as unreliable", "hold out another log")
    return f"log:{names.index(name) + 1}"


def describe_explanation(
    explanation: Explanation, prepared: PreparedLogs, idle: tuple[str, ...] = ()
) -> Diagnosis:
    """Return the diagnosis of logs whose models are known; `idle`: joints of which nothing is said."""
    search = explanation.search
    problem = search.problem
    original = explanation.original
    rig = problem.rig
    scales = compare_scales(*prepared.beginning) if prepared.beginning else ()
    findings = list_findings(explanation)
    findings = [one for one in findings if not prepared.is_doubtful(one, scales)]
    findings, extended = keep_possible_bodies(explanation, findings)
    stated = [one for one in findings if one.is_stated]
    places = {one.at for one in stated}
    # A gain that is found says itself what a torque in another unit would.
    scales = tuple(one for one in scales if not one.torques or not places.issuperset(one.torques))
    is_final = extended is explanation.found.final
    rest = explanation.rest if is_final else tuple(describe_rest(search, extended))
    findings = [one for one in findings if not is_parameter(rig, one.physical)]
    verdict = choose_verdict(findings, explanation.rest)
    if prepared.makes_physics_unreliable or (prepared.hides_inertia() and not stated):
        verdict = "data"
    covariance = explanation.covariance if is_final else compute_covariance(search, extended)
    after = build_model(problem, extended, stated, covariance)
    assert after.estimated is not None
    diagnosis = Diagnosis(
        rig=rig.name,
        logs=tuple(log.name for log in prepared.logs),
        verdict=verdict,
        before=build_model(original, explanation.refitted, (), explanation.refitted.fit.covariance),
        after=after,
        faults=prepared.faults,
        notes=prepared.notes,
        statements=tuple(one.sentence for one in scales),
        findings=tuple(findings),
        residual=describe_residuals(explanation, rest),
        idle=idle,
        alignment=dict(zip(rig.joints, after.estimated.lags)),
        held_out=measure_held_out(original, explanation.refitted, extended),
        explanation=explanation,
        altered=prepared.altered,
    )
    if verdict == "nothing" and (scales or diagnosis.unexplained):
        diagnosis = replace(diagnosis, verdict="unknown")
    candidate = find_nearest_candidate(explanation) if diagnosis.verdict == "unknown" else None
    immaterial = list_immaterial(explanation, candidate)
    return replace(diagnosis, candidate=candidate, immaterial=immaterial)


def keep_possible_bodies(
    explanation: Explanation, findings: list[Finding]
) -> tuple[list[Finding], Solution]:
    """Return findings and the model of those that are stated.

    A change of bodies that leaves a mass or an inertia which no body can have is unconfirmed. The model without it
    refits the bodies, which may make another one impossible.
    """
    extended = keep_stated_causes(explanation, findings)
    bodies = build_model(explanation.search.problem, extended, (), extended.fit.covariance).rig
    for place, finding in enumerate(findings):
        try:
            if finding.is_stated and isinstance(finding.physical, RigEffect):
                bodies = finding.physical.apply(bodies)
        except UsageError:
            rejected = replace(finding, status="unconfirmed")
            others = [*findings[:place], rejected, *findings[place + 1 :]]
            return keep_possible_bodies(explanation, others)
    return findings, extended


def keep_stated_causes(explanation: Explanation, findings: Sequence[Finding]) -> Solution:
    """Return the final model without the causes of findings that are not stated."""
    final = explanation.found.final
    places = {(one.cause, one.joint or "rig") for one in findings if one.is_stated}
    kept = [one for one in final.accepted if (one.name, one.place) in places]
    if len(kept) == len(final.accepted):
        return final
    return explanation.search.solve(kept, final)


def describe_residuals(explanation: Explanation, rest: Sequence[Rest]) -> dict[str, Residual]:
    """Return joint → what is left there; `rest`: of the extended model."""
    search = explanation.search
    residuals = dict[str, Residual]()
    for joint, left, floor in zip(search.problem.rig.joints, rest, search.whitening.floor.tolist()):
        over = left.groups[0] if left.groups and left.predictable > 0 else ""
        state = "structured" if left.is_unknown else "noise"
        residuals[joint] = Residual(state, left.left, min(floor, left.left), left.predictable, over)
    return residuals


def list_immaterial(explanation: Explanation, candidate: Candidate | None) -> tuple[Slight, ...]:
    """Return causes that gained clearly and explain less torque than matters, besides the nearest candidate."""
    least = explanation.search.problem.settings.material_share
    rejected = sorted(explanation.found.rejected, key=lambda one: one.share)
    shares = {(x.candidate.name, x.candidate.place): x.share for x in rejected if x.share > 0}
    accepted = {(one.name, one.place) for one in explanation.found.final.accepted}
    if candidate is not None:
        accepted.add((candidate.cause, candidate.joint or "rig"))
    return tuple(
        Slight(name, get_joint(place), share)
        for (name, place), share in shares.items()
        if share < least and (name, place) not in accepted
    )


def find_nearest_candidate(explanation: Explanation) -> Candidate | None:
    """Return the cause beside the final model that gains most; None: none gains anything."""
    search = explanation.search
    final = explanation.found.final
    hits = search.screen(final, explanation.found.shelves)
    best = max(hits, key=lambda hit: hit.gain, default=None)
    if best is None or best.gain <= 0:
        return None
    shares = search.measure_torque(final, best) / search.problem.torque_rms
    at = best.candidate.joint
    share = float(shares.max() if at is None else shares[at])
    return Candidate(best.candidate.name, get_joint(best.candidate.place), share, best.gain)
