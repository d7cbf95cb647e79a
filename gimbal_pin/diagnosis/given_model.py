"""The given model against the refitted one: sentences, and where the URDF is trusted, findings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.diagnosis.covariance import compute_misfit
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import build_extended_model, settle_causes
from gimbal_pin.diagnosis.gain import compare_errors, measure_errors
from gimbal_pin.diagnosis.given_causes import (
    Form,
    GivenCauses,
    GivenResponse,
    change_rig,
    find_given_causes,
)
from gimbal_pin.diagnosis.result import Diagnosis, Finding, Rival, Slight, Untestable, list_nearest
from gimbal_pin.diagnosis.state import Problem, State
from gimbal_pin.dynamics.model import Model
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.errors import GimbalPinError, digits, format_estimate
from gimbal_pin.identification import (
    BaseDifference,
    PayloadStatement,
    apply_changes,
    compare_payload,
    given_beta,
    identify,
    refittable_effects,
    state_payload,
)
from gimbal_pin.identification.difference import FALSE_ALARM
from gimbal_pin.identification.payload import DEVIATIONS, IMPOSSIBLE, is_physical_inertia
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    FORM_ERROR,
    Filtering,
    MotionNoise,
)
from gimbal_pin.rig.rig import Rig

_LEAST_CHANGE = 0.05
"""Share of a joint's given inertia from which a difference is told: few URDFs are nearer."""


def compute_base_difference(state: State) -> BaseDifference:
    """``cov = H⁻¹ (Σ_blocks g gᵀ) H⁻¹ + Σ_joints R Rᵀ``, R what the fit misses there: see `propagate_misfit`."""
    evidence = state.problem.evidence
    reduction = state.problem.reduction
    fit = state.fit
    width = len(reduction.independent)
    rig = evidence.rig
    spread = fit.covariance * len(fit.starts) / max(len(fit.starts) - 1, 1)
    change = fit.theta[:width] - given_beta(rig, reduction)
    found = BaseDifference(
        rig, reduction, change, spread[:width, :width], fit.information[:width, :width]
    )
    return found.widen(np.hstack([compute_misfit(state, j)[:width] for j in range(rig.n)]))


def compare_given_model(
    found: Diagnosis, state: State, causes: Mapping[str, type[Cause]]
) -> Diagnosis:
    """Add what sets the given model apart from the refitted one; as findings, if the rig's URDF is trusted.

    Args:
        found: The diagnosis so far.
        state: The fit with all its findings in.
        causes: The causes to look for.
    """
    difference = compute_base_difference(state)
    hidden = [one for one in found.untestable if causes[one.cause].like_inertia]
    unlike = (
        *_describe_inertias(difference, state.problem, hidden, found.unexplained),
        *describe_friction(found.before, found.unexplained),
    )
    found = replace(found, notes=(*found.notes, *unlike))
    if difference.rig.config.inertia != "trusted" or found.held is None:
        return found
    case = _Case(
        state, GivenResponse(difference), find_given_causes(difference, causes), found.held
    )
    best = case.found.best
    share = {
        form: _compute_torque_share(case, form) for form in best.values if best.is_known(form).any()
    }
    more = [
        _describe_finding(case, form, size)
        for form, size in share.items()
        if size.max() > FORM_ERROR
    ]
    less = [
        Slight(*form.place, float(size.max()))
        for form, size in share.items()
        if size.max() <= FORM_ERROR
    ]
    return replace(found, findings=(*found.findings, *more), immaterial=(*found.immaterial, *less))


def state_payload_with_causes(
    found: Diagnosis,
    rig: Rig,
    logs: Sequence[Log],
    holdout: str | None,
    filters: Filtering | None,
    mass: float | None,
) -> PayloadStatement:
    """State what `identify` says of the payload with the found causes in its equations; nothing of spoilt logs.

    Where these cannot hold a cause, as of the drive or of a friction that reads the torque, or refuse the logs, the
    diagnosis's own fit says it.

    Args:
        found: The diagnosis.
        rig: The rig.
        logs: Its logs.
        holdout: As for `identify`.
        filters: As for `identify`.
        mass: Of the payload, kg, where it was weighed.
    """
    if found.state is None:
        return PayloadStatement()
    model = found.after
    if not (model.drive or any(term.effect.loaded for term in model.terms)):
        with suppress(GimbalPinError):
            changed = apply_changes(rig, model.changes)
            one = identify(
                changed,
                logs,
                refittable_effects(model),
                holdout=holdout,
                filtering=filters,
                examined="never",
            )
            return compare_payload(one, mass)
    return state_payload(compute_base_difference(found.state), mass)


def _describe_inertias(
    found: BaseDifference,
    problem: Problem,
    hidden: Sequence[Untestable],
    unexplained: Collection[str],
) -> Iterator[str]:
    """``m_j = mean over poses of M_jj``, refitted over given: yield a sentence for each joint where that is not one.

    Where a log cannot tell a motor's constant gain from the inertias that it moves, this is all that shows of it.

    Args:
        found: Refitted less given base parameters.
        problem: The logs.
        hidden: What the logs cannot show: what of it sits at the joint may be the reason.
        unexplained: Joints whose torque is not explained: no size of their inertia is stated.
    """
    before = given_beta(found.rig, found.reduction)
    noise = problem.motion_noise
    for j, (joint, row) in enumerate(zip(found.rig.joints, problem.motion.inertia)):
        whole = float(row @ before)
        change = float(row @ found.change) / whole
        std = float(np.sqrt(row @ found.covariance @ row)) / whole
        if not (abs(change) > _LEAST_CHANGE and 2 * norm.sf(abs(change) / std) < FALSE_ALARM):
            continue
        if not is_physical_inertia(whole * (1 + change)):
            yield f"{joint}: the log does not determine the inertia about its axis; {IMPOSSIBLE}"
        elif noise.is_hiding[j]:
            yield found.rig.in_units(joint, f"{joint}: {_describe_attenuation(noise, j)}")
        elif joint not in unexplained:
            less = f"{format_estimate(100 * abs(change), max(100 * std, 0.01))} % {'more' if change > 0 else 'less'}"
            others = [one.cause for one in hidden if one.joint == joint]
            instead = (
                f"; {' or '.join(others)}, which this log cannot show, may look like that"
                if others
                else ""
            )
            yield f"{joint}: the inertia about its axis is {less} than the URDF's{instead}"


def describe_friction(refitted: Model, unexplained: Collection[str]) -> Iterator[str]:
    """Yield the known friction of the joints whose URDF states none, with 95 % intervals, in one sentence.

    Joints that are not explained are left out, and so are those at which a coefficient is negative by two deviations:
    no friction gives power.
    """
    rig = refitted.rig
    known = refitted.estimated
    assert known is not None
    rows = [*zip(known.names, known.theta.tolist(), known.std.tolist(), known.units)]
    each = []
    for joint, stated in zip(rig.joints, rig.friction):
        own = [row for row in rows if row[0].startswith(f"{joint}.")]
        if (
            np.any(stated)
            or joint in unexplained
            or any(value < -DEVIATIONS * std for _, value, std, _ in own)
        ):
            continue
        sizes = [
            f"{format_estimate(x, std)} {unit}" for _, x, std, unit in own if x > DEVIATIONS * std
        ]
        each += [f"{joint} {' and '.join(sizes)}"] if sizes else []
    if each:
        said = f"the URDF states no friction where there is some: {', '.join(each)} (± 95 %)"
        yield f"{said}; identify --urdf writes it in"


def _describe_attenuation(noise: MotionNoise, joint: int) -> str:
    """Say that noise in the motion may hide a joint's inertia, and of what size that is by either estimate."""
    plain, slow, std = (float(x[joint]) for x in (noise.plain, noise.instrumental, noise.std))
    known = (
        f"{format_estimate(slow, std, 2)} kg m^2"
        if slow > DEVIATIONS * std
        else "none that is known"
    )
    return (
        f"noise in the motion may hide inertia: {digits(max(plain, 0.0), 2)} kg m^2 by least squares, {known} from the "
        f"motion below {noise.cutoff:g} Hz alone; no difference in inertia is told from this log"
    )


class _Case(NamedTuple):
    """What a finding is described from: the fit to the training part, responses, causes, and the held-out part."""

    state: State
    response: GivenResponse
    found: GivenCauses
    held: Evidence


def _compute_torque_share(case: _Case, form: Form) -> Array:
    """Torque that a cause makes, as a share of each joint's, rms, (n,)."""
    problem = case.state.problem
    change = case.response.compute([case.found.best.causes[form]])
    torque, whole = (
        np.concatenate(x)
        for x in ([r @ change for r in problem.motion.full], problem.evidence.torque)
    )
    return np.sqrt(np.mean(torque**2, axis=0) / np.maximum(np.mean(whole**2, axis=0), 1e-300))


def _describe_finding(case: _Case, form: Form, share: Array) -> Finding:
    """Describe one cause; before and after are the given URDF without and with it, all the rest as it was found."""
    rig = case.held.rig
    best = case.found.best
    at = form.joint if form.kind.of_joint else rig.joints[int(np.argmax(share))]
    stated = [x for one, x in best.causes.items() if one is not form], list(best.causes.values())
    errors = [measure_errors(case.held, _build_stated_model(case, x)) for x in stated]
    gain = compare_errors(errors[0], errors[1], at)
    before = gain["torque_rmse_before"]
    after = gain["torque_rmse_after"]
    told = form.build(np.where(best.is_known(form), best.values[form], 0.0))
    gained = f"held-out torque error of the given model {before:.3g} → {after:.3g} N m"
    std = dict(zip((name for name, _ in form.start), best.std[form].tolist()))
    return Finding(
        cause=form.kind.name,
        joint=form.place[1],
        parameters=tuple(
            replace(p, std=std.get(p.name, float("nan")), unit=rig.in_units(form.place[1], p.unit))
            for p in best.causes[form].shown()
        ),
        gain=gain,
        false_alarm=case.found.false_alarms[form],
        sentence=f"{rig.in_units(form.place[1], told.told(rig))}; {rig.in_units(at, gained)}",
        experiment=form.kind.experiment,
        rivals=_compare_rivals(case, form),
    )


def _compare_rivals(case: _Case, form: Form) -> tuple[Rival, ...]:
    """Return the most probable rival of each name; noise alone parts it from the finding (Vuong 1989)."""
    best = case.found.best
    rivals = list[Rival]()
    for other in case.found.rivals[form]:
        (new,) = (one for one in other.values if one not in best.values)
        odds = best.compute_odds(other)
        apart = np.linalg.norm(case.response.difference.whitener @ (other.response - best.response))
        rivals.append(
            Rival(
                new.kind.name,
                odds,
                odds * float(np.sqrt(best.dispersion) / max(apart, 1e-12)),
                new.place[1],
            )
        )
    return list_nearest(form.kind.name, rivals)


def _build_stated_model(case: _Case, causes: Sequence[RigEffect]) -> Model:
    """The given URDF with causes in its bodies, and everything else as the diagnosis has it."""
    found = [cause for cause in settle_causes(case.state) if isinstance(cause, RigEffect)]
    return replace(
        build_extended_model(case.state), rig=change_rig(case.held.rig, [*causes, *found])
    )
