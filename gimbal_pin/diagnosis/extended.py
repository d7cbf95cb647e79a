"""The extended model: rig, inertias, friction and found causes as one `Model`, with the drive's signals beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.diagnosis.search import State, refitted
from gimbal_pin.effects import Cause, Effect, RigEffect, Signal, Term
from gimbal_pin.log import Array
from gimbal_pin.model import Model


@dataclass(frozen=True, eq=False)
class Extended:
    """A model, and what the drives do to the torques that are logged.

    Attributes:
        model: Rig, inertias and terms.
        signals: What stands between the logged torque and the one that acts.
    """

    model: Model
    signals: tuple[Signal, ...] = ()

    @property
    def causes(self) -> tuple[Term | Signal, ...]:
        """What `simulation.plant_with` takes on top of the model."""
        return self.signals

    def acting(self, torque: Array, dt: float) -> Array:
        """Torque that acts, N m, (N, n), where `torque` was logged, every `dt` s."""
        out = torque.copy()
        for signal in self.signals:
            j = self.model.rig.joint_index(signal.joint)
            out[:, j] = signal.acting(out[:, j], dt)
        return out


def extended(state: State) -> Extended:
    """Return the model that a state has fitted."""
    rig = refitted(state.problem, state.fit.theta)
    for cause in settled(state):
        if isinstance(cause, RigEffect):
            rig = cause.apply(rig)
    friction = state.problem.friction
    at = len(state.problem.reduction.independent)
    rows = zip(friction, state.fit.theta[at : at + 2 * len(friction)].tolist())
    terms = [Term(effect, (value,)) for effect, value in rows]
    found = [c for c in state.causes if isinstance(c, Effect)]
    terms += [Term(effect, tuple(state.coefficients(effect).tolist())) for effect in found]
    return Extended(Model(rig, tuple(terms)), tuple(c for c in state.causes if isinstance(c, Signal)))


def settled(state: State) -> tuple[Cause, ...]:
    """The chosen causes with their figures: a rig effect's small trial turned into what was fitted."""
    out: list[Cause] = []
    for cause in state.causes:
        if not isinstance(cause, RigEffect):
            out.append(cause)
            continue
        fitted = sized(cause, float(state.coefficients(cause)[0]))
        twin = next((c for c in out if type(c) is type(cause) and c.place == cause.place), None)
        out = [c for c in out if c is not twin] + [fitted if twin is None else joined(twin, fitted)]
    return tuple(out)


def sized(cause: RigEffect, value: float) -> RigEffect:
    """Return a rig effect with its one shape parameter that is not zero set to a value within its bounds."""
    shape = next(s for s in cause.shapes if getattr(cause, s.name))
    return replace(cause, **{shape.name: float(np.clip(value, shape.lower, shape.upper))})


def joined(a: Cause, b: Cause) -> Cause:
    """Return a rig effect with the shape parameters of both."""
    return replace(a, **{s.name: getattr(a, s.name) or getattr(b, s.name) for s in a.shapes})
