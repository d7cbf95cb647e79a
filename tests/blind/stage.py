"""The stage of a log: which rig, moved how, with which joints left out, of the plain kind and as people have it."""

from dataclasses import replace

import numpy as np

from .control import draw_gains, draw_soft_gains, feed_forward
from .excitation import Habit, draw_reference, load, repeated, turning_path
from .plan import ALIGNED
from .rig_draw import locked, nominal
from .scene import FINE_STEP, Scene
from .sensors import control_rate, draw_drive_sensors, draw_sensors

LONG_S = 120.0
LONG_STEP = 1e-3
MANY = 5
MANY_STEP = 0.5e-3
"""Steps (s) of runs that would take too long: of more than LONG_S, of MANY joints or more."""
CLEAR_OF_IT = 8e-3
"""Time (s) from which on a shift of channels does not take up an effect."""
CREEP = 0.03
"""Speed (rad/s) at which a controller's friction torque has nearly all of its size."""
ENOUGH = 0.9
"""Share of its limits beyond which a joint that turns is slowed down."""


def plain_scene(plan, rig, streams):
    """A plan's scene by its random streams."""
    sensors = draw_sensors(streams["sensors"], plan.level, plan.rate)
    reference = draw_reference(
        streams["motion"], rig, plan.excitation, plan.seconds, plan.rate, Habit()
    )
    kp, kd, trust = draw_gains(streams["control"], rig, reference)
    forward = feed_forward(nominal(streams["control"], rig, 0.15), reference, trust)
    seed = int(streams["noise"].integers(2**31))
    return Scene(rig, reference, kp, kd, forward, sensors, plan.rate, seed)


def _turning_reference(plan, rig, joint, rate, held, seed):
    """As many turns as are wanted, or half of them, and so on, until the motors can do it."""
    t = np.arange(round(plan.seconds * rate)) / rate
    for halvings in range(6):
        rng = np.random.default_rng(seed)
        path = turning_path(rng, t, plan.turns * 0.5**halvings)
        habit = Habit(held, turning=joint, path=path)
        reference = draw_reference(rng, rig, plan.excitation, plan.seconds, rate, habit)
        if (load(rig, reference.q, 1.0 / rate) < ENOUGH).all():
            break
    return reference


def _friction_forward(plan, rig, reference, rng):
    """What the controller adds against friction, N m (N, n): always on arms, whose loops are soft, else at times."""
    share = rng.uniform(0.6, 0.95) if plan.arm or rng.random() < 0.4 else 0.0
    return share * (rig.coulomb * np.tanh(reference.dq / CREEP) + rig.viscous * reference.dq)


def drive_scene(plan, full, streams):
    """The rig of the URDF and the scene: the same rig, or the one that is left where a joint is bolted."""
    rng = streams["motion"]
    rate = control_rate(plan.rate)
    idle, turning = (int(x) for x in rng.permutation(plan.axes)[[0, -1]])
    if plan.turns:
        speed = max(full.velocity_limit, 2.5 * 2.0 * np.pi * plan.turns / plan.seconds)
        full = replace(full.with_link(turning, continuous=True), velocity_limit=speed)
    gone = plan.idle in ("unlogged", "bolted")
    rig = locked(full, idle) if gone else full
    if plan.idle == "bolted":
        full = full.with_link(idle, fixed=True)
    held = (idle,) if plan.idle == "held" else ()
    every = round(rate / plan.rate)
    samples = round(plan.seconds * plan.rate) // plan.repeats * plan.repeats * every
    if plan.turns:
        place = turning - int(gone and idle < turning)
        reference = _turning_reference(plan, rig, place, rate, held, int(rng.integers(2**31)))
    else:
        habit = repeated(held, samples, plan.repeats, rate)
        reference = draw_reference(rng, rig, plan.excitation, samples / rate, rate, habit)
    kp, kd, trust = draw_soft_gains(streams["control"], rig, reference, held)
    forward = feed_forward(nominal(streams["control"], rig, 0.15), reference, trust)
    forward += _friction_forward(plan, rig, reference, streams["control"])
    sensors = draw_drive_sensors(streams["sensors"], plan.rate, plan.aligned)
    step = LONG_STEP if plan.seconds > LONG_S else MANY_STEP if plan.axes >= MANY else FINE_STEP
    seed = int(streams["noise"].integers(2**31))
    return full, Scene(rig, reference, kp, kd, forward, sensors, rate, seed, held, every, step)


def clear_of_alignment(effect):
    """A delay or lag that is too long to be taken for a shift between channels."""
    if effect.cause not in ALIGNED:
        return effect
    value = float(getattr(effect, effect.grows))
    return effect.scaled(CLEAR_OF_IT / value) if value < CLEAR_OF_IT else effect
