"""From the models of an explanation to findings, their status and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from math import nan
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.candidates import Candidate
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.interpret import size_finding
from gimbal_pin.diagnosis.mount import Mount, measure_tilt
from gimbal_pin.diagnosis.problem import SHIFT, build_problem
from gimbal_pin.diagnosis.rest import Rest
from gimbal_pin.diagnosis.result import Finding, Rival
from gimbal_pin.diagnosis.rivals import Contest, is_close, list_contests, weigh
from gimbal_pin.diagnosis.score import compute_gain, compute_standard_error
from gimbal_pin.diagnosis.search import Hit, Search, Solution, sum_squares_by_fold
from gimbal_pin.diagnosis.structure import find_misshapen_causes, measure_curve
from gimbal_pin.diagnosis.uncertainty import size_drive
from gimbal_pin.diagnosis.visibility import get_joint
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import ActuatorLag, BaseTilt, Cause, Delay, Term
from gimbal_pin.effects.delay import LONGEST_DRIVE_DELAY
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array

DELAY_PASSES = 3
"""Fits until a delay's column is built for the time that it is fitted at."""


def list_findings(explanation: Explanation) -> list[Finding]:
    """Return what an explanation found, the strongest first; causes that others made needless are left out."""
    search = explanation.search
    final = explanation.found.final
    covariance = final.fit.covariance
    contests = list_contests(search, final, explanation.found.shelves)
    misshapen = _find_misshapen(search, final, contests)
    findings = [
        _describe_contest(explanation, contest, covariance, contest in misshapen)
        for contest in contests
        if _is_needed(search, contest)
        and not (explanation.mount is not None and contest.name == BaseTilt.name)
    ]
    findings += _list_shifts(explanation, covariance)
    findings += [
        _state_finding(
            explanation,
            drive.hit.candidate.cause,
            drive.hit.candidate.joint or 0,
            drive.before,
            drive.gain,
            size_drive(search, final, drive),
            drive.hit.candidate.cause,
            hits=list({hit.candidate.name: hit for hit in reversed(drive.others)}.values()),
            log_prior=drive.hit.candidate.log_prior,
            compared=drive.hit.by_fold,
        )
        for drive in explanation.commands
    ]
    if explanation.mount is not None:
        findings.append(_describe_mount(explanation, explanation.mount))
    elif search.problem.reduction.base != "fixed":
        findings += _list_platform_motion(explanation)
    return sorted(findings, key=lambda finding: finding.after / max(finding.before, 1e-300))


def choose_verdict(findings: Sequence[Finding], rest: Sequence[Rest]) -> str:
    """Return the verdict in one word."""
    statuses = {finding.status for finding in findings}
    for status in ("named", "ambiguous"):
        if status in statuses:
            return status
    return "unknown" if findings or any(joint_rest.is_unknown for joint_rest in rest) else "nothing"


def _find_misshapen(search: Search, final: Solution, contests: Sequence[Contest]) -> list[Contest]:
    """Return findings that are parts of one other force; offsets and rotors have no other form."""
    misshapen = list[Contest]()
    for joint in search.problem.joints:
        own = [x for x in contests if x.own[0].joint == joint and not x.own[0].is_ordinary]
        flags = find_misshapen_causes(search, final, joint, [x.own for x in own])
        misshapen += [x for x, flag in zip(own, flags) if flag]
    return misshapen


def _is_needed(search: Search, contest: Contest) -> bool:
    """Return whether a finding's gain beside all others is clear."""
    total = float(contest.gain.sum())
    error = float(compute_standard_error(contest.gain))
    return total >= max(search.problem.settings.kept_nats, search.count_deviations(1) * error)


def _state_finding(
    explanation: Explanation,
    cause: Cause | str,
    joint: int,
    before: float,
    gain: Array,
    parameters: Sequence[Parameter],
    physical: Term | Cause | None,
    *,
    hits: Sequence[Hit] = (),
    log_prior: float = 0.0,
    compared: Array | None = None,
    blurred: Sequence[str] = (),
    least_share: float = 0.0,
    is_misshapen: bool = False,
) -> Finding:
    """Return a finding with its status.

    Args:
        explanation: The models.
        cause: The cause; a name: of the whole rig.
        joint: Number of the joint whose error is stated.
        before: Held-out error there without it, N m.
        gain: Its gain by fold, nats, (K,).
        parameters: Its sizes.
        physical: What the extended model holds.
        hits: Its rivals.
        log_prior: Its log prior, nats.
        compared: Its gain by fold that the rivals' are compared with; None: `gain`.
        blurred: Causes that the logs' range does not tell from it, beside the rivals.
        least_share: Share of the predictable error that it explains at least, whatever the errors say.
        is_misshapen: Whether another force predicts clearly better in its place.
    """
    search = explanation.search
    problem = search.problem
    settings = problem.settings
    final = explanation.found.final
    rest = explanation.rest[joint]
    name, place = (cause, None) if isinstance(cause, str) else (cause.name, get_joint(cause.place))
    after = float(final.errors[joint])
    curve = measure_curve(search, final, joint, name)
    share = max(rest.compute_share(before, curve * after), least_share)
    compared = gain if compared is None else compared
    chances = weigh(
        np.array([compared, *(hit.by_fold for hit in hits)]),
        np.array([log_prior, *(hit.candidate.log_prior for hit in hits)]),
    )
    rivals = [
        Rival(
            hit.candidate.name,
            float((compared - hit.by_fold).sum()),
            float(compute_standard_error(compared - hit.by_fold)),
            chance,
        )
        for hit, chance in zip(hits, chances[1:])
    ]
    close = [x for x in rivals if is_close(search, x.nats, x.std, x.probability)]
    close.sort(key=lambda rival: -rival.probability)
    alike = dict.fromkeys((name, *(rival.cause for rival in close), *blurred))
    nats = float(gain.sum())
    std = float(compute_standard_error(gain))
    is_clear = nats >= search.least_deviations * std
    status = "ambiguous" if len(alike) > 1 else "named"
    if share < settings.name_share or is_misshapen or not is_clear:
        status = "unconfirmed"
    return Finding(
        cause=name,
        joint=place,
        status=status,
        alike=tuple(alike),
        probability=chances[0],
        parameters=tuple(replace(p, unit=problem.rig.in_units(place, p.unit)) for p in parameters),
        nats=nats,
        std=std,
        at=problem.rig.joints[joint],
        before=before,
        after=after,
        share=share,
        rivals=tuple(sorted(rivals, key=lambda rival: rival.nats)),
        physical=physical,
    )


def _describe_contest(
    explanation: Explanation, contest: Contest, covariance: Array, is_misshapen: bool
) -> Finding:
    """Return a cause that was accepted as a finding."""
    problem = explanation.search.problem
    final = explanation.found.final
    first = contest.own[0]
    sized = size_finding(explanation.search, final, contest.own, covariance)
    blurred: Sequence[str] = ()
    if first.joint is not None:
        joined: Any = reduce(lambda a, b: a.joined(b), (one.cause for one in contest.own))
        blurred = joined.blurred(problem.ranges[first.joint])
    eased = 0.0
    if first.cause.of_given_model:
        # A change of bodies explains what made other bodies improbable.
        squares = max(contest.without.fit.prior_squares, 1e-300)
        eased = 1.0 - final.fit.prior_squares / squares
    return _state_finding(
        explanation,
        first.cause,
        contest.joint,
        float(contest.without.errors[contest.joint]),
        contest.gain,
        sized.parameters,
        sized.physical,
        hits=contest.rivals,
        log_prior=contest.own[0].log_prior,
        blurred=blurred,
        least_share=eased,
        is_misshapen=is_misshapen,
    )


def _list_shifts(explanation: Explanation, covariance: Array) -> list[Finding]:
    """Return torques that act later than logged by more than the channels of one logger are apart."""
    problem = explanation.search.problem
    settings = problem.settings
    places = [problem.get_own_columns(j).start + SHIFT for j in problem.joints]
    shifts = explanation.found.final.fit.theta[places]
    std = np.sqrt(np.diag(covariance)[places])
    is_late = shifts > settings.shift_seconds + settings.clear_deviations * std
    if problem.rig.n >= 3:
        apart = np.minimum(shifts, shifts - np.median(shifts))
        is_late |= apart > settings.shift_apart_seconds + settings.clear_deviations * std
    return [
        finding
        for j in np.flatnonzero(is_late).tolist()
        for finding in _describe_shift(explanation, j, float(shifts[j]), float(std[j]))
    ]


def _describe_shift(
    explanation: Explanation, joint: int, shift: float, std: float
) -> list[Finding]:
    """Return a late torque as a delay or a lag, or as either; nothing where that is not confirmed."""
    search = explanation.search
    problem = search.problem
    solution = explanation.found.final
    place = problem.get_own_columns(joint).start + SHIFT
    without = search.fit_without(solution, (), [place])

    def measure(kind: type[Delay | ActuatorLag], column: Array) -> Hit:
        gains = without.fit.measure(search.pack_rows({joint: column}))
        time = gains.coefficients[0]
        candidate = Candidate(kind.inside(problem.rig.joints[joint], float(time[0])), joint, 0.0)
        return Hit(candidate, gains.by_fold[0], time)

    lag = measure(ActuatorLag, solution.base[joint][:, [place]])
    time = shift
    for _ in range(DELAY_PASSES):
        delay = measure(Delay, _project_delay(explanation, joint, time))
        time = float(delay.coefficients[0])
    best, other = sorted((delay, lag), key=lambda hit: -hit.gain)
    if not search.is_clear(best, problem.settings.gain_nats):
        return []
    cause = best.candidate.cause
    parameter = replace(cause.shapes[0], value=float(best.coefficients[0]), std=std)
    before = float(without.errors[joint])
    finding = _state_finding(
        explanation, cause, joint, before, best.by_fold, (parameter,), cause, hits=[other]
    )
    return [finding] if finding.is_stated else []


def _project_delay(explanation: Explanation, joint: int, time: float) -> Array:
    """Return the rows ``(T(t + d) - T(t))/d`` of a delay d: their coefficient is d where that is the delay."""
    time = float(np.clip(time, 1e-3, LONGEST_DRIVE_DELAY))
    rows = explanation.search.problem.rows
    torques = [x[:, joint] for x in explanation.found.final.torque]
    ahead = [
        (np.interp(part.time + time, part.time, x) - x) / time
        for part, x in zip(rows.stretches, torques)
    ]
    return rows.project(ahead, joint)


def _describe_mount(explanation: Explanation, mount: Mount) -> Finding:
    """Return another direction of gravity as a finding: what the model gains over one that stands as the URDF says."""
    search = explanation.search
    problem = search.problem
    final = explanation.found.final
    upright = explanation.upright
    assert upright is not None
    left, least = (sum_squares_by_fold(problem, one) for one in (upright, final))
    gain = compute_gain(left, least, final.fit.rows)
    j = int(np.argmax((upright.errors**2 - final.errors**2) / problem.torque_rms**2))
    tilt = measure_tilt(search, final, mount)
    parameters = [replace(p, std=tilt.std.get(p.name, nan)) for p in tilt.cause.shown()]
    before = float(upright.errors[j])
    return _state_finding(explanation, tilt.cause, j, before, gain, parameters, tilt.cause)


def _list_platform_motion(explanation: Explanation) -> list[Finding]:
    """Return the motion of the base as a finding, where the model that has it by its IMU predicts better than without.

    The model without it takes the base to stand as the URDF says.
    """
    search = explanation.search
    problem = search.problem
    solution = explanation.found.final
    rows = problem.rows
    settings = problem.settings
    still = [None] * len(rows.stretches)
    stands = build_problem(rows, reduce_parameters(problem.rig), settings, still)
    own = [one for one in solution.accepted if one.joint is not None]
    without = Search(stands, search.whitening, ()).solve(own)
    gain = compute_gain(without.fit.squared_errors, solution.fit.squared_errors, solution.fit.rows)
    least = search.least_deviations * float(compute_standard_error(gain))
    lowered = np.sqrt(np.maximum(without.errors**2 - solution.errors**2, 0.0)) / problem.torque_rms
    j = int(np.argmax(lowered))
    if gain.sum() < max(settings.gain_nats, least) or lowered[j] <= settings.material_share:
        return []
    motion = [part.samples.platform for part in rows.stretches if part.samples.platform]
    turning = np.concatenate([x.w for x in motion])
    pushing = np.concatenate([x.f + problem.rig.model.gravity.linear for x in motion])
    rate, force = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (turning, pushing))
    sizes = (Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2"))
    before = float(without.errors[j])
    name = "platform-motion"
    return [_state_finding(explanation, name, j, before, gain, sizes, None, least_share=1.0)]
