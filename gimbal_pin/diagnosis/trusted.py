"""The given model against the refitted one: told, and where the URDF is trusted, made findings that have names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.diagnosis.bodies import Bodies, Fitted, Form, altered, chance
from gimbal_pin.diagnosis.engine.criterion import FORM
from gimbal_pin.diagnosis.engine.selection import APART
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import Extended, extended, settled
from gimbal_pin.diagnosis.gain import rollout_rmse, torque_rmse
from gimbal_pin.diagnosis.given import IMPOSSIBLE, SURE, TOLD, Difference, given, possible
from gimbal_pin.diagnosis.result import Diagnosis, Finding, Rival, Slight, Untestable, overall
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.identification import given_beta
from gimbal_pin.log.log import Array

TRUSTED = "trusted"
"""What a rig's YAML says under `inertia` if differences from its URDF are findings."""
MUCH = 0.05
"""Share of a joint's given inertia from which a difference is told: few URDFs are nearer."""


def compared(found: Diagnosis, state: State, causes: Mapping[str, type[Cause]]) -> Diagnosis:
    """Add what sets the given model apart from the refitted one; as findings, if the rig's URDF is trusted.

    Args:
        found: The diagnosis so far.
        state: The fit with all its findings in.
        causes: The causes to look for.
    """
    rig = state.problem.evidence.rig
    apart = Difference.of_state(state)
    hidden = [one for one in found.untestable if causes[one.cause].like_inertia]
    heavier = inertias(apart, state.problem.inertia, hidden)
    found = replace(found, given=given(apart), notes=(*found.notes, *heavier))
    if rig.config.inertia != TRUSTED or found.held is None:
        return found
    bodies = Bodies(apart, causes)
    case = Case(state, bodies, bodies.selected(), found.held)
    share = {form: torque_share(case, form) for form in case.fitted.forms}
    more = [finding(case, form, size) for form, size in share.items() if size.max() > FORM]
    less = [Slight(*form.place, float(size.max())) for form, size in share.items() if size.max() <= FORM]
    every = sorted([*found.findings, *more], key=lambda one: -one.explained_share)
    said = overall([one.status for one in every], list(found.residual.values()))
    return replace(found, findings=tuple(every), verdict=said, immaterial=(*found.immaterial, *less))


def inertias(found: Difference, rows: Array, hidden: Sequence[Untestable] = ()) -> tuple[str, ...]:
    """``m_j = mean over poses of M_jj``, refitted over given: a sentence for each joint where that is not one.

    Where a log cannot tell a motor's constant gain from the inertias that it moves, this is all that shows of it.

    Args:
        found: Refitted less given base parameters.
        rows: Base parameters → each joint's mean inertia about its axis, (n, b): see `Problem.inertia`.
        hidden: What the logs cannot show: what of it sits at the joint may be the reason.
    """
    before, out = given_beta(found.rig, found.reduction), []
    for joint, row in zip(found.rig.joints, rows):
        whole = float(row @ before)
        change, std = float(row @ found.change) / whole, float(np.sqrt(row @ found.covariance @ row)) / whole
        if not (abs(change) > MUCH and 2 * norm.sf(abs(change) / std) < SURE):
            continue
        if not possible(whole * (1 + change)):
            out.append(f"{joint}: the log does not determine the inertia about its axis; {IMPOSSIBLE}")
            continue
        less = f"{100 * abs(change):.3g} ± {max(100 * std, 0.01):.1g} % {'more' if change > 0 else 'less'}"
        others = [one.cause for one in hidden if one.joint == joint]
        instead = f"; {' or '.join(others)}, which this log cannot show, may look like that" if others else ""
        out.append(f"{joint}: the inertia about its axis is {less} than the URDF's{instead}")
    return tuple(out)


class Case(NamedTuple):
    """What a finding is described from: the fit to the training part, the search, its result, and the held-out part."""

    state: State
    bodies: Bodies
    fitted: Fitted
    held: Evidence


def torque_share(case: Case, form: Form) -> Array:
    """Torque that a cause makes, as a share of each joint's, rms, (n,)."""
    problem, fitted = case.state.problem, case.fitted
    change = case.bodies.response([fitted.causes[fitted.forms.index(form)]])
    torque, whole = (np.concatenate(x) for x in ([r @ change for r in problem.rigid_full], problem.evidence.torque))
    return np.sqrt(np.mean(torque**2, axis=0) / np.maximum(np.mean(whole**2, axis=0), 1e-300))


def finding(case: Case, form: Form, share: Array) -> Finding:
    """Describe one cause; before and after are the given URDF without and with it, all the rest as it was found."""
    bodies, fitted, joints = case.bodies, case.fitted, case.held.rig.joints
    at, k = joints.index(form.joint) if form.of.of_joint else int(np.argmax(share)), fitted.forms.index(form)
    rivals, alike = rivals_of(case, form)
    cause, values, std = fitted.causes[k], fitted.values[k], fitted.std(form)
    errors = [stated(case, [x for x in fitted.causes if x != cause]), stated(case, fitted.causes)]
    gain = {
        f"{name}_{when}": float(figure(case.held, model)[at])
        for name, figure in (("torque_rmse", torque_rmse), ("rollout_rmse", rollout_rmse))
        for when, model in zip(("before", "after"), errors)
    }
    before, after = gain["torque_rmse_before"], gain["torque_rmse_after"]
    clear = np.abs(values) > TOLD * np.nan_to_num(std, nan=np.inf)
    told = form.at(np.where(clear, values, 0.0).tolist()) if clear.any() else cause
    rig, gained = case.held.rig, f"held-out torque error of the given model {before:.3g} → {after:.3g} N m"
    stds = dict(zip((name for name, _ in form.start), std.tolist()))
    return Finding(
        cause=form.of.name,
        joint=form.place[1],
        status="ambiguous" if len(alike) > 1 else "named",
        alike=alike,
        parameters=tuple(
            replace(p, std=stds.get(p.name, float("nan")), unit=rig.in_units(form.place[1], p.unit))
            for p in cause.shown()
        ),
        gain=gain,
        p_value=float(min(1.0, bodies.many * np.exp(chance(bodies.without(fitted, form), fitted)))),
        selection_frequency=float(min((norm.cdf(rival.z) for rival in rivals), default=1.0)),
        explained_share=1 - after**2 / max(before**2, 1e-300),
        visible_fraction=1.0,
        rivals=rivals,
        sentence=f"{rig.in_units(form.place[1], told.told(rig))}; {rig.in_units(joints[at], gained)}",
        next_experiment=form.of.experiment if len(alike) > 1 else None,
    )


def rivals_of(case: Case, form: Form) -> tuple[tuple[Rival, ...], tuple[str, ...]]:
    """Put every other cause in one's place: the nearest of each name, and the names that the logs do not part from it.

    ``Δ = (s' - s)/2φ + (k' - k)/2 log b``, over its deviation where noise alone parts the two predictions (Vuong).
    """
    bodies, fitted, best, alike = case.bodies, case.fitted, dict[str, Rival](), {form.of.name}
    for other in bodies.beside(fitted, form):
        (name,) = (one.of.name for one in other.forms if one not in fitted.forms)
        schwarz = (other.freedom - fitted.freedom) * np.log(len(fitted.response)) / 2
        delta = float((other.cost - fitted.cost) / (2 * fitted.dispersion) + schwarz)
        apart = np.linalg.norm(bodies.found.whitener @ (other.response - fitted.response))
        new = Rival(name, delta, delta * float(np.sqrt(fitted.dispersion) / max(apart, 1e-12)))
        if name != form.of.name:
            best[name] = min(new, best.get(name, new), key=lambda one: one.z)
            alike |= {name} if new.z < APART or delta < -bodies.limit else set()
    rivals = tuple(sorted(best.values(), key=lambda one: one.z))
    return rivals, (form.of.name, *(one.cause for one in rivals if one.cause in alike))


def stated(case: Case, causes: Sequence[RigEffect]) -> Extended:
    """The given URDF with causes in its bodies, and everything else as the diagnosis has it."""
    found = [cause for cause in settled(case.state) if isinstance(cause, RigEffect)]
    full = extended(case.state)
    return replace(full, model=replace(full.model, rig=altered(case.bodies.found.rig, [*causes, *found])))
