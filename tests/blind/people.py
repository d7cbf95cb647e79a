"""The stage of a log as people have it: which rig, moved how, with which joints left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .arm_draw import locked
from .control import draw_soft_gains, feed_forward
from .drive_sensors import control_rate, draw_drive_sensors
from .excitation import draw_reference, load
from .habits import Habit, repeated, turning_path
from .plan import ALIGNED
from .rig_draw import nominal
from .scene import FINE_STEP, Scene

LONG_S, LONG_STEP = 120.0, 1e-3
MANY, MANY_STEP = 5, 0.5e-3
"""Steps (s) of runs that would take too long: of more than LONG_S, of MANY joints or more."""
CLEAR_OF_IT = 8e-3
"""Time (s) from which on a shift of channels does not take up an effect."""
CREEP = 0.03
"""Speed (rad/s) at which a controller's friction torque has nearly all of its size."""
ENOUGH = 0.9
"""Share of its limits beyond which a joint that turns is slowed down."""


def _endless(rig, joint, speed):
    """The rig with a joint that turns on and on, and motors for it."""
    links = list(rig.links)
    links[joint] = replace(links[joint], continuous=True)
    return replace(rig, links=tuple(links), velocity_limit=max(rig.velocity_limit, 2.5 * speed))


def _turning_reference(plan, rig, joint, rate, held, seed):
    """As many turns as are wanted, or half of them, and so on, until the motors can do it."""
    turns = plan.turns
    t = np.arange(round(plan.seconds * rate)) / rate
    for _ in range(6):
        rng = np.random.default_rng(seed)
        habit = Habit(held=held, turning=joint, path=turning_path(rng, t, turns))
        reference = draw_reference(rng, rig, plan.excitation, plan.seconds, rate, habit)
        if (load(rig, reference.q, 1.0 / rate) < ENOUGH).all():
            break
        turns *= 0.5
    return reference


def _friction_forward(plan, rig, reference, rng):
    """What the controller adds against friction, N m (N, n): always on arms, whose loops are soft, else at times."""
    share = rng.uniform(0.6, 0.95) if plan.arm or rng.random() < 0.4 else 0.0
    return share * (rig.coulomb * np.tanh(reference.dq / CREEP) + rig.viscous * reference.dq)


def stage(plan, full, streams):
    """The rig of the URDF and the scene: the same rig, or the one that is left where a joint is bolted."""
    rng = streams["motion"]
    rate = control_rate(plan.rate)
    idle, turning = (int(x) for x in rng.permutation(plan.axes)[[0, -1]])
    if plan.turns:
        full = _endless(full, turning, 2.0 * np.pi * plan.turns / plan.seconds)
    gone = plan.idle in ("unlogged", "bolted")
    rig = locked(full, idle) if gone else full
    if plan.idle == "bolted":
        links = (replace(link, fixed=i == idle) for i, link in enumerate(full.links))
        full = replace(full, links=tuple(links))
    held = (idle,) if plan.idle == "held" else ()
    every = round(rate / plan.rate)
    samples = round(plan.seconds * plan.rate) // plan.repeats * plan.repeats * every
    if plan.turns:
        place = turning - int(gone and idle < turning)
        reference = _turning_reference(plan, rig, place, rate, held, int(rng.integers(2**31)))
    else:
        habit = Habit(held=held)
        if plan.repeats > 1:
            habit = replace(repeated(samples, plan.repeats, rate), held=held)
        reference = draw_reference(rng, rig, plan.excitation, samples / rate, rate, habit)
    gains = draw_soft_gains(streams["control"], rig, reference, held)
    forward = feed_forward(nominal(streams["control"], rig, 0.15), reference, gains)
    forward += _friction_forward(plan, rig, reference, streams["control"])
    sensors = draw_drive_sensors(streams["sensors"], plan.rate, plan.aligned)
    step = LONG_STEP if plan.seconds > LONG_S else MANY_STEP if plan.axes >= MANY else FINE_STEP
    seed = int(streams["noise"].integers(2**31))
    return full, Scene(rig, reference, gains, forward, sensors, rate, seed, held, step)


def given(plan, full, rng):
    """The URDF's rig: exact where it is to be trusted, else off by 0–20 %, and its camera by more."""
    if plan.trusted:
        return full
    rig = nominal(rng, full, rng.uniform(0.0, 0.2))
    return rig.with_payload(rig.payload.inertia.times(1.0 + plan.camera_off))


def clear_of_alignment(effect):
    """A delay or lag that is too long to be taken for a shift between channels."""
    if effect.cause not in ALIGNED:
        return effect
    value = float(getattr(effect, effect.grows))
    return effect.scaled(CLEAR_OF_IT / value) if value < CLEAR_OF_IT else effect
