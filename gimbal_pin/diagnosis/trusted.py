"""Findings where the URDF is trusted: what sets its bodies apart from the refitted ones has a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from gimbal_pin.diagnosis.bodies import Bodies, Fitted, Kind, altered
from gimbal_pin.diagnosis.composed import ENTER, by_form, chance, chosen, same
from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.engine.rivals import APART
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.extended import Extended, extended, settled
from gimbal_pin.diagnosis.finding import Diagnosis, Finding, Rival, Slight, overall
from gimbal_pin.diagnosis.given import TOLD, given
from gimbal_pin.diagnosis.heavier import inertias
from gimbal_pin.diagnosis.heldout import CONFIRMED, rollout_rmse, torque_rmse
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.log import Array
from gimbal_pin.parameter import Parameter
from gimbal_pin.rig import Rig

TRUSTED = "trusted"
"""What a rig's YAML says under `inertia` if differences from its URDF are findings."""
SHARE = 0.0015
"""Torque of a cause over the joint's, rms, under which it does not matter."""
FAINT = 0.05
"""Torque of a cause over that of the strongest, under which it may be what the strongest one's model gets wrong: it
counts where it takes up what that one leaves as no error of a form would let it."""


def compared(found: Diagnosis, state: State, causes: Mapping[str, type[Cause]]) -> Diagnosis:
    """Add what sets the given model apart from the refitted one; as findings, if the rig's URDF is trusted.

    Args:
        found: The diagnosis so far.
        state: The fit with all its findings in.
        causes: The causes to look for.
    """
    rig = state.problem.evidence.rig
    apart = Difference.of_fit(rig, state.problem.reduction, state.fit)
    heavier = inertias(
        apart, state.problem.inertia, [one for one in found.untestable if causes[one.cause].like_inertia]
    )
    found = replace(found, given=given(apart), notes=(*found.notes, *heavier))
    if rig.config.inertia != TRUSTED or found.held is None:
        return found
    bodies = Bodies(apart)
    fitted, tried = chosen(bodies, causes)
    size = {kind: shares(state, bodies, fitted, kind) for kind in fitted.kinds}
    most = max((float(x.max()) for x in size.values()), default=0.0)
    case = Case(state, bodies, fitted, tried, found.held)
    large = [kind for kind in fitted.kinds if size[kind].max() > SHARE]
    material = [kind for kind in large if size[kind].max() > FAINT * most or outright(case, kind)]
    sure = [kind for kind in material if confirmed(case, kind)]
    more = [finding(case, kind, size[kind]) for kind in sure]
    less = [Slight(*named(kind), float(size[kind].max())) for kind in fitted.kinds if kind not in material]
    every = sorted([*found.findings, *more], key=lambda one: -one.explained_share)
    said = overall([one.status for one in every], list(found.residual.values()))
    return replace(found, findings=tuple(every), verdict=said, immaterial=(*found.immaterial, *less))


class Case(NamedTuple):
    """What a finding is described from.

    Attributes:
        state: The fit to the training part.
        bodies: The difference that was explained.
        fitted: By what.
        tried: What else could have explained it.
        held: The held-out part.
    """

    state: State
    bodies: Bodies
    fitted: Fitted
    tried: Sequence[Sequence[Kind]]
    held: Evidence


def named(kind: Kind) -> tuple[str, str | None]:
    """Name of the cause, and its joint."""
    return kind.of.name, kind.joint if kind.of.of_joint else None


def shares(state: State, bodies: Bodies, fitted: Fitted, kind: Kind) -> Array:
    """Torque that a kind makes, as a share of each joint's, (n,)."""
    change = bodies.response(fitted.cause(kind).apply(bodies.found.rig))[0]
    torque = np.concatenate([columns @ change for columns in state.problem.rigid_full])
    level = np.sqrt(np.mean(np.concatenate(state.problem.evidence.torque) ** 2, axis=0)) + 1e-12
    return np.asarray(np.sqrt(np.mean(torque**2, axis=0)) / level)


def outright(case: Case, kind: Kind) -> bool:
    """Whether a cause takes up what the others leave beyond what it would of an error of their forms."""
    rest = [other for other in case.fitted.kinds if other != kind]
    less = case.bodies.fitted(rest, case.fitted.begun(rest))
    return less is not None and by_form(less, case.fitted) * len(case.tried) < ENTER


def finding(case: Case, kind: Kind, size: Array) -> Finding:
    """Describe one cause; before and after are the given URDF without and with it, all the rest as it was found."""
    fitted, rest = case.fitted, [other for other in case.fitted.kinds if other != kind]
    joints = case.held.rig.joints
    at = kind.joint if kind.of.of_joint else joints[int(np.argmax(size))]
    less = case.bodies.fitted(rest, fitted.begun(rest)) if rest else case.bodies.nothing()
    rivals = rivals_of(case, kind, rest)
    gain = gains(case, kind, joints.index(at))
    alike = (kind.of.name, *(rival.cause for rival in rivals if rival.z < APART))
    before, after = gain["torque_rmse_before"], gain["torque_rmse_after"]
    told = spoken(fitted, kind).told(case.held.rig)
    change = f"held-out torque error of the given model {before:.3g} → {after:.3g} N m"
    return Finding(
        cause=kind.of.name,
        joint=named(kind)[1],
        status="ambiguous" if len(alike) > 1 else "named",
        alike=alike,
        parameters=figures(fitted, kind),
        gain=gain,
        p_value=min(1.0, chance(less, fitted) * len(case.tried)) if less else 0.0,
        selection_frequency=float(min((norm.cdf(rival.z) for rival in rivals), default=1.0)),
        explained_share=1 - after**2 / max(before**2, 1e-300),
        visible_fraction=1.0,
        rivals=rivals,
        sentence=f"{told}; {change}",
        next_experiment=kind.of.experiment if len(alike) > 1 else None,
    )


def spoken(fitted: Fitted, kind: Kind) -> RigEffect:
    """Return the cause with those of its figures that stand clear of their deviations."""
    values, std = fitted.values[fitted.kinds.index(kind)], fitted.std(kind)
    clear = np.abs(values) > TOLD * np.nan_to_num(std, nan=np.inf)
    return kind.at(np.where(clear, values, 0.0).tolist() if clear.any() else values.tolist())


def figures(fitted: Fitted, kind: Kind) -> tuple[Parameter, ...]:
    """The cause's parameters with standard deviations; none for what was profiled."""
    std = dict(zip((shape.name for shape in kind.free), fitted.std(kind).tolist()))
    return tuple(replace(p, std=std.get(p.name, float("nan"))) for p in fitted.cause(kind).shown())


def rivals_of(case: Case, kind: Kind, rest: Sequence[Kind]) -> tuple[Rival, ...]:
    """Put every other cause in a kind's place: difference in log-likelihood, and its z for the two predictions."""
    best: dict[str, Rival] = {}
    found, whiten = case.fitted, case.bodies.found.whitener
    noise = np.sqrt(case.bodies.found.inflation * found.excess)
    for forms in (forms for forms in case.tried if forms[0].of is not kind.of):
        for fit in instead(case, kind, rest, forms):
            delta = (fit.cost - found.cost) / (2 * found.excess) - (found.freedom - fit.freedom)
            apart = float(np.linalg.norm(whiten @ (fit.response - found.response))) / noise
            new = Rival(forms[0].of.name, delta, delta / max(apart, 1e-12))
            best[new.cause] = min((new, best.get(new.cause, new)), key=lambda one: one.z)
    return tuple(sorted(best.values(), key=lambda one: one.z))


def instead(case: Case, kind: Kind, rest: Sequence[Kind], forms: Sequence[Kind]) -> list[Fitted]:
    """Fits without a kind: another cause in its place, or one beside it that takes its part in another form.

    A weight bolted on moves the centre of mass, and so do a heavier payload and a shift of it: one for the two.
    """
    others = [one for one in rest if not same(forms[0], one)]
    plain = next(own for own in case.tried if same(own[0], kind))[0]
    beside = [plain] if len(others) == len(rest) and len(kind.free) > len(plain.free) else []
    kept = [others, *([*others, one] for one in beside)]
    fits = [case.bodies.best(each, forms, known=case.fitted) for each in kept]
    return [one for one in fits if one is not None]


def gains(case: Case, kind: Kind, joint: int) -> dict[str, float]:
    """Held-out errors of the given URDF without and with one cause at a joint."""
    models, out = models_of(case, kind), dict[str, float]()
    for name, figure in (("torque_rmse", torque_rmse), ("rollout_rmse", rollout_rmse)):
        out |= {f"{name}_{when}": float(figure(case.held, m)[joint]) for when, m in zip(("before", "after"), models)}
    return out


def models_of(case: Case, kind: Kind) -> tuple[Extended, Extended]:
    """The given URDF without and with one cause, and with all the others."""
    found = case.fitted
    rest = [(k, x) for k, x in zip(found.kinds, found.values) if k != kind]
    return stated(case, [k for k, _ in rest], [x for _, x in rest]), stated(case, found.kinds, found.values)


def confirmed(case: Case, kind: Kind) -> bool:
    """Whether the given URDF predicts any joint's torque better with a cause, on the part that it was found in."""
    before, after = (torque_rmse(case.state.problem.evidence, model) for model in models_of(case, kind))
    return bool(np.any(before > CONFIRMED * after))


def stated(case: Case, kinds: Sequence[Kind], values: Sequence[Array]) -> Extended:
    """The given URDF with causes of these kinds in its bodies, and everything else as the diagnosis has it."""
    rig: Rig = altered(case.bodies.found.rig, kinds, values)
    for cause in settled(case.state):
        if isinstance(cause, RigEffect):
            rig = cause.apply(rig)
    full = extended(case.state)
    return replace(full, model=replace(full.model, rig=rig))
