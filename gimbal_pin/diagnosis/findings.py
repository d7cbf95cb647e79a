"""From an explained log to what is told: findings with their gain, what is left, and what the log cannot show."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isnan
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from gimbal_pin.checks import CheckedLog, collect_alterations
from gimbal_pin.diagnosis.background import add_tables
from gimbal_pin.diagnosis.covariance import widen_estimates
from gimbal_pin.diagnosis.engine.criterion import (
    compare_models,
    compute_cause_torque,
    criterion,
    exceeds_form_error,
    fitted,
    leave_cause_out,
    rows,
    unsupported,
)
from gimbal_pin.diagnosis.engine.discrepancy import place
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.engine.selection import promising, together
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.extended import build_extended_model, find_settled
from gimbal_pin.diagnosis.gain import (
    CONFIRMED,
    Figures,
    compare_errors,
    measure_errors,
    measure_gain,
    torque_rmse,
)
from gimbal_pin.diagnosis.probability import moderate
from gimbal_pin.diagnosis.result import (
    Candidate,
    Curve,
    Diagnosis,
    Finding,
    Residual,
    Rival,
    Slight,
    Untestable,
    get_joint,
    list_nearest,
)
from gimbal_pin.diagnosis.score import HIDDEN, visibility
from gimbal_pin.diagnosis.shapes import same, shape_names
from gimbal_pin.diagnosis.state import State
from gimbal_pin.diagnosis.uncertainty import estimate_figures
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import DataError, digits
from gimbal_pin.identification import describe_common_residual
from gimbal_pin.identification.validation import is_degraded
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig


def report_findings(
    found: Explained, held: Evidence, checked: Sequence[CheckedLog], filtering: Filtering
) -> Diagnosis:
    """Measure the gain on the reporting part, which drops nothing and moves nothing, and put it all together.

    Args:
        found: The model of the training part.
        held: The reporting part, its torques at the same time.
        checked: The logs.
        filtering: The band.
    """
    said = _report_logs(held.rig, checked, filtering)
    before = build_extended_model(found.first)
    model = confirm_causes(found, held)
    found = model.found
    findings = describe_findings(model, held)
    state, best, curves = add_tables(found, held, model.baseline, model.figures)
    residual = _list_residuals(found, curves)
    common = _describe_common_residual(residual, best, held, checked)
    if common:
        residual = {joint: replace(left, state="structured") for joint, left in residual.items()}
    after = _add_rest(
        widen_estimates(build_extended_model(state), state),
        residual,
        best["torque_rmse"],
        held.band,
    )
    if filtering.alignment is not None and after.estimated is not None:
        after = replace(after, estimated=replace(after.estimated, lags=(), lag_std=()))
    said = replace(
        said,
        notes=(*model.denied, *said.notes),
        findings=findings,
        residual=residual,
        statements=common,
        immaterial=_list_immaterial(found),
        untestable=list_untestable(found, findings),
        detection_limit=dict(zip(held.rig.joints, _compute_limits(found).tolist())),
        alignment=said.alignment + float(np.mean(found.alignment)),
        stated=measure_errors(held, said.before),
        rubbing=measure_errors(held, replace(before, rig=held.rig)),
        baseline=model.baseline,
        extended=best,
        before=before,
        after=after,
        held=held,
        state=found.final,
        instead=tuple(
            rival.cause for cause in found.final.causes for rival in found.rivals_of(cause)
        ),
    )
    is_open = said.verdict == "unknown"
    return (
        replace(said, candidate=_find_candidate(found, held, model.baseline)) if is_open else said
    )


def _add_rest(
    model: Model, residual: Mapping[str, Residual], errors: Mapping[str, float], band: float
) -> Model:
    """Return the model with what it knows of the rest: noise, and what of held-out torque no cause explains."""
    assert model.estimated is not None
    rows = [
        (errors[joint], left.noise_floor, left.state == "structured")
        for joint, left in residual.items()
    ]
    missed = tuple(
        max(error**2 - floor**2, 0.0) ** 0.5 if structured else 0.0
        for error, floor, structured in rows
    )
    noise = tuple(floor / band**0.5 for _, floor, _ in rows)
    return replace(model, estimated=replace(model.estimated, missed=missed, noise=noise))


def report_unusable_logs(
    rig: Rig, logs: Sequence[Log], checked: Sequence[CheckedLog], filtering: Filtering
) -> Diagnosis:
    """The verdict *data*: the logs say nothing about physics that could be relied on."""
    said = _report_logs(rig, checked, filtering)
    with contextlib.suppress(DataError):  # too short for the band: then there is no figure either
        figures = measure_errors(gather(rig, logs, filtering), said.before)
        return replace(said, stated=figures, rubbing=figures, baseline=figures, extended=figures)
    return said


def _report_logs(rig: Rig, checked: Sequence[CheckedLog], filtering: Filtering) -> Diagnosis:
    """What the checks say of the logs, and by how much later than its stamp a torque is taken to act at first."""
    given = nominal(rig)
    return Diagnosis(
        rig=rig.name,
        logs=tuple(one.log.name for one in checked),
        faults=tuple(fault for one in checked for fault in one.faults),
        notes=tuple(note for one in checked for note in one.notes),
        altered=collect_alterations(checked),
        alignment=checked[0].log.dt / 2 if filtering.alignment is None else filtering.alignment,
        before=given,
        after=given,
    )


def _list_residuals(found: Explained, curves: Mapping[str, Curve]) -> dict[str, Residual]:
    """Return what is left at each joint; `curves`: joint → the table that the extended model carries."""
    evidence = found.final.problem.evidence
    power = found.final.fit.dispersion.tolist()
    return {
        joint: Residual(
            "structured" if structured else "noise",
            evidence.noise_floor(j),
            power[j],
            found.left(j),
            place(found.final, j) if structured else "",
            curves.get(joint),
        )
        for j, (joint, structured) in enumerate(zip(evidence.rig.joints, found.structured))
    }


def _describe_common_residual(
    residual: Mapping[str, Residual], errors: Figures, held: Evidence, checked: Sequence[CheckedLog]
) -> tuple[str, ...]:
    """Return what `describe_common_residual` says of the reporting part; nothing where some rest has a structure."""
    if any(left.state == "structured" for left in residual.values()):
        return ()
    rest = np.array([errors["torque_rmse"][joint] for joint in residual])
    noise = np.array([held.noise_floor(j) for j in range(held.rig.n)])
    share = 1.0 - max(errors["fit_percent"].values()) / 100.0
    logs = [one.log for one in checked]
    return describe_common_residual(held.rig, logs, share, rest, noise, np.zeros_like(rest))


def _compute_limits(found: Explained) -> Array:
    """Return the torque that a cause with one coefficient would need to be found, N m rms, (n,): the threshold's."""
    state = found.final
    evidence = state.problem.evidence
    count = rows(state)
    share = np.expm1((found.search.threshold + np.log(count.max())) / np.maximum(count, 1.0))
    floors = np.array([evidence.noise_floor(j) for j in range(evidence.rig.n)])
    return np.asarray(floors * np.sqrt(state.fit.dispersion * share))


def _list_immaterial(found: Explained) -> tuple[Slight, ...]:
    """Return what else is significant, and less than an error of the model's form would be."""
    state = found.state
    search = found.search
    small = list[Slight]()
    n = len(state.fit.scale)
    torque = np.sum(state.problem.evidence.whiten_all(state.torque) ** 2, axis=0)
    for cause in promising(state, search):
        if any(same(cause, one) for one in state.causes):  # another harmonic of what was found
            continue
        new = fitted(search.problem, together(state.causes, cause), state)
        clear = criterion(state) - criterion(new) > search.threshold
        if clear and not exceeds_form_error(new, state):
            fits = state.fit, new.fit
            left, less = (
                np.sum((fit.residual.reshape(-1, n) / fit.scale) ** 2, axis=0) for fit in fits
            )
            size = np.sqrt(np.maximum(left - less, 0.0) / np.maximum(torque, 1e-300))
            small.append(Slight(cause.name, get_joint(cause), float(size.max())))
    return tuple(small)


def _find_candidate(found: Explained, held: Evidence, baseline: Figures) -> Candidate | None:
    """Return the cause, of those that were not accepted, with which the held-out error of the rig falls most."""
    best, most = None, 0.0
    for cause in found.state.causes or promising(found.first, found.search):
        state = fitted(found.search.problem, (cause,), found.first)
        errors = dict(zip(held.rig.joints, torque_rmse(held, build_extended_model(state)).tolist()))
        gain = measure_gain(baseline, {"torque_rmse": errors}, held.used)
        if gain > most:
            # A fit may move a cause of the rig to other figures: the state holds the one that it ended at.
            at = _locate_cause(state, next(one for one in state.causes if same(one, cause)))
            best = Candidate(
                cause.name, get_joint(cause), at, baseline["torque_rmse"][at], errors[at]
            )
            most = gain
    return best


class Confirmed(NamedTuple):
    """A model all of whose causes the reporting part confirms.

    Attributes:
        found: The model.
        baseline: Figures on the reporting part without any cause.
        figures: The model's there.
        lacking: Those of it without each of its causes.
        denied: What was left out, in sentences.
    """

    found: Explained
    baseline: Figures
    figures: Figures
    lacking: Mapping[Cause, Figures]
    denied: tuple[str, ...]


def confirm_causes(found: Explained, held: Evidence) -> Confirmed:
    """Leave out the causes that the reporting part does not confirm, the one that costs most first.

    With such a cause the error is no smaller at its joint (`CONFIRMED`), or grows in the whole rig, or materially at
    any of its joints.

    Args:
        found: The model of the training part.
        held: The reporting part.
    """
    baseline = measure_errors(held, build_extended_model(found.first))
    used = held.used
    denied = list[str]()
    while True:
        state = found.final
        best = measure_errors(held, build_extended_model(state))
        lacking = {
            one: measure_errors(held, build_extended_model(leave_cause_out(state, one)))
            for one in state.causes
        }
        gains = {cause: measure_gain(figures, best, used) for cause, figures in lacking.items()}
        places = {cause: _locate_cause(state, cause) for cause in lacking}
        errors = {
            cause: [x["torque_rmse"][places[cause]] for x in (lacking[cause], best)]
            for cause in lacking
        }
        smaller = {
            cause for cause, (before, after) in errors.items() if before >= CONFIRMED * after
        }
        worse = {cause: _list_degraded_joints(best, figures) for cause, figures in lacking.items()}
        unconfirmed = [
            cause
            for cause, gain in gains.items()
            if cause not in smaller or gain < 0 or worse[cause]
        ]
        if not unconfirmed:
            return Confirmed(found, baseline, best, lacking, tuple(denied))
        worst = min(unconfirmed, key=gains.__getitem__)
        at = places[worst]
        (without_, with_) = errors[worst]
        told = held.rig.in_units(at, f"from {digits(without_, 3)} N m to {digits(with_, 3)} N m")
        grows = " and ".join(worse[worst]) or "the whole rig"
        whole = f", and that of {grows} grows" if worst in smaller else ""
        denied.append(
            f"{at}: {worst.name} explains the part that was fitted and is left out: on the part that no choice has "
            f"seen the torque error goes {told} with it{whole}"
        )
        found = replace(found, final=leave_cause_out(state, worst))


def _list_degraded_joints(after: Figures, before: Figures) -> list[str]:
    """Return the joints at which a model is materially worse than another on unseen rows."""
    return [
        joint
        for joint, fit in before["fit_percent"].items()
        if is_degraded(after["fit_percent"][joint], fit)
    ]


def _locate_cause(state: State, cause: Cause) -> str:
    """Return the joint at which a cause adds most torque: its own, where it has one."""
    joints = state.problem.evidence.rig.joints
    return (
        cause.place
        if cause.of_joint
        else joints[int(np.argmax(np.sum(compute_cause_torque(state, cause) ** 2, axis=0)))]
    )


def describe_findings(model: Confirmed, held: Evidence) -> tuple[Finding, ...]:
    """Describe the causes of a model, the one that explains most first.

    Of one cause of the whole rig, found by several of its figures, the strongest speaks for all.

    Args:
        model: The model.
        held: The reporting part.
    """
    out: dict[tuple[str, str | None], Finding] = {}
    every = (_describe_cause(model, cause, held) for cause in model.found.final.causes)
    for one in sorted(every, key=lambda one: -one.explained_share):
        first = out.setdefault((one.cause, one.joint), one)
        known = {p.name: p for p in one.sized}
        figures = tuple(known.get(p.name, p) for p in first.parameters)
        out[one.cause, one.joint] = replace(first, parameters=figures)
    return tuple(out.values())


def _describe_cause(model: Confirmed, cause: Cause, held: Evidence) -> Finding:
    """Describe one cause of a model."""
    found = model.found
    state = model.found.final
    rig = held.rig
    base = leave_cause_out(state, cause)
    at = _locate_cause(state, cause)
    (final, values) = find_settled(state, cause)
    gain = compare_errors(model.lacking[cause], model.figures, at)
    before = gain["torque_rmse_before"]
    after = gain["torque_rmse_after"]
    figures = average_figures(state, cause)
    within = final.holds(values)
    rivals = (
        Rival(one.cause.name, one.delta, one.delta / max(one.std, 1e-12), get_joint(one.cause))
        for one in found.rivals_of(cause)
    )
    said = f"{_describe_sizes(cause, final.sentence(values), figures)}{f' ({within})' if within else ''}"
    change = 100 * (after / max(before, 1e-300) - 1)
    gained = rig.in_units(
        at, f"held-out torque error {before:.3g} → {after:.3g} N m ({change:+.0f} %)"
    )
    chance = len(found.search.library.causes) * np.exp((criterion(state) - criterion(base)) / 2)
    return Finding(
        cause=cause.name,
        joint=get_joint(cause),
        parameters=tuple(replace(p, unit=rig.in_units(cause.place, p.unit)) for p in figures),
        gain=gain,
        false_alarm=float(min(1.0, chance)),
        sentence=f"{rig.in_units(cause.place, said)}; {gained}",
        experiment=cause.experiment,
        rivals=list_nearest(cause.name, rivals),
        blurred=cause.blurred(base.problem.evidence.seen[rig.joint_index(cause.place)])
        if cause.of_joint
        else (),
        visible_fraction=float(np.sqrt(visibility(base.fit, [base.columns(cause)])[0])),
    )


def average_figures(state: State, cause: Cause) -> tuple[Parameter, ...]:
    """``σ² + Σ p_i (x_i - x)²``: a cause's figures, their deviations with those of the pieces that it may have as well.

    Averaged over models (Hoeting, Madigan, Raftery and Volinsky, Stat. Sci. 14, 1999): x_i with pieces that the travel
    does not tell from its own, p_i how probable those are.
    """
    figures = estimate_figures(state, cause)
    evidence = state.problem.evidence
    k = state.causes.index(cause)
    if not (cause.of_joint and cause.pieces):
        return figures
    others = list[dict[str, float]]()
    odds = list[float]()
    for other in cause.akin(evidence.seen[evidence.rig.joint_index(cause.place)]):
        new = fitted(state.problem, (*state.causes[:k], other, *state.causes[k + 1 :]), state)
        if not unsupported(new):
            others.append({p.name: p.value for p in other.shown(find_settled(new, other)[1])})
            odds.append(-moderate(*compare_models(state, new)))
    share = softmax([0.0, *odds])[1:]
    moved = [np.array([one[p.name] - p.value for one in others]) for p in figures]
    moved = [np.angle(np.exp(1j * x)) if p.unit == "rad" else x for p, x in zip(figures, moved)]
    return tuple(
        replace(p, std=float(np.hypot(p.std, np.sqrt(share @ x**2))))
        for p, x in zip(figures, moved)
    )


def _describe_sizes(cause: Cause, sentence: str, figures: Sequence[Parameter]) -> str:
    """Return a sentence that states no size which the log does not know: with bounds where it knows one only.

    Of several harmonics the strongest is judged. Of sizes that were fitted each, and of which the logs tell none by
    itself, only what they make together is known.
    """
    leading = [p for p in figures if not (isnan(p.std) or p.name[-1].isdigit())]
    if not all(p.is_known for p in leading):
        sentence = f"{cause.place}: {cause.name}, {', '.join(p.describe() for p in leading)}"
    joint = ", ".join(p.name for p in figures if p.name in shape_names(cause) and isnan(p.std))
    return f"{sentence} ({joint} only together: other sizes fit as well)" if joint else sentence


def list_untestable(found: Explained, findings: Sequence[Finding]) -> tuple[Untestable, ...]:
    """List causes of which a log shows less than `HIDDEN` at their own joint, but for those that were found.

    One motor's gain shows by what it spares all others.
    """
    state = found.first
    library = found.search.library
    visible = dict[tuple[str, str | None], float]()
    shares = visibility(state.fit, [library.of(cause, state) for cause in library.causes])
    for cause, share in zip(library.causes, shares.tolist()):
        at = cause.name, get_joint(cause)
        visible[at] = max(visible.get(at, 0.0), share)
    why = {cause.name: cause.hidden for cause in library.causes}
    known = {(one.cause, one.joint) for one in findings}
    return tuple(
        Untestable(*at, why[at[0]])
        for at, share in visible.items()
        if share < HIDDEN and at not in known
    )
