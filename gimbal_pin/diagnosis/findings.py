"""From an explained log to findings: each cause's gain, rivals and uncertainty; and causes that the log cannot show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isnan
from typing import NamedTuple

import numpy as np

from gimbal_pin.diagnosis.engine.criterion import added, criterion, without
from gimbal_pin.diagnosis.engine.explained import Explained
from gimbal_pin.diagnosis.engine.selection import Rival
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import extended, settled
from gimbal_pin.diagnosis.gain import Figures, measured
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.result import Finding, Untestable, find_credible
from gimbal_pin.diagnosis.result import Rival as Told
from gimbal_pin.diagnosis.score import HIDDEN, visibility
from gimbal_pin.diagnosis.shapes import shape_names
from gimbal_pin.diagnosis.state import State, width
from gimbal_pin.diagnosis.uncertainty import parameters
from gimbal_pin.effects import Cause
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.errors import digits
from gimbal_pin.log.log import Array

ROUGH = 0.5
"""Deviation over its value from which a size is not known to two deviations."""


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
    """Leave out the causes that the reporting part speaks against, the one that costs most first.

    With such a cause the error grows, at its joint or in the whole rig, or is larger than without any.

    Args:
        found: The model of the training part.
        held: The reporting part.
    """
    baseline, used, denied = measured(held, extended(found.first)), held.used(), list[str]()
    while True:
        state = found.final
        best = measured(held, extended(state))
        lacking = {cause: measured(held, extended(without(state, cause))) for cause in state.causes}
        helps = measure_gain(baseline, best, used) >= 0
        gains = {cause: measure_gain(figures, best, used) for cause, figures in lacking.items()}
        errors = {cause: _compare_errors(state, cause, lacking[cause], best) for cause in lacking}
        grown = [cause for cause, (before, after) in errors.items() if not helps or gains[cause] < 0 or after > before]
        if not grown:
            return Confirmed(found, baseline, best, lacking, tuple(denied))
        worst = min(grown, key=gains.__getitem__)
        at = _find_joint(state, worst)
        before, after = (held.rig.in_units(at, f"{digits(x, 3)} N m") for x in errors[worst])
        whole = "" if errors[worst][1] > errors[worst][0] else ", and that of the whole rig grows"
        denied.append(
            f"{at}: {worst.name} explains the part that was fitted and is left out: on the part that no choice has "
            f"seen the torque error goes from {before} to {after} with it{whole}"
        )
        found = replace(found, final=without(state, worst))


def _find_joint(state: State, cause: Cause) -> str:
    """Return the joint at which a cause adds most torque: its own, where it has one."""
    joints = state.problem.evidence.rig.joints
    return cause.place if cause.of_joint else joints[int(np.argmax(np.sum(added(state, cause) ** 2, axis=0)))]


def _compare_errors(state: State, cause: Cause, lacking: Figures, best: Figures) -> tuple[float, float]:
    """Return the held-out torque errors at a cause's joint without and with it, N m."""
    at = _find_joint(state, cause)
    return lacking["torque_rmse"][at], best["torque_rmse"][at]


def findings(model: Confirmed, held: Evidence) -> tuple[Finding, ...]:
    """Describe the causes of a model, the one that explains most first.

    Args:
        model: The model.
        held: The reporting part.
    """
    every = [finding(model, cause, held) for cause in model.found.final.causes]
    return tuple(sorted(combined(every), key=lambda one: -one.explained_share))


def finding(model: Confirmed, cause: Cause, held: Evidence) -> Finding:
    """Describe one cause of a model."""
    found, best, lacking = model.found, model.figures, model.lacking[cause]
    state, rivals = found.final, nearest(cause, found.rivals_of(cause))
    base = without(state, cause)
    at = _find_joint(state, cause)
    before, after = _compare_errors(state, cause, lacking, best)
    shown = parameters(state, cause)
    alike = look_alikes(found, cause, rivals)
    change = 100 * (after / max(before, 1e-300) - 1)
    figure = next(one for one in settled(state) if one.name == cause.name and one.place == cause.place)
    values = tuple(state.coefficients(cause).tolist()) if width(cause) and hasattr(cause, "coefficients") else ()
    within = figure.holds(values)
    rig = held.rig
    said = f"{figure.sentence(values)}{rough(shown)}{together(cause, shown)}{f' ({within})' if within else ''}"
    gained = rig.in_units(at, f"held-out torque error {before:.3g} → {after:.3g} N m ({change:+.0f} %)")
    gain = criterion(base) - criterion(state)
    return Finding(
        cause=cause.name,
        joint=cause.place if cause.of_joint else None,
        status="ambiguous" if len(alike) > 1 else "named",
        alike=alike,
        parameters=tuple(replace(p, unit=rig.in_units(cause.place, p.unit)) for p in shown),
        gain={
            "torque_rmse_before": before,
            "torque_rmse_after": after,
            "rollout_rmse_before": lacking["rollout_rmse"][at],
            "rollout_rmse_after": best["rollout_rmse"][at],
        },
        p_value=float(min(1.0, len(found.search.shelf.causes) * np.exp(-gain / 2))),
        explained_share=min(1.0, float((before**2 - after**2) / max(model.baseline["torque_rmse"][at] ** 2, 1e-300))),
        visible_fraction=float(np.sqrt(visibility(base.fit, [base.columns(cause)])[0])),
        rivals=rivals,
        sentence=f"{rig.in_units(cause.place, said)}; {gained}",
        next_experiment=cause.experiment if len(alike) > 1 else None,
    )


def measure_gain(before: Figures, after: Figures, used: Array) -> float:
    """``Σ_j u_j log(rmse_before/rmse_after)``: what a model gains over another in the whole rig, as log likelihood.

    u_j is the share of joint j's samples that count on the reporting part, (n,): one that stands says nothing.
    """
    pairs = [(rmse, after["torque_rmse"][joint]) for joint, rmse in before["torque_rmse"].items()]
    return float(used @ [np.log(max(a, 1e-300) / max(b, 1e-300)) for a, b in pairs])


def look_alikes(found: Explained, cause: Cause, rivals: Sequence[Told]) -> tuple[str, ...]:
    """Return what holds a probability of `SURE` together, a cause's own name first, and what no log tells from it."""
    evidence = found.first.problem.evidence
    names = find_credible(cause.name, rivals)
    if cause.of_joint:
        names += cause.blurred(evidence.seen[evidence.rig.joint_index(cause.place)])
    return tuple(dict.fromkeys(names))


def nearest(cause: Cause, rivals: Sequence[Rival]) -> tuple[Told, ...]:
    """Return the most probable rival of each name but the cause's own, in that order."""
    every = [
        Told(
            one.cause.name, one.delta, one.delta / max(one.std, 1e-12), one.cause.place if one.cause.of_joint else None
        )
        for one in rivals
    ]
    best: dict[str, Told] = {}
    for one in sorted(every, key=lambda one: -one.log_odds):
        best.setdefault(one.cause, one)
    return tuple(one for name, one in best.items() if name != cause.name)


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


def rough(figures: Sequence[Parameter]) -> str:
    """Say which of a sentence's sizes are not known to two deviations.

    What may have either sign, a phase or where a spring rests, may well be near zero and be known.
    """
    names = [p.name for p in figures if p.lower >= 0 and p.std > ROUGH * p.value]
    return f" ({', '.join(names)} only roughly)" if names else ""


def together(cause: Cause, figures: Sequence[Parameter]) -> str:
    """Say which sizes, fitted each, the logs tell none of by itself: only what they make together is known."""
    names = [p.name for p in figures if p.name in shape_names(cause) and isnan(p.std)]
    return f" ({', '.join(names)} only together: other sizes fit as well)" if names else ""


def untestable(state: State, shelf: Library, findings: Sequence[Finding]) -> tuple[Untestable, ...]:
    """List causes of which a log shows less than `HIDDEN` at their own joint, but for those that were found.

    Args:
        state: The refitted model without any cause.
        shelf: The candidates.
        findings: What was found: one motor's gain shows by what it spares all others.
    """
    found = {(one.cause, one.joint) for one in findings}
    why = {cause.name: cause.hidden for cause in shelf.causes}
    rows = (at for at, seen in shown(state, shelf.causes, shelf).items() if seen < HIDDEN and at not in found)
    return tuple(Untestable(name, joint, why[name]) for name, joint in rows)


def shown(state: State, causes: Sequence[Cause], shelf: Library) -> dict[tuple[str, str | None], float]:
    """Return name and joint → the largest share of a column's power that the rigid model and friction leave."""
    visible: dict[tuple[str, str | None], float] = {}
    columns = [shelf.of(cause, state) for cause in causes]
    for cause, seen in zip(causes, visibility(state.fit, columns).tolist()):
        key = (cause.name, cause.place if cause.of_joint else None)
        visible[key] = max(visible.get(key, 0.0), seen)
    return visible
