"""Rigs, problems and designs that the tests of the room share."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.effects import Effect
from gimbal_pin.excitation import (
    Condition,
    Criterion,
    Envelope,
    Excitation,
    ExcitationColumns,
    ExcitationProblem,
    Series,
    excite,
)
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig


def problem(
    rig: Rig,
    criterion: Criterion | None = None,
    effects: tuple[Effect, ...] = (),
    model: Model | None = None,
) -> ExcitationProblem:
    return ExcitationProblem(
        model or nominal(rig),
        Series(10.0, 5),
        ExcitationColumns.of(rig, effects),
        criterion or Condition(),
        Envelope.of(rig, 0.05),
    )


def differences(function, x: Array, along: Array | None = None) -> Array:
    """Central differences of a function of a vector along its entries, or other directions (k, n), one column each."""
    step = 1e-6
    ways = np.eye(len(x)) if along is None else along
    return np.stack(
        [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in ways], axis=-1
    )


@cache
def designed(name: str, seed: int) -> Excitation:
    return excite(Rig.load(name), starts=1, rng=np.random.default_rng(seed))


def moved(rig: Rig, **changes: object) -> Rig:
    """The rig with the same change to every joint's limits."""
    return replace(rig, limits=tuple(replace(limit, **changes) for limit in rig.limits))


def assert_within(rig: Rig, model: Model, found: Excitation, margin: float = 0.05) -> None:
    """Assert that every limit, whichever is stated, holds at random instants and that one is used up to the margin."""
    t = np.sort(np.random.default_rng(7).uniform(0.0, found.seconds, 20_000))
    motion = found.series.motion(found.coefficients, t)
    tau = model.inverse_dynamics(motion.q, motion.v, motion.a)
    low, high = rig.stops
    low = np.maximum(low, -np.pi)
    high = np.minimum(high, np.pi)
    rates = np.array([(limit.velocity, limit.acceleration) for limit in rig.limits]).T
    channels = np.stack([motion.q - (low + high) / 2, motion.v, motion.a, tau])
    used = np.abs(channels).max(axis=1) - (1 - margin) * np.stack(
        [(high - low) / 2, *rates, rig.tau_max]
    )
    assert used.max() <= 1e-3
    share = max(max(shares.values()) for shares in found.limits_used.values())
    assert share == pytest.approx(1 - margin, abs=0.01)


SLIDER = """<robot name="crane"><link name="rail"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="boom"><inertial><origin xyz="0.2 0 0.1"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-0.3" upper="0.4" effort="40" velocity="1"/></joint>
<joint name="swing" type="continuous"><parent link="cart"/><child link="boom"/><axis xyz="0 1 0"/>
<limit effort="5" velocity="4"/></joint></robot>"""
