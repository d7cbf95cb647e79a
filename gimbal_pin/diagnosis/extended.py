"""The extended model: rig, inertias, friction, found causes and drives as one `Model`, and its torques along a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.diagnosis.evidence import LogStretch
from gimbal_pin.diagnosis.shapes import same
from gimbal_pin.diagnosis.state import State, refit_rig, resize
from gimbal_pin.dynamics.model import Estimated, Model, is_motor_friction
from gimbal_pin.dynamics.reduction import list_units
from gimbal_pin.dynamics.regressor import compute_coupling, compute_inertia_column
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal, Term
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array, find_interval


def compute_acting_torque(model: Model, part: LogStretch) -> Array:
    """Torque that acts along a part of a log, the logged one after the model's drives, N m, (m, n)."""
    out = part.channels.tau.copy()
    for signal in model.drive:
        j = model.rig.joint_index(signal.joint)
        out -= part.lost(signal, out, j, _compute_load(model, part, j) if signal.geared else None)
    return out


def compute_asked_torque(model: Model, part: LogStretch, a: Array | None = None) -> Array:
    """Torque that a model asks for the motion of a part, or with other accelerations a, N m, (m, n)."""
    c = part.channels
    a = c.a if a is None else a
    return model.inverse(
        c.q, c.v, a, part.slide, part.time, part.temperature, c.platform, part.losses
    )


def _compute_load(model: Model, part: LogStretch, joint: int) -> JointLoad:
    """What a joint bears along a part, N m, (m,)."""
    c = part.channels
    sample = part.sample(joint)
    terms = [term for term in model.by_joint[joint] if is_motor_friction(term.effect)]
    brake = np.zeros(len(c.t)) + sum(np.asarray(term.torque(sample)) for term in terms)
    others = np.arange(c.a.shape[1]) != joint
    asked, whole = (compute_asked_torque(model, part, a)[:, joint] for a in (c.a * others, c.a))
    push = compute_coupling(
        compute_inertia_column(model.rig, c.q, joint), joint, model.armature[joint]
    )
    return JointLoad.along(
        brake, asked - brake, c.tau[:, joint], part.still[:, joint], whole - asked, push
    )


def build_extended_model(state: State) -> Model:
    """Return the model that a state has fitted."""
    rig = refit_rig(state.problem, state.fit.theta)
    changes = tuple(cause for cause in settle_causes(state) if isinstance(cause, RigEffect))
    for change in changes:
        rig = change.apply(rig)
    friction = zip(
        state.problem.friction, state.fit.theta[len(state.problem.reduction.independent) :].tolist()
    )
    terms = [Term(effect, (value,)) for effect, value in friction]
    found = [c for c in state.causes if isinstance(c, Effect)]
    terms += [Term(effect, tuple(state.coefficients(effect).tolist())) for effect in found]
    drive = tuple(c for c in state.causes if isinstance(c, Signal))
    return Model(rig, tuple(terms), _collect_estimates(state, terms), drive, changes)


def _collect_estimates(state: State, terms: Sequence[Term]) -> Estimated:
    """Return what the fit knows of base parameters and coefficients, in the order of the model's terms."""
    reduction = state.problem.reduction
    now = state.fit
    rig = state.problem.evidence.rig
    parts = state.problem.evidence.parts
    kept = find_estimated(state)
    symbols = [reduction.names[j].rsplit(".", 1)[1] for j in reduction.independent]
    pairs = [(term.effect, c) for term in terms for c in term.effect.coefficients]
    names = (*reduction.base_names, *(f"{e.joint}.{e.name}.{c.name}" for e, c in pairs))
    measures = (*list_units(symbols), *(rig.in_units(e.joint, c.unit) for e, c in pairs))
    dt = find_interval(part.dt / part.logged.step for part in parts if part.logged is not None)
    lags = tuple(np.broadcast_to(parts[0].late, (rig.n,)).tolist())
    return Estimated(
        names, measures, now.theta[kept], now.covariance[np.ix_(kept, kept)], dt, lags=lags
    )


def find_estimated(state: State) -> Array:
    """Return the places in a fit's theta of what `Estimated` holds: all but rig effects, which the rig has taken in."""
    turned = [state.places(c).start for c in state.causes if isinstance(c, RigEffect)]
    return np.setdiff1d(np.arange(len(state.fit.theta)), turned)


def find_settled(state: State, cause: Cause) -> tuple[Cause, tuple[float, ...]]:
    """Return a chosen cause with its figures, and its coefficients as `Cause.shown` takes them."""
    values = tuple(state.coefficients(cause).tolist()) if isinstance(cause, Effect) else ()
    return next(one for one in settle_causes(state) if same(one, cause)), values


def settle_causes(state: State) -> tuple[Cause, ...]:
    """Return the chosen causes with their figures: a rig effect's small trial turned into what was fitted."""
    out: list[Cause] = []
    for cause in state.causes:
        if not isinstance(cause, RigEffect):
            out.append(cause)
            continue
        fitted: Cause = resize(cause, float(state.coefficients(cause)[0]))
        for twin in [c for c in out if same(c, cause)]:  # another figure of the same
            fitted = replace(
                twin,
                **{s.name: getattr(twin, s.name) or getattr(fitted, s.name) for s in twin.shapes},
            )
            out.remove(twin)
        out.append(fitted)
    return tuple(out)
