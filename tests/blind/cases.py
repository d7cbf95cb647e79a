"""`hide`: a plan becomes a rig's files, a log, and the truth about it, as JSON: for the scorer's eyes only."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from . import logbook, stage
from .effects import CATALOGUE, OUTSIDE, TRUSTED
from .effects.rigwide import PlatformMotion, diagonal
from .ledger import settle
from .plan import DrivePlan, Plan
from .rig_draw import draw_arm, draw_rig, nominal
from .rigs import Array, Rig
from .scene import calibrate, share_of, trial
from .visibility import projected, seen

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
    extra = _extra(scene, effects, trace, streams["log"])
    write = logbook.write_as_a_drive if drive else logbook.write_plainly
    log, blur = write(scene, world, trace, extra, streams["noise"], streams["log"])
    truth = describe(plan, scene, effects, (world, settle(world, trace)), blur)
    if plan.data:
        cause, form = plan.data
        log, sizes = logbook.MISMATCHES[plan.data](log, streams["damage"])
        truth["data"] = {"cause": cause, "form": form, "parameters": sizes}
        truth["faults"] = sorted({*truth["faults"], cause})
    given = rig if plan.trusted else _misjudge(plan, rig, world, streams["nominal"])
    return Case(plan, given, scene.sensors.encoder_bits, log, truth)


def _misjudge(plan, rig, world, rng):
    """The URDF's rig where it is not to be trusted: off by 0–20 %, and the camera of people's rigs by more."""
    drive = isinstance(plan, DrivePlan)
    given = nominal(rng, rig if drive else world.reference, rng.uniform(0.0, 0.2))
    if drive:
        given = given.with_payload(given.payload.inertia.times(1.0 + plan.camera_off))
    return given


def _extra(scene, effects, trace, rng):
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    moving = next((e for e in effects if isinstance(e, PlatformMotion)), None)
    with_imu = rng.random() < 0.1
    with_temperature = rng.random() < 0.3
    columns = {}
    if moving is not None:
        columns = logbook.imu(scene.rig, trace.t, moving.motion()) if moving.measured else {}
    elif with_imu and not any(e.cause in ("base-tilt", "soft-base") for e in effects):
        columns = logbook.imu(scene.rig, trace.t, None)
    if with_temperature:
        columns |= logbook.temperatures(scene.rig, trace, 1.0 / scene.rate)
    return columns


def describe(plan, scene, effects, run, blur):
    """Everything about a case, keys as they stand in truth.json; `run`: its world and its ledger."""
    rig = scene.rig
    drowned = (blur.acceleration > DROWNED).any()
    faults = [*scene.sensors.faults, *(["acceleration-noise"] if drowned else [])]
    runs = [run] if len(effects) == 1 else [trial(scene, effect) for effect in effects]
    return {
        "schema": 1,
        "plan": asdict(plan),
        "rig": rig.name,
        "joints": list(rig.joints),
        "stratum": plan.stratum,
        "faults": sorted(faults),
        "data": None,
        "causes": [_cause(scene, blur, *one) for one in zip(effects, plan.hidden, runs)],
        "noise_floor": _by_joint(rig, blur.floor),
        "sensors": asdict(scene.sensors),
    }


def _cause(scene, blur, effect, hidden, run):
    """Return the truth of one effect, from a run with it alone."""
    rig = scene.rig
    world, ledger = run
    lost = (world.reference, ledger, scene.rate, effect.cause in TRUSTED)
    left = projected(*lost)
    clear = left / np.maximum(blur.floor, 1e-12) if blur.noise is None else seen(blur.noise, *lost)
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
