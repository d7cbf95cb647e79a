"""Causes planted in a model: the plant that it becomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gimbal_pin.effects import RigEffect, Signal, Term
from gimbal_pin.errors import UsageError
from gimbal_pin.model import Model, friction_effects

Planted = Term | Signal | RigEffect


class Altered(NamedTuple):
    """A plant with causes planted in it: what `simulate` takes as `plant` and `drive`."""

    plant: Model
    drive: tuple[Signal, ...]


def plant_with(model: Model, causes: Sequence[Planted]) -> Altered:
    """Return the plant that a model becomes with some causes on top: more terms, signals in its drive, its rig changed.

    Signals stand in the order in which the command passes them. Bristles are a joint's dry friction: they take the
    place of its Coulomb friction.

    Raises:
        UsageError: A joint that the rig does not have, or dry friction that would push somewhere.
    """
    rig, changes = model.rig, tuple(cause for cause in causes if isinstance(cause, RigEffect))
    for cause in causes:
        if isinstance(cause, RigEffect):
            rig = cause.apply(rig)
        else:
            rig.joint_index((cause.effect if isinstance(cause, Term) else cause).joint)
    added = tuple(cause for cause in causes if isinstance(cause, Term))
    bristled = {term.effect.joint for term in added if term.effect.bristly and any(term.values)}
    bent = {effect for effect in friction_effects(sorted(bristled)) if effect.dry}
    terms = (*(replace(term, values=(0.0,)) if term.effect in bent else term for term in model.terms), *added)
    plant = replace(model, rig=rig, terms=terms, estimated=None, changes=(*model.changes, *changes))
    check_dry(plant)
    return Altered(plant, tuple(cause for cause in causes if isinstance(cause, Signal)))


def check_dry(plant: Model) -> None:
    """Raise `UsageError` if a joint's dry friction at rest, unloaded, is negative anywhere on a turn."""
    q = np.repeat(np.linspace(-np.pi, np.pi, 2001)[:, None], plant.rig.n, axis=1)
    zero = np.zeros_like(q)
    for t in (0.0, 1e6):
        for way in (1.0, -1.0):
            least = plant.level(q, zero, zero, zero, np.full(len(q), t), way + zero).min(axis=0)
            for joint, level in zip(plant.rig.joints, least.tolist()):
                if level < -1e-9:
                    what = f"has a dry friction of {level:.3g} N m somewhere: it would push"
                    raise UsageError(f"joint {joint}", what, "plant less of it, or more Coulomb friction")
