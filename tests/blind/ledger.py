"""Where the torque of a run went: rigid body, baseline friction, effect; means over each sample's hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rigs import Array
from .rnea import inverse_dynamics

AT_REST = 1e-3
"""Slower than this (rad/s), a joint counts as standing: no rate sensor tells the difference."""


@dataclass(frozen=True)
class Ledger:
    """command = rigid + viscous + `dry` + `effect`, each (N, n), N m, a mean over [t, t + period).

    `q v a` are the encoder's angle and its rates over the same hold; `dry` is the baseline's Coulomb share, which at
    standstill is whatever the balance needs up to its limit; `effect` is everything that a perfectly refitted rigid
    model with Coulomb and viscous friction on a fixed base leaves."""

    q: Array
    v: Array
    a: Array
    command: Array
    dry: Array
    effect: Array


def baseline_dry(coulomb, trace):
    """F_c sign(v⁺) where it slides, and at rest the friction that acted, up to F_c."""
    at_rest = np.abs(trace.step_end_v) < AT_REST
    acted = np.clip(trace.step_dry, -coulomb, coulomb)
    return np.where(at_rest, acted, coulomb * np.sign(trace.step_end_v))


def settle(world, trace):
    """Split the commands of a run by the reference rig's inverse dynamics, step by step."""
    rig = world.reference
    shape = (len(trace.t), -1, world.joints)

    def held(x):
        return x.reshape(shape).mean(axis=1)

    q = world.encoder(trace.step_q)
    rigid = held(inverse_dynamics(rig, q, trace.step_v, trace.step_a))
    viscous = held(rig.viscous * trace.step_v)
    dry = held(baseline_dry(rig.coulomb, trace))
    effect = trace.command - rigid - viscous - dry
    motion = map(held, (q, trace.step_v, trace.step_a))
    return Ledger(*motion, trace.command, dry, effect)
