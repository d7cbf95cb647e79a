"""Causes planted in a model: the plant that it becomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from gimbal_pin.dynamics.model import Model, build_friction_effects, is_motor_friction
from gimbal_pin.effects import Effect, RigEffect, Signal, Term
from gimbal_pin.errors import UsageError

Planted = Term | Signal | RigEffect
FASTEST_RATE = 10.0
"""Rate up to which friction of a joint without a limit is looked at, rad/s."""
RATES_TRIED = 10
"""How many rates are looked at, over three decades: friction that sets in or dies away at a rate does so over one."""


class Altered(NamedTuple):
    """A plant with causes planted in it: what `simulate` takes as `plant` and `drive`."""

    plant: Model
    drive: tuple[Signal, ...]


def plant_with(model: Model, causes: Sequence[Planted]) -> Altered:
    """Return the plant that a model becomes with some causes on top: more terms, signals in its drive, its rig changed.

    Signals stand in the order in which the command passes them. Bristles are a joint's dry friction: they take the
    place of its Coulomb friction.

    Raises:
        UsageError: A joint that the rig does not have, or friction that would push somewhere.
    """
    rig = model.rig
    changes = tuple(cause for cause in causes if isinstance(cause, RigEffect))
    for cause in causes:
        if isinstance(cause, RigEffect):
            rig = cause.apply(rig)
        else:
            rig.joint_index((cause.effect if isinstance(cause, Term) else cause).joint)
    added = tuple(cause for cause in causes if isinstance(cause, Term))
    bristled = {term.effect.joint for term in added if term.effect.bristly and any(term.values)}
    bent = {effect for effect in build_friction_effects(sorted(bristled)) if effect.dry}
    terms = (
        *(replace(term, values=(0.0,)) if term.effect in bent else term for term in model.terms),
        *added,
    )
    plant = replace(model, rig=rig, terms=terms, estimated=None, changes=(*model.changes, *changes))
    _check_dissipation(plant)
    return Altered(plant, tuple(cause for cause in causes if isinstance(cause, Signal)))


def _check_dissipation(plant: Model) -> None:
    """Raise `UsageError` if a joint's friction, unloaded, is negative anywhere on a turn, at rest or up to its limit.

    ``way τ(q, way |v|) ≥ 0`` in either direction: what brakes less one way than viscous and Coulomb friction brake may
    do so, and what pushes would drive the joint by itself.
    """
    q = np.repeat(np.linspace(-np.pi, np.pi, 2001)[:, None], plant.rig.n, axis=1)
    friction = replace(
        plant, terms=tuple(term for term in plant.terms if _is_friction(term.effect)), changes=()
    )
    fastest = np.minimum([limits.velocity for limits in plant.rig.limits], FASTEST_RATE)
    zero = np.zeros_like(q)
    for t, share, way in product(
        (0.0, 1e6), (0.0, *np.geomspace(1e-3, 1.0, RATES_TRIED)), (1.0, -1.0)
    ):
        v = way * share * fastest
        least = (
            way * friction.passive(q, zero + v, zero, way + zero, zero, np.full(len(q), t))
        ).min(axis=0)
        for joint, rate, level in zip(plant.rig.joints, v.tolist(), least.tolist()):
            if level < -1e-9:
                where = f"at {rate:.3g} rad/s" if share else "somewhere"
                what = f"has a {'' if share else 'dry '}friction of {level:.3g} N m {where}: it would push"
                raise UsageError(
                    f"joint {joint}", what, "plant less of it, or more Coulomb friction"
                )


def _is_friction(effect: Effect) -> bool:
    """Whether an effect is friction that knows no bristles: theirs push as they unbend."""
    return is_motor_friction(effect) or effect.dry or effect.rising
