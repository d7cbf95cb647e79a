"""`hide`: a plan becomes a rig's files, a log, and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import drive_log, people
from .arm_draw import draw_arm
from .calibrate import calibrate
from .corruption import MISMATCHES, Columns, Damage
from .effects import CATALOGUE, PlatformMotion, diagonal
from .ledger import settle
from .logbook import imu, noisy_channels, shaken, temperatures, write_columns
from .plan import DrivePlan, Plan
from .rig_draw import draw_rig, nominal
from .rigs import Rig
from .scene import draw_scene
from .sensors import draw_sensors
from .truth import Blur, Run, describe
from .visibility import Channels, noise_floor

LONGEST_TRIAL_S = 60.0
"""Effects are made as strong as wanted on no more than this of a run."""
STREAMS = ("rig", "motion", "control", "sensors", "effects", "noise", "log", "damage", "nominal")


@dataclass(frozen=True)
class Case:
    """A hidden case: the rig as its URDF has it, the log, and the truth (JSON)."""

    plan: Plan
    given: Rig
    encoder_bits: int
    log: Columns
    truth: dict[str, Any]


def _streams(seed):
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {
        name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)
    }


def _joint(scene, hidden):
    """The joint that the plan's place falls on; for friction by gravity's load, the one with the most of it."""
    moving = [joint for joint in range(len(scene.rig.links)) if joint not in scene.still]
    if hidden.form in ("gravity", "bearing"):
        return moving[int(scene.gravity()[moving].argmax())]
    return moving[min(int(hidden.place * len(moving)), len(moving) - 1)]


def _drawn(scene, hidden, rng):
    """The effect, made as strong as wanted."""
    context = scene.context(_joint(scene, hidden), hidden.share)
    guess = CATALOGUE[hidden.cause].draw(rng, context, hidden.form)
    return calibrate(scene.first(LONGEST_TRIAL_S), guess, hidden.share)


def hide(plan):
    """Simulate a plan. The same plan gives the same case, to the last bit.

    Raises: PlantDivergedError when the controller cannot hold the rig with this effect at any strength."""
    streams = _streams(plan.seed)
    drive = isinstance(plan, DrivePlan)
    draw = draw_arm if drive and plan.arm else draw_rig
    rig = draw(streams["rig"], plan.axes)
    if any(hidden.cause == "off-diagonal-inertia" for hidden in plan.hidden):
        rig = diagonal(rig)
    if drive:
        rig, scene = people.stage(plan, rig, streams)
    else:
        sensors = draw_sensors(streams["sensors"], plan.level, plan.rate)
        scene = draw_scene(streams, rig, sensors, plan)
    effects = tuple(_drawn(scene, hidden, streams["effects"]) for hidden in plan.hidden)
    if drive:
        effects = tuple(map(people.clear_of_alignment, effects))
    world, trace = scene.run(effects, scene.substeps(scene.step))
    run = Run(plan, scene, effects, world, trace, settle(world, trace))
    return _drive_case(run, rig, streams) if drive else _case(run, streams)


def _case(run, streams):
    plan = run.plan
    scene = run.scene
    trace = run.trace
    reference = run.world.reference
    noisy = noisy_channels(scene, trace, streams["noise"])
    extra = shaken(_extra(run, streams["log"]), streams["log"], scene.rate)
    damage = Damage(write_columns(scene, noisy, extra, streams["log"]))
    if plan.data:
        damage = MISMATCHES[plan.data](damage.columns, streams["damage"])
    rate = trace.v if scene.sensors.has_rate else None
    clean = Channels(run.world.encoder(trace.q), rate, trace.command)
    blur = Blur(*noise_floor(reference, noisy, clean, scene.rate))
    spread = streams["nominal"].uniform(0.0, 0.2)
    given = scene.rig if plan.trusted else nominal(streams["nominal"], reference, spread)
    truth = describe(run, damage, blur)
    return Case(plan, given, scene.sensors.encoder_bits, damage.columns, truth)


def _drive_case(run, full, streams):
    """A case as a drive's sensors show it; `full`: the URDF's rig, exact."""
    scene = run.scene
    sensors = scene.sensors
    every = round(scene.rate / run.plan.rate)
    shown = drive_log.show(sensors, scene, run.trace, every, streams["noise"])
    extra = _extra(run, streams["log"])
    log = drive_log.written(sensors, scene, shown, extra, streams["log"])
    noise, acceleration = drive_log.spectrum(sensors, scene, run.world, run.trace, shown)
    given = people.given(run.plan, full, streams["nominal"])
    truth = describe(run, Damage(log), Blur(noise.floor(), acceleration, noise))
    return Case(run.plan, given, sensors.encoder_bits, log, truth)


def _extra(run, rng):
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    rig = run.scene.rig
    t = run.trace.t
    effects = run.effects
    moving = next((e for e in effects if isinstance(e, PlatformMotion)), None)
    with_imu = rng.random() < 0.1
    with_temperature = rng.random() < 0.3
    columns = {}
    if moving is not None:
        columns = imu(rig, t, moving.motion()) if moving.measured else {}
    elif with_imu and not any(e.cause in ("base-tilt", "soft-base") for e in effects):
        columns = imu(rig, t, None)
    warm = temperatures(rig, run.trace, 1.0 / run.scene.rate) if with_temperature else {}
    return columns | warm
