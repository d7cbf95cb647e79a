"""`hide`: a plan becomes a rig's files, a log, and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import drive_log, people
from .calibrate import calibrate
from .corruption import CORRUPTIONS, MISMATCHES, Columns, Damage
from .drive_sensors import DriveSensors
from .effects import CATALOGUE, Effect, PlatformMotion, diagonal
from .ledger import settle
from .logbook import (
    ROW,
    clean_channels,
    imu,
    noisy_channels,
    perfect_columns,
    shaken,
    temperatures,
    write_columns,
)
from .plan import DrivePlan, Hidden, Plan
from .rig_draw import draw_rig, nominal
from .rigs import Array, Rig
from .scene import Scene, draw_scene
from .sensors import Sensors, draw_sensors
from .truth import Blur, Run, Truth, describe
from .visibility import noise_floor
from .world import World

LONGEST_TRIAL_S = 60.0
"""Effects are made as strong as wanted on no more than this of a run."""
STREAMS = ("rig", "motion", "control", "sensors", "effects", "noise", "log", "damage", "nominal")


@dataclass(frozen=True)
class Case:
    """A hidden case: the rig as its URDF has it, whether that is to be trusted, the log and the same log from perfect
    sensors, the truth (JSON), and the oracle's arrays: t (N,); q v (N, n) as perfect encoders show them at t;
    means over the hold [t, t + period) q_hold v_hold a tau_total tau_effect (N, n); rows (M,): the log's samples."""

    plan: Plan
    given: Rig
    encoder_bits: int
    log: Columns
    perfect: Columns
    truth: Truth
    oracle: dict[str, Array]


def _streams(seed: int) -> dict[str, np.random.Generator]:
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {
        name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)
    }


def _sensors(plan: Plan, rng: np.random.Generator) -> Sensors:
    """The grade's sensors; a torque that is a formula of rates needs the rates in the log."""
    drawn = draw_sensors(rng, plan.level, plan.rate)
    return replace(drawn, has_rate=True) if plan.formula else drawn


def _joint(scene: Scene, hidden: Hidden) -> int:
    """The joint that the plan's place falls on; for friction by gravity's load, the one with the most of it."""
    moving = [joint for joint in range(len(scene.rig.links)) if joint not in scene.still]
    if hidden.form in ("gravity", "bearing"):
        return moving[int(scene.gravity()[moving].argmax())]
    return moving[min(int(hidden.place * len(moving)), len(moving) - 1)]


def _drawn(scene: Scene, hidden: Hidden, rng: np.random.Generator) -> Effect:
    """The effect, made as strong as wanted."""
    context = scene.context(_joint(scene, hidden), hidden.share)
    guess = CATALOGUE[hidden.cause].draw(rng, context, hidden.form)
    return calibrate(scene.first(LONGEST_TRIAL_S), guess, hidden.share)


def _given(plan: Plan, rig: Rig, world: World, rng: np.random.Generator) -> Rig:
    """The URDF's rig: exact where it is to be trusted, else off by 0–20 %."""
    return rig if plan.trusted else nominal(rng, world.reference, float(rng.uniform(0.0, 0.2)))


def hide(plan: Plan) -> Case:
    """Simulate a plan. The same plan gives the same case, to the last bit.

    Raises: PlantDivergedError when the controller cannot hold the rig with this effect at any strength."""
    streams = _streams(plan.seed)
    drive = isinstance(plan, DrivePlan)
    rig = (
        people.draw_full_rig(plan, streams["rig"]) if drive else draw_rig(streams["rig"], plan.axes)
    )
    if any(hidden.cause == "off-diagonal-inertia" for hidden in plan.hidden):
        rig = diagonal(rig)
    if drive:
        rig, scene = people.stage(plan, rig, streams)
    else:
        scene = draw_scene(streams, rig, _sensors(plan, streams["sensors"]), plan)
    effects = tuple(_drawn(scene, hidden, streams["effects"]) for hidden in plan.hidden)
    if drive:
        effects = tuple(map(people.clear_of_alignment, effects))
    world, trace = scene.run([*effects, *_drive_of(plan)], scene.substeps(scene.step))
    run = Run(plan, scene, effects, world, trace, settle(world, trace))
    return _drive_case(run, rig, streams) if drive else _case(run, streams)


def _drive_of(plan: Plan) -> list[Effect]:
    """A drive that lags by a millisecond behind the commanded torque that is logged in its place."""
    if plan.data != ("commanded-torque", "lagging-drive"):
        return []
    lag = CATALOGUE["actuator-lag"]
    return [lag(joint, "first-order", 1e-3, 1.0) for joint in range(plan.axes)]  # type: ignore[call-arg]


def _case(run: Run, streams: dict[str, np.random.Generator]) -> Case:
    plan = run.plan
    scene = run.scene
    world = run.world
    trace = run.trace
    clean = clean_channels(trace, world.encoder(trace.q), scene.sensors.has_rate)
    noisy = noisy_channels(scene, trace, streams["noise"], plan.formula)
    extra = _extra(run, streams["log"])
    log = write_columns(
        scene, noisy, shaken(extra, streams["log"], scene.rate), plan.formula, streams["log"]
    )
    damage = _damaged(plan, log, streams["damage"])
    blur = Blur(*noise_floor(world.reference, noisy, clean, scene.rate))
    return Case(
        plan=plan,
        given=_given(plan, scene.rig, world, streams["nominal"]),
        encoder_bits=scene.sensors.encoder_bits,
        log={name: values for name, values in damage.columns.items() if name != ROW},
        perfect=perfect_columns(scene.rig, trace.t, clean, extra),
        truth=describe(run, damage, blur),
        oracle=_oracle(run, clean.q, damage.columns[ROW]),
    )


def _drive_case(run: Run, full: Rig, streams: dict[str, np.random.Generator]) -> Case:
    """A case as a drive's sensors show it; `full`: the URDF's rig, exact."""
    plan = run.plan
    scene = run.scene
    world = run.world
    trace = run.trace
    sensors = scene.sensors
    if not (isinstance(plan, DrivePlan) and isinstance(sensors, DriveSensors)):
        raise TypeError("a drive's case needs a drive's plan and sensors")
    shown = drive_log.show(sensors, scene, trace, round(scene.rate / plan.rate), streams["noise"])
    rows = shown.rows
    extra = _extra(run, streams["log"])
    log = drive_log.written(sensors, scene, shown, extra, streams["log"])
    noise, acceleration = drive_log.spectrum(sensors, scene, world, trace, shown)
    encoder = world.encoder(trace.q)
    clean = clean_channels(trace, encoder, sensors.has_rate)
    perfect = perfect_columns(scene.rig, trace.t, clean, extra)
    return Case(
        plan=plan,
        given=people.given(plan, full, streams["nominal"]),
        encoder_bits=sensors.encoder_bits,
        log={name: values for name, values in log.items() if name != ROW},
        perfect={name: values[rows] for name, values in perfect.items()},
        truth=describe(run, Damage(log), Blur(noise.floor(), acceleration, noise)),
        oracle=_oracle(run, encoder, log[ROW]),
    )


def _oracle(run: Run, shown_q: Array, rows: Array) -> dict[str, Array]:
    ledger = run.ledger
    trace = run.trace
    return {
        "t": trace.t, "q": shown_q, "v": trace.v, "a": ledger.a, "q_hold": ledger.q, "v_hold": ledger.v,
        "tau_total": trace.command, "tau_effect": ledger.effect, "rows": rows,
    }  # fmt: skip


def _extra(run: Run, rng: np.random.Generator) -> Columns:
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    rig = run.scene.rig
    t = run.trace.t
    effects = run.effects
    moving = next((e for e in effects if isinstance(e, PlatformMotion)), None)
    with_imu = rng.random() < 0.1
    with_temperature = rng.random() < 0.3
    columns: Columns = {}
    if moving is not None and moving.measured:
        columns |= imu(rig, t, moving.motion())
    elif (
        with_imu
        and moving is None
        and not any(e.cause in ("base-tilt", "soft-base") for e in effects)
    ):
        columns |= imu(rig, t, None)
    return (
        columns | temperatures(rig, run.trace, 1.0 / run.scene.rate)
        if with_temperature
        else columns
    )


def _damaged(plan: Plan, log: Columns, rng: np.random.Generator) -> Damage:
    if plan.data is None or plan.formula:
        return Damage(log)
    cause, form = plan.data
    return (CORRUPTIONS | MISMATCHES)[cause][form](log, rng, plan.window)
