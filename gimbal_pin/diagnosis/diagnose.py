"""Logs in, what the simulation gets wrong out (DIAGNOSIS)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.calibration import rectified
from gimbal_pin.diagnosis import leftover, verdict
from gimbal_pin.diagnosis.agreement import agreement, alone, outright
from gimbal_pin.diagnosis.audit import Audit, audit
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.extended import Extended, extended, settled
from gimbal_pin.diagnosis.finding import Diagnosis, Finding, Slight, Untestable
from gimbal_pin.diagnosis.followed import followed
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.likeness import likeness
from gimbal_pin.diagnosis.platform_motion import Ridden, ridden
from gimbal_pin.diagnosis.score import flipped
from gimbal_pin.diagnosis.search import (
    FINE,
    Library,
    Problem,
    State,
    forward,
    library,
    polished,
    pruned,
    solved,
    swapped,
    width,
    without,
)
from gimbal_pin.diagnosis.trusted import compared
from gimbal_pin.diagnosis.uncertainty import parameters
from gimbal_pin.effects import CAUSES, Cause
from gimbal_pin.errors import DataError
from gimbal_pin.identification import moved, split, within
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering

BAND = Filtering(cutoff=12.0, smoothing=2.5)
"""Wider than identification's filter: drives and teeth show above 5 Hz, and whitening makes up for the noise there."""
ERROR_RATE = 0.003
"""Chance that a log with nothing in it has anything named, over the whole library."""
FLIPS = 999
DRIVEN = 5.0
"""Least F by which the rigid model and friction must explain a joint's torque."""
STRAYED = 1.1
"""Error of the rollout with a cause over that without it, from which it makes the simulation worse."""
LIVELY = 1e-3
"""Least share of a joint's samples that must be away from standstill."""
MOVED = 0.02
"""Least travel of a joint that can be judged, rad."""


def diagnose(
    rig: Rig,
    logs: Sequence[Log],
    causes: Mapping[str, type[Cause]] = CAUSES,
    *,
    rng: np.random.Generator,
    holdout: str | None = None,
    filtering: Filtering = BAND,
) -> Diagnosis:
    """Say what the refitted rigid model with Coulomb and viscous friction gets wrong, and why.

    Everything is chosen and fitted on the training part; the held-out part is touched once, for the gain.

    Args:
        rig: The rig.
        logs: Its logs.
        causes: The causes to look for.
        rng: For the signs of blocks and their bootstraps.
        holdout: As in `identify`.
        filtering: The band; its cutoff is the highest frequency looked at.

    Raises:
        DataError: The logs are too short, or a joint never moved.
    """
    for log in logs:
        within(log, filtering)
    audits = [audit(rig, rectified(rig, log).log) for log in logs]
    train, test, _ = split([found.log for found in audits], holdout, filtering)
    fitted = {log.name for log in train}
    audits = [found if found.log.name in fitted else found.spared for found in audits]
    if any(not found.reliable for found in audits):
        return spoilt(rig, logs, audits, filtering)
    origins = {log.name: float(log.t[0]) for log in logs}
    evidence = gather(rig, train, filtering, origins)
    check_moved(evidence, train[0].name)
    held = judged(rig, test, filtering, origins) if test else evidence
    if np.all(held.used() < LIVELY):
        raise DataError(
            test[0].name, "no joint moves where the gain is to be judged", "give another --holdout", rig.joints
        )
    each = alone(rig, [one.log for one in audits], filtering)
    apart = outright(rig, each)
    if apart is None:
        found = searched(Problem.of(evidence, reduce(rig, base=moved(rig, train))), causes, rng)
        apart = agreement(rig, each, found.final.causes)
    if apart is not None:
        return spoilt(rig, logs, [replace(audits[0], faults=(apart, *audits[0].faults)), *audits[1:]], filtering)
    found = confirmed(found, held, rng)
    said = reported(found, held, audits, alignment(logs[0], filtering), rng)
    moving = ridden(found.first, held, train, test, filtering)
    return compared(said if moving is None else beside(said, moving), found.final, causes)


def beside(said: Diagnosis, moving: Ridden) -> Diagnosis:
    """Put the motion of the platform beside what was found with it in the model."""
    findings = tuple(sorted((*said.findings, moving.finding), key=lambda one: -one.explained_share))
    statuses = [one.status for one in findings]
    verdict_ = verdict.overall(statuses, tuple(said.residual.values()))
    return replace(said, findings=findings, verdict=verdict_, baseline=moving.baseline)


class Searched(NamedTuple):
    """What the search over the training part ended with.

    Attributes:
        shelf: The library.
        first: The refitted model without any cause.
        state: All that the search found.
        final: What of it deserves a name.
        residual: What is left at each joint.
        slight: What is too small to matter.
        null: Smallest p over the library on flipped residuals, sorted, (flips,).
        doubtful: What fits and deserves no trust.
        denied: What the held-out part did not confirm.
        best: Held-out figures of the model with all that deserves a name.
        lacking: The same without each of its causes.
    """

    shelf: Library
    first: State
    state: State
    final: State
    residual: tuple[leftover.Residual, ...]
    slight: tuple[Slight, ...]
    null: Array
    doubtful: tuple[Cause, ...] = ()
    denied: tuple[Cause, ...] = ()
    best: Figures = MappingProxyType({})
    lacking: tuple[Figures, ...] = ()


def searched(problem: Problem, causes: Mapping[str, type[Cause]], rng: np.random.Generator) -> Searched:
    """Compose causes, prune them, and keep those that deserve a name."""
    first = solved(problem, (), solved(problem, ()))
    check_driven(first)
    shelf = Library(problem, library(problem, comparable(causes)))
    state = polished(swapped(forward(first, shelf), shelf))
    null = flipped(state.fit, shelf.columns(state), rng, FLIPS)
    limit = float(np.quantile(null, ERROR_RATE))
    state, small = pruned(state, limit, verdict.material)
    state = polished(state, step=FINE)
    doubtful = tuple(cause for cause in state.causes if verdict.doubtful(first, state, cause))
    residual = left_over(state, doubtful, rng)
    trusted = [cause for cause in state.causes if cause not in doubtful and not verdict.minor(state, cause)]
    final = state if len(trusted) == len(state.causes) else solved(problem, trusted, state)
    return Searched(shelf, first, state, final, residual, verdict.slight(final, small), null, doubtful)


def left_over(state: State, doubtful: Sequence[Cause], rng: np.random.Generator) -> tuple[leftover.Residual, ...]:
    """What is left at each joint: never noise where something was found that deserves no trust."""
    joints = state.problem.evidence.rig.joints
    return tuple(doubted(left, joint, doubtful) for left, joint in zip(leftover.judge(state, rng), joints))


def confirmed(found: Searched, held: Evidence, rng: np.random.Generator) -> Searched:
    """Drop what the held-out part denies, the weakest first.

    Without it the torque there is predicted as well, or the simulation follows the measured angles better. Nothing is
    ever added or fitted there. What is left is judged again with all else that was found.
    """
    final, denied = found.final, list[Cause]()
    while True:
        best = measured(held, extended(final))
        lacking = [measured(held, extended(without(final, cause))) for cause in final.causes]
        rows = [(confirmation(best, one, held, cause), i) for i, (one, cause) in enumerate(zip(lacking, final.causes))]
        ratio, weakest = min(rows, default=(np.inf, 0))
        if ratio > CONFIRMED:
            break
        denied.append(final.causes[weakest])
        final = solved(final.problem, [c for i, c in enumerate(final.causes) if i != weakest], final)
    found = found._replace(final=final, denied=tuple(denied), best=best, lacking=tuple(lacking))
    if not denied:
        return found
    rest = solved(found.state.problem, [c for c in found.state.causes if c not in denied], found.state)
    return found._replace(residual=left_over(rest, found.doubtful, rng))


def confirmation(best: Figures, lacking: Figures, held: Evidence, cause: Cause) -> float:
    """Torque error without a cause over that with it, where that is most; zero where with it the rollout is worse."""
    own = [cause.place] if cause.of_joint else list(held.rig.joints)
    strayed, without_ = (np.linalg.norm([one["rollout_rmse"][joint] for joint in own]) for one in (best, lacking))
    if strayed > STRAYED * without_:
        return 0.0
    return max(lacking["torque_rmse"][joint] / best["torque_rmse"][joint] for joint in own)


def reported(
    found: Searched, held: Evidence, audits: Sequence[Audit], hold: float, rng: np.random.Generator
) -> Diagnosis:
    """Measure the gain on the held-out part, and put it all together."""
    joints, state = held.rig.joints, found.state
    before, after = extended(found.first), extended(found.final)
    baseline = measured(held, before)
    hidden = verdict.untestable(found.first, found.shelf)
    rows = zip(found.final.causes, found.lacking, strict=True)
    each = combined([finding(found, *row, held, baseline, hidden, rng) for row in rows])
    return Diagnosis(
        rig=held.rig.name,
        logs=tuple(one.log.name for one in audits),
        verdict=verdict.overall([one.status for one in each], found.residual),
        faults=tuple(fault for one in audits for fault in one.faults),
        notes=(*(note for one in audits for note in one.notes), *map(denial, found.denied)),
        findings=tuple(sorted(each, key=lambda one: -one.explained_share)),
        residual=dict(zip(joints, found.residual)),
        immaterial=found.slight,
        untestable=hidden,
        detection_limit={joint: limit_of(state, j, found.null) for j, joint in enumerate(joints)},
        alignment=hold,
        baseline=baseline,
        extended=found.best,
        before=before,
        after=after,
        held=held,
        state=found.final,
        tracking=followed(before, after, rng) if each else {},
        likeness=tuple(likeness(found.final, cause, found.shelf) for cause in found.final.causes),
    )


def spoilt(rig: Rig, logs: Sequence[Log], audits: Sequence[Audit], filtering: Filtering) -> Diagnosis:
    """The verdict *data*: the logs say nothing about physics that could be relied on."""
    given = Extended(nominal(rig))
    figures: Figures = {}
    with contextlib.suppress(DataError):  # too short for the band: then there is no figure either
        figures = measured(gather(rig, logs, filtering, {log.name: float(log.t[0]) for log in logs}), given)
    return Diagnosis(
        rig=rig.name,
        logs=tuple(one.log.name for one in audits),
        verdict="data",
        faults=tuple(fault for one in audits for fault in one.faults),
        notes=tuple(note for one in audits for note in one.notes),
        findings=(),
        residual={},
        immaterial=(),
        untestable=(),
        detection_limit={},
        alignment=alignment(audits[0].log, filtering),
        baseline=figures,
        extended=figures,
        before=given,
        after=given,
    )


def denial(cause: Cause) -> str:
    """Say that the held-out part did not confirm a cause."""
    return f"{cause.place}: {cause.name} fits the part that was trained on and the held-out part does not confirm it"


def alignment(log: Log, filtering: Filtering) -> float:
    """Time by which the torque acts later than its stamp, s."""
    return log.dt / 2 if filtering.alignment is None else filtering.alignment


def comparable(causes: Mapping[str, type[Cause]]) -> dict[str, type[Cause]]:
    """Leave out what compares the given model with the data: the refitted one has taken that up."""
    return {name: kind for name, kind in causes.items() if not kind.of_given_model}


def check_moved(evidence: Evidence, name: str) -> None:
    """Raise `DataError` if a joint never moved."""
    joints = evidence.rig.joints
    still = tuple(joint for joint, seen in zip(joints, evidence.seen) if seen.travel < MOVED)
    if still or np.any(evidence.used() < LIVELY):
        raise DataError(
            name, "its motion shows nothing of", "move every joint: see 'gimbal-pin excite'", still or joints
        )


def check_driven(state: State) -> None:
    """Raise `DataError` if a joint's torque has no more to do with its motion than noise has.

    ``F = (explained / parameters) / (left / rows)``: noise gives one, any rig hundreds.
    """
    n = len(state.fit.scale)
    whole, left = (np.sum(x.reshape(-1, n) ** 2, axis=0) for x in (state.fit.target, state.fit.residual))
    parameters = np.array([np.sum(np.any(state.fit.stack[j::n] != 0, axis=0)) for j in range(n)])
    rows = state.problem.evidence.rows * state.problem.evidence.used()
    F = (whole - left) / np.maximum(parameters, 1) / np.maximum(left / np.maximum(rows, 1.0), 1e-300)
    dumb = tuple(joint for joint, x in zip(state.problem.evidence.rig.joints, F) if x < DRIVEN)
    if dumb:
        what, mend = "their torque has nothing to do with the motion of", "check the torque's column, sign and time"
        raise DataError("the logs", what, mend, dumb)


def doubted(left: leftover.Residual, joint: str, causes: Sequence[Cause]) -> leftover.Residual:
    """A joint whose findings deserve no trust is structured."""
    if not any(cause.place == joint or not cause.of_joint for cause in causes):
        return left
    return leftover.Residual("structured", left.noise_floor, left.dispersion, left.where or "over its angle")


def finding(
    found: Searched,
    cause: Cause,
    lacking: Figures,
    held: Evidence,
    baseline: Figures,
    hidden: Sequence[Untestable],
    rng: np.random.Generator,
) -> Finding:
    """Describe one chosen cause; `lacking`: held-out figures without it; `hidden`: what the logs cannot show."""
    state, null = found.final, found.null
    judged = verdict.judged(state, cause, found.shelf, rng, hidden)
    joints = held.rig.joints
    at = cause.place if cause.of_joint else joints[int(np.argmax(judged.own.size))]
    torque, rolled = lacking["torque_rmse"], lacking["rollout_rmse"]
    base, best = baseline["torque_rmse"][at], found.best["torque_rmse"][at]
    figure = next(c for c in settled(state) if c.name == cause.name and c.place == cause.place)
    shown = parameters(state, cause)
    values = tuple(state.coefficients(cause).tolist()) if width(cause) and hasattr(cause, "coefficients") else ()
    change = 100 * (best / max(torque[at], 1e-300) - 1)
    said = f"{figure.sentence(values)}; held-out torque error {torque[at]:.3g} → {best:.3g} N m ({change:+.0f} %)"
    ambiguous = len(judged.alike) > 1
    return Finding(
        cause=cause.name,
        joint=cause.place if cause.of_joint else None,
        status="ambiguous" if ambiguous else "named",
        alike=judged.alike,
        parameters=shown,
        gain={
            "torque_rmse_before": torque[at],
            "torque_rmse_after": best,
            "rollout_rmse_before": rolled[at],
            "rollout_rmse_after": found.best["rollout_rmse"][at],
        },
        p_value=float((1 + np.sum(null <= judged.own.p)) / (1 + len(null))),
        selection_frequency=judged.frequency,
        explained_share=float((torque[at] ** 2 - best**2) / max(base**2, 1e-300)),
        visible_fraction=float(np.sqrt(judged.own.visible)),
        rivals=judged.rivals,
        sentence=said,
        next_experiment=cause.experiment if ambiguous else None,
    )


def combined(found: Sequence[Finding]) -> list[Finding]:
    """Merge findings of one cause of the whole rig, each about another of its figures: the stronger speaks for both."""
    out: list[Finding] = []
    for one in sorted(found, key=lambda f: -f.explained_share):
        twin = next((f for f in out if f.joint is None and (f.cause, f.joint) == (one.cause, one.joint)), None)
        if twin is None:
            out.append(one)
            continue
        known = {p.name: p for p in one.parameters if p.std == p.std}
        figures = tuple(known.get(p.name, p) for p in twin.parameters)
        out[out.index(twin)] = replace(twin, parameters=figures)
    return out


def limit_of(state: State, joint: int, null: Array) -> float:
    """Torque that a cause with one coefficient would need to be found, N m rms: its T² at the error rate."""
    floor = state.problem.evidence.noise_floor(joint)
    rows = state.problem.evidence.rows * float(state.problem.evidence.used()[joint])
    z = float(norm.isf(np.quantile(null, ERROR_RATE) / 2))
    return float(floor * np.sqrt(state.fit.dispersion[joint]) * z / np.sqrt(max(rows, 1.0)))
