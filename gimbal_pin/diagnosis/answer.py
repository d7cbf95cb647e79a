"""From the models of an explanation to findings, their status and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import nan
from typing import Any

import numpy as np

from gimbal_pin.diagnosis.commands import Drive
from gimbal_pin.diagnosis.explanation import Explanation
from gimbal_pin.diagnosis.interpret import size_finding
from gimbal_pin.diagnosis.mount import Mount, measure_tilt
from gimbal_pin.diagnosis.problem import SHIFT, build_problem
from gimbal_pin.diagnosis.rest import Rest
from gimbal_pin.diagnosis.result import Finding, Rival
from gimbal_pin.diagnosis.rivals import Contest, is_close, list_contests, weigh, weigh_gains
from gimbal_pin.diagnosis.score import Pack, compute_gain, compute_standard_error
from gimbal_pin.diagnosis.search import Hit, Search, Solution, sum_squares_by_fold
from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.diagnosis.structure import measure_curve
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import ActuatorLag, BaseTilt, Cause, Delay, Term
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.log.log import Array

DELAY_PASSES = 3
"""Fits until a delay's column is built for the time that it is fitted at."""
OWN_FUNCTIONS = {
    "cable-spring": ("angle", "places"),
    "cogging": ("angle", "places"),
    "position-dependent-friction": ("angle by direction", "places by direction"),
    "stribeck": ("rate",),
    "quadratic-drag": ("rate",),
    "asymmetric-friction": ("rate",),
    "load-dependent-friction": ("load", "fine load"),
    "torque-gain": ("load", "fine load"),
    "torque-ripple": ("torques over angle", "load and angle"),
    "presliding": ("hysteresis",),
    "friction-drift": ("slow time",),
}
"""Name of a cause → groups of functions of its own variable in the flexible model."""


def list_findings(explanation: Explanation) -> list[Finding]:
    """Return what an explanation found, the strongest first; causes that others made needless are left out."""
    search = explanation.search
    final = explanation.found.final
    covariance = final.fit.covariance
    findings = [
        _describe_contest(explanation, contest, covariance)
        for contest in list_contests(search, final, explanation.found.shelves)
        if _is_needed(search, contest)
        and not (explanation.mount is not None and contest.name == BaseTilt.name)
    ]
    findings += _list_shifts(explanation, covariance)
    findings += [_describe_drive(explanation, drive) for drive in explanation.commands]
    if explanation.mount is not None:
        findings.append(_describe_mount(explanation, explanation.mount))
    if search.problem.reduction.base != "fixed" and explanation.mount is None:
        findings += _list_platform_motion(search, final)
    return sorted(findings, key=lambda one: one.after / max(one.before, 1e-300))


def choose_verdict(findings: Sequence[Finding], rest: Sequence[Rest]) -> str:
    """Return the verdict in one word."""
    if any(one.status == "named" for one in findings):
        return "named"
    if any(one.is_stated for one in findings):
        return "ambiguous"
    return "unknown" if findings or any(one.is_unknown for one in rest) else "nothing"


def _is_needed(search: Search, contest: Contest) -> bool:
    """Return whether a finding's gain beside all others is clear."""
    total = float(contest.gain.sum())
    error = float(compute_standard_error(contest.gain))
    return total >= max(search.problem.settings.kept_nats, search.count_deviations(1) * error)


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Gains and errors that a finding is judged by.

    Attributes:
        gain: Held-out gain by fold, nats, (K,).
        probability: Its probability among itself and all rivals.
        joint: Number of the joint whose error is stated.
        before: Held-out error there without it, N m.
        share: Share of the predictable error power there that it explains.
        rivals: Its rivals.
        alike: Names of causes that are not told from it, without its own.
    """

    gain: Array
    probability: float
    joint: int
    before: float
    share: float
    rivals: tuple[Rival, ...]
    alike: tuple[str, ...]


def _build_finding(
    explanation: Explanation,
    cause: str,
    place: str | None,
    evidence: _Evidence,
    parameters: tuple[Parameter, ...],
    physical: Term | Cause | None,
    *,
    is_misshapen: bool = False,
) -> Finding:
    """Return a finding with its status."""
    settings = explanation.search.problem.settings
    rig = explanation.search.problem.rig
    status = "ambiguous" if evidence.alike else "named"
    if evidence.share < settings.name_share or is_misshapen:
        status = "unconfirmed"
    return Finding(
        cause=cause,
        joint=place,
        status=status,
        alike=(cause, *evidence.alike),
        probability=evidence.probability,
        parameters=tuple(replace(p, unit=rig.in_units(place, p.unit)) for p in parameters),
        nats=float(evidence.gain.sum()),
        std=float(compute_standard_error(evidence.gain)),
        at=rig.joints[evidence.joint],
        before=evidence.before,
        after=float(explanation.found.final.errors[evidence.joint]),
        share=evidence.share,
        rivals=evidence.rivals,
        physical=physical,
    )


def _list_rivals(
    gain: Array, probabilities: Sequence[float], hits: Sequence[Hit]
) -> tuple[Rival, ...]:
    """Return the rivals of a finding, the nearest first."""
    rivals = list[Rival]()
    for hit, chance in zip(hits, probabilities[1:]):
        difference = gain - hit.by_fold
        error = float(compute_standard_error(difference))
        rivals.append(Rival(hit.candidate.name, float(difference.sum()), error, chance))
    return tuple(sorted(rivals, key=lambda one: one.nats))


def _list_alike(search: Search, rivals: Sequence[Rival]) -> tuple[str, ...]:
    """Return the names of rivals that a finding is not told from, the most probable first."""
    close = [one for one in rivals if is_close(search, one.nats, one.std, one.probability)]
    return tuple(one.cause for one in sorted(close, key=lambda one: -one.probability))


def _describe_contest(explanation: Explanation, contest: Contest, covariance: Array) -> Finding:
    """Return a cause that was accepted as a finding."""
    search = explanation.search
    problem = search.problem
    final = explanation.found.final
    j = contest.joint
    rest = explanation.rest[j]
    before = float(contest.without.errors[j])
    after = float(final.errors[j])
    curve = _measure_curve(explanation, j, contest.name)
    share = compute_share(before, curve * after, rest)
    if contest.own[0].cause.of_given_model:
        share = max(share, _compute_prior_share(contest.without, final))
    rivals = _list_rivals(contest.gain, contest.probabilities, contest.rivals)
    alike = _list_alike(search, rivals)
    alike += tuple(name for name in _list_blurred(search, contest) if name not in alike)
    sized = size_finding(problem, final, contest.own, covariance)
    explained = float(np.sqrt(max(before**2 - after**2, 0.0)))
    evidence = _Evidence(contest.gain, contest.probabilities[0], j, before, share, rivals, alike)
    return _build_finding(
        explanation,
        contest.name,
        contest.place if contest.place in problem.rig.joints else None,
        evidence,
        sized.parameters,
        sized.physical,
        is_misshapen=curve == 1.0 and is_misshapen(contest.name, explained, rest, problem.settings),
    )


def _measure_curve(explanation: Explanation, joint: int, name: str) -> float:
    """Return the share of the final error, rms, that a curve of a cause's own variable leaves."""
    return measure_curve(explanation.search, explanation.found.final, joint, name)


def is_misshapen(name: str, explained: float, rest: Rest, settings: Settings) -> bool:
    """Return whether another function of a cause's own variable predicts more than the error of the cause's form."""
    groups = OWN_FUNCTIONS.get(name, ())
    is_own = bool(rest.groups) and rest.groups[0] in groups
    return is_own and rest.predictable > settings.cause_form_error * explained


def _compute_prior_share(before: Solution, after: Solution) -> float:
    """Return the share of the prior's squares that a change of bodies takes away: what makes others unnecessary."""
    return 1.0 - after.fit.prior_squares / max(before.fit.prior_squares, 1e-300)


def _list_blurred(search: Search, contest: Contest) -> tuple[str, ...]:
    """Return causes whose other forms look like a finding on so little of the range as the logs show."""
    joint = contest.own[0].joint
    if joint is None:
        return ()
    cause: Any = reduce(lambda a, b: a.joined(b), (one.cause for one in contest.own))
    return tuple(cause.blurred(search.problem.ranges[joint]))


def compute_share(before: float, after: float, rest: Rest) -> float:
    """``(e_0² - e_1²)/(e_0² - e_min²)``: share of the predictable error power that a finding explains."""
    least = rest.left**2 - rest.suspected**2
    explained = max(before**2 - after**2, 0.0)
    return explained / max(before**2 - min(least, after**2), 1e-300)


def _list_shifts(explanation: Explanation, covariance: Array) -> list[Finding]:
    """Return torques that act later than logged by more than the channels of one logger are apart."""
    problem = explanation.search.problem
    settings = problem.settings
    fit = explanation.found.final.fit
    n = problem.rig.n
    places = [problem.get_own_columns(j).start + SHIFT for j in problem.joints]
    shifts = fit.theta[places]
    std = np.sqrt(np.diag(covariance)[places])
    common = float(np.median(shifts)) if n >= 3 else 0.0
    findings = list[Finding]()
    for j in problem.joints:
        least = settings.shift_seconds + 2 * std[j]
        apart = settings.shift_apart_seconds + 2 * std[j]
        is_late = shifts[j] > least or (n >= 3 and min(shifts[j], shifts[j] - common) > apart)
        if is_late:
            findings += _describe_shift(explanation, j, float(shifts[j]), float(std[j]))
    return findings


def _describe_shift(
    explanation: Explanation, joint: int, shift: float, std: float
) -> list[Finding]:
    """Return a late torque as a delay or a lag, or as either; nothing where its gain is not clear."""
    search = explanation.search
    solution = explanation.found.final
    problem = search.problem
    place = problem.get_own_columns(joint).start + SHIFT
    without = search.fit_without(solution, (), [place])
    lag = without.fit.measure(search.pack_rows({joint: solution.base[joint][:, [place]]}))
    time = shift
    for _ in range(DELAY_PASSES):
        delay = without.fit.measure(_pack_delay(search, solution, joint, time))
        time = float(delay.coefficients[0, 0])
    gains = {Delay: delay.by_fold[0], ActuatorLag: lag.by_fold[0]}
    times = {Delay: time, ActuatorLag: float(lag.coefficients[0, 0])}
    kind, other = sorted(gains, key=lambda x: -float(gains[x].sum()))
    gain = gains[kind]
    error = float(compute_standard_error(gain))
    if gain.sum() < max(problem.settings.gain_nats, search.least_deviations * error):
        return []
    chances = weigh_gains(np.array([gain, gains[other]]), np.zeros(2))
    difference = gain - gains[other]
    rival = Rival(
        other.name,
        float(difference.sum()),
        float(compute_standard_error(difference)),
        chances[1],
    )
    before = float(without.errors[joint])
    share = compute_share(before, float(solution.errors[joint]), explanation.rest[joint])
    cause = kind.inside(problem.rig.joints[joint], times[kind])
    shape = cause.shapes[0]
    parameter = Parameter(shape.name, times[kind], shape.unit, shape.lower, shape.upper, std)
    evidence = _Evidence(
        gain, chances[0], joint, before, share, (rival,), _list_alike(search, [rival])
    )
    return [
        _build_finding(
            explanation, kind.name, problem.rig.joints[joint], evidence, (parameter,), cause
        )
    ]


def _pack_delay(search: Search, solution: Solution, joint: int, time: float) -> Pack:
    """Return the column of a delay, ``(T(t + d) - T(t))/d``: its coefficient is the time d where that is the delay."""
    time = float(np.clip(time, 1e-3, 0.05))
    rows = search.problem.rows
    ahead = [
        (np.interp(part.time + time, part.time, x[:, joint]) - x[:, joint]) / time
        for part, x in zip(rows.stretches, solution.torque)
    ]
    return search.pack_rows({joint: rows.project(ahead, joint)})


def _describe_drive(explanation: Explanation, drive: Drive) -> Finding:
    """Return a drive that acts on the command as a finding."""
    search = explanation.search
    problem = search.problem
    candidate = drive.hit.candidate
    assert candidate.joint is not None
    j = candidate.joint
    others = dict[str, Hit]()
    for other in drive.others:
        others.setdefault(other.candidate.name, other)
    hits = list(others.values())
    chances = weigh(drive.hit.by_fold, candidate.log_prior, hits)
    rivals = _list_rivals(drive.hit.by_fold, chances, hits)
    after = float(explanation.found.final.errors[j])
    curve = _measure_curve(explanation, j, candidate.name)
    share = compute_share(drive.before, curve * after, explanation.rest[j])
    evidence = _Evidence(
        drive.gain, chances[0], j, drive.before, share, rivals, _list_alike(search, rivals)
    )
    joint = problem.rig.joints[j]
    parameters = candidate.cause.shown()
    return _build_finding(explanation, candidate.name, joint, evidence, parameters, candidate.cause)


def _describe_mount(explanation: Explanation, mount: Mount) -> Finding:
    """Return another direction of gravity as a finding: what the model gains over one that stands as the URDF says."""
    search = explanation.search
    problem = search.problem
    final = explanation.found.final
    upright = explanation.upright
    assert upright is not None
    fit = final.fit
    gain = compute_gain(
        sum_squares_by_fold(problem, upright), sum_squares_by_fold(problem, final), fit.rows
    )
    lowered = (upright.errors**2 - final.errors**2) / problem.torque_rms**2
    j = int(np.argmax(lowered))
    before = float(upright.errors[j])
    share = compute_share(before, float(final.errors[j]), explanation.rest[j])
    tilt = measure_tilt(search, final, mount)
    parameters = tuple(replace(p, std=tilt.std.get(p.name, nan)) for p in tilt.cause.shown())
    evidence = _Evidence(gain, 1.0, j, before, share, (), ())
    return _build_finding(explanation, tilt.cause.name, None, evidence, parameters, tilt.cause)


def _list_platform_motion(search: Search, solution: Solution) -> list[Finding]:
    """Return the motion of the base as a finding, where the model that has it by its IMU predicts better than without.

    The model without it takes the base to stand as the URDF says.
    """
    problem = search.problem
    rows = problem.rows
    settings = problem.settings
    still = [None] * len(rows.stretches)
    stands = build_problem(rows, reduce_parameters(problem.rig), settings, still)
    own = [one for one in solution.accepted if one.joint is not None]
    without = Search(stands, search.whitening, ()).solve(own)
    gain = compute_gain(without.fit.squared_errors, solution.fit.squared_errors, solution.fit.rows)
    error = float(compute_standard_error(gain))
    total = float(gain.sum())
    lowered = np.sqrt(np.maximum(without.errors**2 - solution.errors**2, 0.0))
    j = int(np.argmax(lowered / problem.torque_rms))
    is_material = lowered[j] > settings.material_share * problem.torque_rms[j]
    if total < settings.gain_nats or total < search.least_deviations * error or not is_material:
        return []
    motion = [part.samples.platform for part in rows.stretches if part.samples.platform]
    rate = float(np.sqrt(np.mean(np.concatenate([np.sum(x.w**2, axis=1) for x in motion]))))
    apart = np.concatenate([x.f + problem.rig.model.gravity.linear for x in motion])
    force = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
    return [
        Finding(
            cause="platform-motion",
            joint=None,
            status="named",
            alike=("platform-motion",),
            probability=1.0,
            parameters=(Parameter("rate", rate, "rad/s"), Parameter("force", force, "m/s^2")),
            nats=total,
            std=error,
            at=problem.rig.joints[j],
            before=float(without.errors[j]),
            after=float(solution.errors[j]),
            share=1.0,
        )
    ]
