"""`hide`: a plan becomes a rig's files, a log, and the truth about it, as JSON: for the scorer's eyes only."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from . import logbook, stage
from .effects import CATALOGUE, OUTSIDE, TRUSTED, Effect, PlatformMotion, diagonal
from .ledger import Ledger, settle
from .plan import DrivePlan, Plan
from .plant import Trace
from .rig_draw import draw_arm, draw_rig, nominal
from .rigs import Array, Rig
from .scene import Scene, calibrate, share_of, trial
from .visibility import Channels, Spectrum, noise_floor, projected, seen
from .world import World

LONGEST_TRIAL_S = 60.0
"""Effects are made as strong as wanted on no more than this of a run."""
STREAMS = ("rig", "motion", "control", "sensors", "effects", "noise", "log", "damage", "nominal")
DROWNED = 0.2
"""Where noise is this share of the smoothed acceleration, naming `acceleration-noise` is no false finding."""


@dataclass(frozen=True)
class Case:
    """A hidden case: the rig as its URDF has it, the log, and the truth (JSON)."""

    plan: Plan
    given: Rig
    encoder_bits: int
    log: dict[str, Array]
    truth: dict[str, Any]


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


def _joint(scene, hidden):
    """The joint that the plan's place falls on; for friction by gravity's load, the one with the most of it."""
    moving = [joint for joint in range(len(scene.rig.links)) if joint not in scene.still]
    if hidden.form in ("gravity", "bearing"):
        return moving[int(scene.gravity()[moving].argmax())]
    return moving[min(int(hidden.place * len(moving)), len(moving) - 1)]


def _effect(scene, hidden, rng):
    """The effect, made as strong as wanted."""
    context = scene.context(_joint(scene, hidden), hidden.share)
    guess = CATALOGUE[hidden.cause].draw(rng, context, hidden.form)
    return calibrate(scene.first(LONGEST_TRIAL_S), guess, hidden.share)


def hide(plan):
    """Simulate a plan. The same plan gives the same case, to the last bit.

    Raises: PlantDivergedError when the controller cannot hold the rig with this effect at any strength."""
    children = np.random.SeedSequence(plan.seed).spawn(len(STREAMS))
    streams = dict(zip(STREAMS, map(np.random.default_rng, children)))
    drive = isinstance(plan, DrivePlan)
    rig = (draw_arm if drive and plan.arm else draw_rig)(streams["rig"], plan.axes)
    if any(hidden.cause == "off-diagonal-inertia" for hidden in plan.hidden):
        rig = diagonal(rig)
    if drive:
        rig, scene = stage.drive_scene(plan, rig, streams)
    else:
        scene = stage.plain_scene(plan, rig, streams)
    effects = [_effect(scene, hidden, streams["effects"]) for hidden in plan.hidden]
    if drive:
        effects = [stage.clear_of_alignment(effect) for effect in effects]
    world, trace = scene.run(effects, scene.step)
    run = Run(plan, scene, effects, world, trace, settle(world, trace))
    return _drive_case(run, rig, streams) if drive else _plain_case(run, streams)


def _plain_case(run, streams):
    """A case as plain sensors show it, its log damaged where the plan says so."""
    plan = run.plan
    scene = run.scene
    trace = run.trace
    reference = run.world.reference
    noisy = logbook.noisy_channels(scene, trace, streams["noise"])
    extra = logbook.shaken(_extra(run, streams["log"]), streams["log"], scene.rate)
    log = logbook.write_columns(scene, noisy, extra, streams["log"])
    damage = {}
    if plan.data:
        log, damage = logbook.MISMATCHES[plan.data](log, streams["damage"])
    rate = trace.v if scene.sensors.has_rate else None
    clean = Channels(run.world.encoder(trace.q), rate, trace.command)
    blur = Blur(*noise_floor(reference, noisy, clean, scene.rate))
    spread = streams["nominal"].uniform(0.0, 0.2)
    given = scene.rig if plan.trusted else nominal(streams["nominal"], reference, spread)
    return Case(plan, given, scene.sensors.encoder_bits, log, describe(run, damage, blur))


def _drive_case(run, full, streams):
    """A case as a drive's sensors show it; `full`: the URDF's rig, exact."""
    scene = run.scene
    sensors = scene.sensors
    every = round(scene.rate / run.plan.rate)
    shown = logbook.show(sensors, scene, run.trace, every, streams["noise"])
    extra = _extra(run, streams["log"])
    log = logbook.written(sensors, scene, shown, extra, streams["log"])
    noise, acceleration = logbook.spectrum(sensors, scene, run.world, run.trace, shown)
    given = stage.given(run.plan, full, streams["nominal"])
    truth = describe(run, {}, Blur(noise.floor(), acceleration, noise))
    return Case(run.plan, given, sensors.encoder_bits, log, truth)


def _extra(run, rng):
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    rig = run.scene.rig
    t = run.trace.t
    moving = next((e for e in run.effects if isinstance(e, PlatformMotion)), None)
    with_imu = rng.random() < 0.1
    with_temperature = rng.random() < 0.3
    columns = {}
    if moving is not None:
        columns = logbook.imu(rig, t, moving.motion()) if moving.measured else {}
    elif with_imu and not any(e.cause in ("base-tilt", "soft-base") for e in run.effects):
        columns = logbook.imu(rig, t, None)
    if with_temperature:
        columns |= logbook.temperatures(rig, run.trace, 1.0 / run.scene.rate)
    return columns


def describe(run, damage, blur):
    """Everything about a case, keys as they stand in truth.json."""
    plan = run.plan
    rig = run.scene.rig
    faults = {*run.scene.sensors.faults}
    data = None
    if plan.data:
        cause, form = plan.data
        data = {"cause": cause, "form": form, "parameters": damage}
        faults.add(cause)
    if (blur.acceleration > DROWNED).any():
        faults.add("acceleration-noise")
    return {
        "schema": 1,
        "plan": asdict(plan),
        "rig": rig.name,
        "joints": list(rig.joints),
        "stratum": plan.stratum,
        "faults": sorted(faults),
        "data": data,
        "causes": [_cause(run, *one, blur) for one in zip(run.effects, plan.hidden)],
        "noise_floor": _by_joint(rig, blur.floor),
        "sensors": asdict(run.scene.sensors),
    }


def _cause(run, effect, hidden, blur):
    """What is true of one effect; where several act, its size is that of a trial with it alone."""
    scene = run.scene
    rig = scene.rig
    alone = len(run.effects) == 1
    world, ledger = (run.world, run.ledger) if alone else trial(scene, effect)
    trusted = effect.cause in TRUSTED
    left = projected(world.reference, ledger, scene.rate, trusted)
    clear = left / np.maximum(blur.floor, 1e-12)
    if blur.noise is not None:
        clear = seen(world.reference, ledger, blur.noise, scene.rate, trusted)
    foreign = effect.form in effect.foreign
    return {
        "cause": effect.cause,
        "form": effect.form,
        "joint": None if effect.joint is None else rig.joints[effect.joint],
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
    """A number of each joint by its name."""
    return dict(zip(rig.joints, values.tolist()))
