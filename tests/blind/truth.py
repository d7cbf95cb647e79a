"""What is true of a case, as JSON: for the scorer's eyes only."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from .calibrate import share_of, trial
from .coloured import Spectrum, seen
from .effects import OUTSIDE, TRUSTED, Effect
from .ledger import Ledger
from .plan import Plan
from .plant import Trace
from .rigs import Array
from .scene import Scene
from .visibility import projected
from .world import World

DROWNED = 0.2
"""Where noise is this share of the smoothed acceleration, naming `acceleration-noise` is no false finding."""


@dataclass(frozen=True)
class Run:
    """A plan as it was played: on which stage, with which effects, and where the torque went."""

    plan: Plan
    scene: Scene
    effects: tuple[Effect, ...]
    world: World
    trace: Trace
    ledger: Ledger


@dataclass(frozen=True)
class Blur:
    """What sensor noise does to each joint, (n,): torque balance (N m rms, smoothed) and share of the acceleration;
    `noise`: its spectrum, where it is not white."""

    floor: Array
    acceleration: Array
    noise: Spectrum | None = None


def describe(run, damage, blur):
    """Everything about a case, keys as they stand in truth.json."""
    plan = run.plan
    rig = run.scene.rig
    alone = (run.world, run.ledger) if len(run.effects) == 1 else None
    pairs = zip(run.effects, plan.hidden, strict=True)
    return {
        "schema": 1,
        "plan": asdict(plan),
        "rig": rig.name,
        "joints": list(rig.joints),
        "stratum": plan.stratum,
        "faults": _faults(run, blur),
        "data": _data(plan, damage),
        "causes": [_cause(run, effect, hidden, alone, blur) for effect, hidden in pairs],
        "noise_floor": _by_joint(rig, blur.floor),
        "sensors": asdict(run.scene.sensors),
    }


def _faults(run, blur):
    """Data causes that are true of this log: planted, or by its sensors."""
    planted = [run.plan.data[0]] if run.plan.data else []
    drowned = ["acceleration-noise"] if bool((blur.acceleration > DROWNED).any()) else []
    return sorted({*run.scene.sensors.faults, *planted, *drowned})


def _data(plan, damage):
    if plan.data is None:
        return None
    cause, form = plan.data
    return {"cause": cause, "form": form, "parameters": damage.parameters}


def _cause(run, effect, hidden, alone, blur):
    """What is true of one effect; where several act, its size is that of a trial with it alone."""
    scene = run.scene
    rig = run.scene.rig
    world, ledger = alone if alone is not None else trial(scene, effect)
    left = projected(world.reference, ledger, scene.rate, effect.cause in TRUSTED)
    clear = left / np.maximum(blur.floor, 1e-12)
    if blur.noise is not None:
        clear = seen(world.reference, ledger, blur.noise, scene.rate, effect.cause in TRUSTED)
    joint = None if effect.joint is None else rig.joints[effect.joint]
    foreign = effect.form in effect.foreign
    return {
        "cause": effect.cause,
        "form": effect.form,
        "joint": joint,
        "foreign": foreign,
        "outside": type(effect) in OUTSIDE,
        "kin": list(effect.kin),
        "parameters": effect.parameters(),
        "comparable": not foreign,
        "target_share": hidden.share,
        "share": share_of(effect, ledger, scene.rate),
        "projected_rms": _by_joint(rig, left),
        "snr": _by_joint(rig, clear),
    }


def _by_joint(rig, values):
    return {joint: float(value) for joint, value in zip(rig.joints, values, strict=True)}
