"""The extended model: rig, inertias, friction and found causes as one `Model`, with the drive's signals beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.diagnosis.evidence import Part
from gimbal_pin.diagnosis.state import State, refit_rig, resize
from gimbal_pin.dynamics.model import Estimated, Model, is_motor_friction
from gimbal_pin.dynamics.reduction import list_units
from gimbal_pin.dynamics.regressor import compute_coupling, compute_inertia_column
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal, Term
from gimbal_pin.effects.signal import JointLoad
from gimbal_pin.log.log import Array, find_interval
from gimbal_pin.rig.brief import brief


@dataclass(frozen=True, eq=False)
class Extended:
    """A model as it stands against logs: its drives act on the torques that are logged.

    Attributes:
        model: Rig, inertias, terms and drives.
    """

    model: Model

    __repr__ = brief

    def acting(self, part: Part) -> Array:
        """Torque that acts along a part of a log, N m, (m, n)."""
        out = part.channels.tau.copy()
        for signal in self.model.drive:
            j = self.model.rig.joint_index(signal.joint)
            out -= part.lost(signal, out, j, self.borne(part, signal, out[:, j]) if signal.geared else None)
        return out

    def borne(self, part: Part, signal: Signal, command: Array) -> JointLoad:
        """What a signal's joint bears along a part, N m, (m,)."""
        joint = self.model.rig.joint_index(signal.joint)
        c, sample = part.channels, part.sample(joint)
        terms = [term for term in self.model.by_joint[joint] if is_motor_friction(term.effect)]
        brake = np.zeros(len(c.t)) + sum(np.asarray(term.torque(sample)) for term in terms)
        others = np.arange(c.a.shape[1]) != joint
        asked, whole = (
            self.model.inverse(c.q, c.v, a, part.slide, part.time, part.temperature, c.platform, part.losses)[:, joint]
            for a in (c.a * others, c.a)
        )
        push = compute_coupling(compute_inertia_column(self.model.rig, c.q, joint), joint, self.model.armature[joint])
        return JointLoad.along(brake, asked - brake, c.tau[:, joint], part.still[:, joint], whole - asked, push)


def extended(state: State) -> Extended:
    """Return the model that a state has fitted."""
    rig = refit_rig(state.problem, state.fit.theta)
    changes = tuple(cause for cause in settled(state) if isinstance(cause, RigEffect))
    for change in changes:
        rig = change.apply(rig)
    friction = state.problem.friction
    at = len(state.problem.reduction.independent)
    rows = zip(friction, state.fit.theta[at : at + 2 * len(friction)].tolist())
    terms = [Term(effect, (value,)) for effect, value in rows]
    found = [c for c in state.causes if isinstance(c, Effect)]
    terms += [Term(effect, tuple(state.coefficients(effect).tolist())) for effect in found]
    drive = tuple(c for c in state.causes if isinstance(c, Signal))
    model = Model(rig, tuple(terms), estimated(state, terms), drive, changes)
    return Extended(model)


def estimated(state: State, terms: Sequence[Term]) -> Estimated:
    """Return what the fit knows of base parameters and coefficients, in the order of the model's terms."""
    reduction, now = state.problem.reduction, state.fit
    turned = {state.places(c).start for c in state.causes if isinstance(c, RigEffect)}
    kept = [k for k in range(len(now.theta)) if k not in turned]
    symbols = [reduction.names[j].rsplit(".", 1)[1] for j in reduction.independent]
    rig, pairs = state.problem.evidence.rig, [(t.effect, c) for t in terms for c in t.effect.coefficients]
    coefficients = [(f"{e.joint}.{e.name}.{c.name}", rig.in_units(e.joint, c.unit)) for e, c in pairs]
    names = (*reduction.base_names, *(name for name, _ in coefficients))
    measures = (*list_units(symbols), *(unit for _, unit in coefficients))
    parts = state.problem.evidence.parts
    dt = find_interval(part.dt / part.logged.step for part in parts if part.logged is not None)
    return Estimated(names, measures, now.theta[kept], now.covariance[np.ix_(kept, kept)], dt)


def settled(state: State) -> tuple[Cause, ...]:
    """The chosen causes with their figures: a rig effect's small trial turned into what was fitted."""
    out: list[Cause] = []
    for cause in state.causes:
        if not isinstance(cause, RigEffect):
            out.append(cause)
            continue
        fitted = resize(cause, float(state.coefficients(cause)[0]))
        twin = next((c for c in out if type(c) is type(cause) and c.place == cause.place), None)
        out = [c for c in out if c is not twin] + [fitted if twin is None else joined(twin, fitted)]
    return tuple(out)


def joined(a: Cause, b: Cause) -> Cause:
    """Return a rig effect with the shape parameters of both."""
    return replace(a, **{s.name: getattr(a, s.name) or getattr(b, s.name) for s in a.shapes})
