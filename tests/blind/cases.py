"""`hide`: a plan becomes a rig's files, a log, and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .calibrate import calibrate
from .corruption import CORRUPTIONS, Columns, Damage
from .effects import CATALOGUE, Effect, PlatformMotion, diagonal
from .ledger import settle
from .logbook import ROW, clean_channels, imu, noisy_channels, perfect_columns, shaken, temperatures, write_columns
from .plan import Hidden, Plan
from .rig_draw import draw_rig, nominal
from .rigs import Array, Rig
from .scene import FINE_STEP, Scene, draw_scene
from .sensors import Sensors, draw_sensors
from .truth import Blur, Run, Truth, describe
from .visibility import noise_floor
from .world import World

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
    return {name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)}


def _sensors(plan: Plan, rng: np.random.Generator) -> Sensors:
    """The grade's sensors; a torque that is a formula of rates needs the rates in the log."""
    drawn = draw_sensors(rng, plan.level, plan.rate)
    return replace(drawn, has_rate=True) if plan.formula else drawn


def _joint(scene: Scene, hidden: Hidden) -> int:
    """The joint that the plan's place falls on; for friction by gravity's load, the one with the most of it."""
    if hidden.form in ("gravity", "bearing"):
        return int(scene.gravity().argmax())
    return min(int(hidden.place * len(scene.rig.links)), len(scene.rig.links) - 1)


def _drawn(scene: Scene, hidden: Hidden, start: float, rng: np.random.Generator) -> Effect:
    """The effect, made as strong as wanted."""
    context = scene.context(_joint(scene, hidden), hidden.share)
    return calibrate(scene, CATALOGUE[hidden.cause].draw(rng, context, hidden.form), hidden.share, start)


def _given(plan: Plan, rig: Rig, world: World, rng: np.random.Generator) -> Rig:
    """The URDF's rig: exact where it is to be trusted, else off by 0–20 %."""
    return rig if plan.trusted else nominal(rng, world.reference, float(rng.uniform(0.0, 0.2)))


def hide(plan: Plan) -> Case:
    """Simulate a plan. The same plan gives the same case, to the last bit.

    Raises: PlantDivergedError when the controller cannot hold the rig with this effect at any strength."""
    streams = _streams(plan.seed)
    rig = draw_rig(streams["rig"], plan.axes)
    if any(hidden.cause == "off-diagonal-inertia" for hidden in plan.hidden):
        rig = diagonal(rig)
    scene = draw_scene(streams, rig, _sensors(plan, streams["sensors"]), plan)
    effects = tuple(_drawn(scene, hidden, plan.start, streams["effects"]) for hidden in plan.hidden)
    world, trace = scene.run([*effects, *_drive_of(plan)], scene.substeps(FINE_STEP), plan.start * plan.seconds)
    return _case(Run(plan, scene, effects, world, trace, settle(world, trace)), streams)


def _drive_of(plan: Plan) -> list[Effect]:
    """A drive that lags by a millisecond behind the commanded torque that is logged in its place."""
    if plan.data != ("commanded-torque", "lagging-drive"):
        return []
    lag = CATALOGUE["actuator-lag"]
    return [lag(joint, "first-order", 1e-3, 1.0) for joint in range(plan.axes)]  # type: ignore[call-arg]


def _case(run: Run, streams: dict[str, np.random.Generator]) -> Case:
    plan, scene, world, trace = run.plan, run.scene, run.world, run.trace
    clean = clean_channels(trace, world.encoder(trace.q), scene.sensors.has_rate)
    noisy = noisy_channels(scene, trace, streams["noise"], plan.formula)
    extra = _extra(run, streams["log"])
    log = write_columns(scene, noisy, shaken(extra, streams["log"], scene.rate), plan.formula, streams["log"])
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


def _oracle(run: Run, shown_q: Array, rows: Array) -> dict[str, Array]:
    ledger, trace = run.ledger, run.trace
    return {
        "t": trace.t, "q": shown_q, "v": trace.v, "a": ledger.a, "q_hold": ledger.q, "v_hold": ledger.v,
        "tau_total": trace.command, "tau_effect": ledger.effect, "rows": rows,
    }  # fmt: skip


def _extra(run: Run, rng: np.random.Generator) -> Columns:
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    rig, t, effects = run.scene.rig, run.trace.t, run.effects
    moving = next((e for e in effects if isinstance(e, PlatformMotion)), None)
    with_imu, with_temperature = rng.random() < 0.1, rng.random() < 0.3
    columns: Columns = {}
    if moving is not None and moving.measured:
        columns |= imu(rig, t, moving.motion())
    elif with_imu and moving is None and not any(e.cause in ("base-tilt", "soft-base") for e in effects):
        columns |= imu(rig, t, None)
    return columns | temperatures(rig, run.trace, 1.0 / run.scene.rate) if with_temperature else columns


def _damaged(plan: Plan, log: Columns, rng: np.random.Generator) -> Damage:
    if plan.data is None or plan.formula:
        return Damage(log)
    cause, form = plan.data
    return CORRUPTIONS[cause][form](log, rng, plan.window)
