"""From what was found to what is told: findings with their gain, what is left, and logs that tell nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import starmap
from math import isnan

import numpy as np
from scipy.stats import norm

from gimbal_pin.audit import Audit
from gimbal_pin.diagnosis import verdict
from gimbal_pin.diagnosis.alternatives import widened
from gimbal_pin.diagnosis.beyond import ONLY
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.extended import Extended, extended, settled
from gimbal_pin.diagnosis.finding import Diagnosis, Finding, Untestable, overall
from gimbal_pin.diagnosis.followed import followed
from gimbal_pin.diagnosis.heldout import Figures, measured
from gimbal_pin.diagnosis.likeness import likeness
from gimbal_pin.diagnosis.mending import mended
from gimbal_pin.diagnosis.off_centre import joined
from gimbal_pin.diagnosis.platform_motion import Ridden
from gimbal_pin.diagnosis.scale import limited, scaled
from gimbal_pin.diagnosis.searched import ERROR_RATE, Searched
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, width
from gimbal_pin.diagnosis.together import combined, doubled, once
from gimbal_pin.diagnosis.uncertainty import parameters
from gimbal_pin.diagnosis.walking import walked
from gimbal_pin.diagnosis.wandering import wandering
from gimbal_pin.effects import Cause
from gimbal_pin.errors import DataError
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig
from gimbal_pin.rows import Filtering

ROUGH = 0.4
"""Standard deviation over its value from which a figure is told as rough: its interval then reaches from a fifth of it
to nearly twice."""


def beside(said: Diagnosis, more: Sequence[Finding]) -> Diagnosis:
    """Put further findings beside what was found with them in the model."""
    findings = tuple(sorted(joined(said.findings, more), key=lambda one: -one.explained_share))
    verdict_ = overall([one.status for one in findings], tuple(said.residual.values()))
    return replace(said, findings=findings, verdict=verdict_)


def with_motion(said: Diagnosis, moving: Ridden) -> Diagnosis:
    """Put the motion of the platform beside what was found with it in the model."""
    return replace(beside(said, [moving.finding]), baseline=moving.baseline)


def reported(
    found: Searched, held: Evidence, audits: Sequence[Audit], hold: float, rng: np.random.Generator
) -> Diagnosis:
    """Measure the gain on the held-out part, and put it all together."""
    joints, state = held.rig.joints, found.state
    before, after = extended(found.first), extended(found.final)
    baseline = measured(held, before)
    hidden = verdict.untestable(found.first, found.shelf)
    unseen = (*hidden, *verdict.half_hidden(found.first, found.shelf))
    mends = mended(found.final, found.shelf)
    rows = [row for row in zip(found.final.causes, found.lacking, strict=True) if row[0] not in mends]
    each, twice = once(combined([finding(found, *row, held, baseline, hidden, rng) for row in rows]))
    limits = tuple(limited(found.final, each))
    late = [j for j, one in zip(joints, found.residual) if one.where == ONLY]
    denied = tuple(map(denial, found.denied))
    said = [*denied, *starmap(mending, mends.items()), *starmap(doubled, twice), *(one.note for one in limits)]
    said += [lateness(joint, found.best["torque_rmse"][joint]) for joint in late]
    return Diagnosis(
        rig=held.rig.name,
        logs=tuple(one.log.name for one in audits),
        verdict=overall([one.status for one in each], found.residual),
        faults=tuple(fault for one in audits for fault in one.faults),
        notes=(*(note for one in audits for note in one.notes), *said),
        findings=tuple(sorted((scaled(one, limits) for one in each), key=lambda one: -one.explained_share)),
        residual=dict(zip(joints, found.residual)),
        immaterial=found.slight,
        untestable=untold(unseen, each),
        detection_limit={joint: limit_of(state, j, found.null) for j, joint in enumerate(joints)},
        alignment=hold,
        baseline=baseline,
        extended=found.best,
        before=before,
        after=after,
        held=held,
        state=found.final,
        denied=denied,
        tracking=followed(before, after, rng) if each else {},
        likeness=tuple(likeness(found.final, cause, found.shelf) for cause, _ in rows),
    )


def untold(hidden: Sequence[Untestable], each: Sequence[Finding]) -> tuple[Untestable, ...]:
    """What the logs hide, but for what was found: one motor's gain shows by what it spares all others."""
    told = {(one.cause, one.joint) for one in each}
    return tuple(row for row in hidden if (row.cause, row.joint) not in told)


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


def lateness(joint: str, error: float) -> str:
    """Say that something acts only where nothing was fitted; `error`: the torque's there, N m rms."""
    mend = "record a log in which it acts throughout, or hold out another part"
    return f"{joint}: noise where the model was fitted, {error:.3g} N m off in the held-out part: {mend}"


def mending(cause: Cause, other: Cause) -> str:
    """Say that a cause in the extended model is there for another's form."""
    return f"{cause.place}: {cause.name} only mends the form of {other.name}, which is none that the library has"


def alignment(log: Log, filtering: Filtering) -> float:
    """Time by which the torque acts later than its stamp, s."""
    return log.dt / 2 if filtering.alignment is None else filtering.alignment


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
    shown = walked(state, cause, widened(state, cause, parameters(state, cause), found.shelf))
    values = tuple(state.coefficients(cause).tolist()) if width(cause) and hasattr(cause, "coefficients") else ()
    change = 100 * (best / max(torque[at], 1e-300) - 1)
    within = figure.holds(values)
    said = f"{figure.sentence(values)}{rough(shown)}{together(cause, shown)}{swing(state, cause)}"
    said += f" ({within})" if within else ""
    said = f"{said}; held-out torque error {torque[at]:.3g} → {best:.3g} N m ({change:+.0f} %)"
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
        explained_share=min(1.0, float((torque[at] ** 2 - best**2) / max(base**2, 1e-300))),
        visible_fraction=float(np.sqrt(judged.own.visible)),
        rivals=judged.rivals,
        sentence=said,
        next_experiment=cause.experiment if ambiguous else None,
    )


def swing(state: State, cause: Cause) -> str:
    """Say by how much a delay wanders, if it does."""
    found = wandering(state, cause)
    return "" if found is None else f", and wanders about that by {1e3 * found.rms:.2g} ms rms over seconds"


def rough(figures: Sequence[Parameter]) -> str:
    """Say which of a sentence's sizes the logs hardly tell: those that deviate by more than `ROUGH` of themselves.

    What may have either sign, a phase or where a spring rests, may well be near zero and be known.
    """
    names = [p.name for p in figures if p.lower >= 0 and p.std > ROUGH * p.value]
    return f" ({', '.join(names)} only roughly)" if names else ""


def together(cause: Cause, figures: Sequence[Parameter]) -> str:
    """Say which sizes, fitted each, the logs tell none of by itself: only what they make together is known."""
    names = [p.name for p in figures if p.name in shape_names(cause) and isnan(p.std)]
    return f" ({', '.join(names)} only together: other sizes fit as well)" if names else ""


def limit_of(state: State, joint: int, null: Array) -> float:
    """Torque that a cause with one coefficient would need to be found, N m rms: its T² at the error rate."""
    floor = state.problem.evidence.noise_floor(joint)
    rows = state.problem.evidence.rows * float(state.problem.evidence.used()[joint])
    z = float(norm.isf(np.quantile(null, ERROR_RATE) / 2))
    return float(floor * np.sqrt(state.fit.dispersion[joint]) * z / np.sqrt(max(rows, 1.0)))
