"""`hide`: a plan becomes a rig's files, a log, and the truth about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from .calibrate import calibrate, share_of, trial
from .corruption import CORRUPTIONS, Columns, Damage
from .effects import CATALOGUE, OUTSIDE, TRUSTED, Effect, PlatformMotion, diagonal
from .ledger import Ledger, settle
from .logbook import clean_channels, imu, noisy_channels, perfect_columns, shaken, temperatures, write_columns
from .plan import Hidden, Plan
from .plant import Trace
from .rig_draw import draw_rig, nominal
from .rigs import Array, Rig
from .scene import FINE_STEP, Scene, draw_scene
from .sensors import Sensors, draw_sensors
from .visibility import noise_floor, projected, rms
from .world import World

STREAMS = ("rig", "motion", "control", "sensors", "effects", "noise", "log", "damage", "nominal")
DROWNED = 0.3
"""Where noise is this share of the smoothed acceleration, naming `acceleration-noise` is no false finding."""
Truth = dict[str, object]


@dataclass(frozen=True)
class Case:
    """A hidden case: the rig as its URDF has it, whether that is to be trusted, the log and the same log from perfect
    sensors, the truth (JSON), and the oracle's arrays (t q v a tau_total tau_effect, (N,) and (N, n))."""

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
    return replace(drawn, has_rate=True) if plan.data and plan.data[0] == "commanded-torque" else drawn


def _joint(scene: Scene, hidden: Hidden) -> int:
    """The joint that the plan's place falls on; for friction by gravity's load, the one with the most of it."""
    if hidden.form in ("gravity", "bearing"):
        return int(scene.gravity().argmax())
    return min(int(hidden.place * len(scene.rig.links)), len(scene.rig.links) - 1)


def _drawn(scene: Scene, hidden: Hidden, rng: np.random.Generator) -> Effect:
    """The effect, made as strong as wanted."""
    context = scene.context(_joint(scene, hidden), hidden.share)
    return calibrate(scene, CATALOGUE[hidden.cause].draw(rng, context, hidden.form), hidden.share)


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
    formula = plan.data is not None and plan.data[0] == "commanded-torque"
    sensors = _sensors(plan, streams["sensors"])
    scene = draw_scene(streams, rig, sensors, plan.excitation, plan.seconds, plan.rate, formula)
    effects = [_drawn(scene, hidden, streams["effects"]) for hidden in plan.hidden]
    start = plan.start * plan.seconds
    world, trace = scene.run([*effects, *_drive_of(plan)], scene.substeps(FINE_STEP), start)
    return _case(plan, scene, effects, world, trace, streams)


def _drive_of(plan: Plan) -> list[Effect]:
    """A drive that lags by a millisecond behind the commanded torque that is logged in its place."""
    if plan.data != ("commanded-torque", "lagging-drive"):
        return []
    lag = CATALOGUE["actuator-lag"]
    return [lag(joint, "first-order", 1e-3, 1.0) for joint in range(plan.axes)]  # type: ignore[call-arg]


def _case(plan: Plan, scene: Scene, effects: Sequence[Effect], world: World, trace: Trace,
          streams: dict[str, np.random.Generator]) -> Case:
    ledger = settle(world, trace)
    formula = plan.data is not None and plan.data[0] == "commanded-torque"
    clean = clean_channels(trace, world.encoder(trace.q), scene.sensors.has_rate)
    noisy = noisy_channels(scene, trace, streams["noise"], formula)
    floor, drowned = noise_floor(world.reference, noisy, clean, scene.rate)
    extra = _extra(plan, scene, effects, trace, streams["log"])
    wants_reference = formula or streams["log"].random() < 0.5
    log = write_columns(scene, noisy, shaken(extra, streams["log"], scene.rate), wants_reference, streams["log"])
    damage = _damaged(plan, log, streams["damage"])
    perfect = perfect_columns(scene.rig, trace.t, clean, extra)
    truth = _truth(plan, scene, effects, (world, ledger), damage, floor, drowned)
    oracle = {"t": trace.t, "q": clean.q, "v": trace.v, "a": ledger.a, "tau_total": trace.command,
              "tau_effect": ledger.effect}
    given = _given(plan, scene.rig, world, streams["nominal"])
    return Case(plan, given, scene.sensors.encoder_bits, damage.columns, perfect, truth, oracle)


def _extra(plan: Plan, scene: Scene, effects: Sequence[Effect], trace: Trace, rng: np.random.Generator) -> Columns:
    """Base IMU (where the base moves and is measured, and now and then where it stands still) and temperatures."""
    moving = next((e for e in effects if isinstance(e, PlatformMotion)), None)
    with_imu, with_temperature = rng.random() < 0.1, rng.random() < 0.3
    columns: Columns = {}
    if moving is not None and moving.measured:
        columns |= imu(scene.rig, trace.t, moving.motion())
    elif with_imu and not any(e.cause in ("base-tilt", "soft-base") or isinstance(e, PlatformMotion) for e in effects):
        columns |= imu(scene.rig, trace.t, None)
    return columns | temperatures(scene.rig, trace, 1.0 / scene.rate) if with_temperature else columns


def _damaged(plan: Plan, log: Columns, rng: np.random.Generator) -> Damage:
    if plan.data is None or plan.data[0] == "commanded-torque":
        return Damage(log)
    cause, form = plan.data
    return CORRUPTIONS[cause][form](log, rng, plan.window)


def _by_joint(rig: Rig, values: Array) -> dict[str, float]:
    return {joint: float(value) for joint, value in zip(rig.joints, values, strict=True)}


def _truth(plan: Plan, scene: Scene, effects: Sequence[Effect], run: tuple[World, Ledger], damage: Damage,
           floor: Array, drowned: Array) -> Truth:
    world, ledger = run
    faults = list(scene.sensors.faults)
    if bool((drowned > DROWNED).any()):
        faults.append("acceleration-noise")
    data = None
    if plan.data is not None:
        data = {"cause": plan.data[0], "form": plan.data[1], "parameters": damage.parameters,
                "channels": list(damage.channels), "window": list(plan.window)}
    causes = [_cause(plan, scene, effect, hidden, run if len(effects) == 1 else None, floor)
              for effect, hidden in zip(effects, plan.hidden, strict=True)]
    return {
        "schema": 1, "plan": asdict(plan), "rig": scene.rig.name, "joints": list(scene.rig.joints),
        "stratum": plan.stratum, "level": plan.level, "expected": expected(plan), "causes": causes, "data": data,
        "faults": sorted(set(faults) | ({plan.data[0]} if plan.data else set())),
        "noise_floor": _by_joint(scene.rig, floor), "acceleration_noise": _by_joint(scene.rig, drowned),
        "torque_rms": _by_joint(scene.rig, rms(ledger.command)), "effect_rms": _by_joint(scene.rig, rms(ledger.effect)),
        "coulomb": _by_joint(scene.rig, world.reference.coulomb), "viscous": _by_joint(scene.rig, scene.rig.viscous),
        "sensors": asdict(scene.sensors), "train_until": 2.0 / 3.0 * plan.seconds,
    }  # fmt: skip


def _cause(plan: Plan, scene: Scene, effect: Effect, hidden: Hidden, run: tuple[World, Ledger] | None,
           floor: Array) -> Truth:
    """What is true of one effect; where several act, its size is that of a run with it alone."""
    world, ledger = run if run is not None else trial(scene, effect)
    trusted = effect.cause in TRUSTED
    smoothed, left = projected(world.reference, ledger, scene.rate, trusted)
    rows = slice(int(plan.start * len(ledger.command)), None)
    joint = None if effect.joint is None else scene.rig.joints[effect.joint]
    foreign, outside = effect.forms[effect.form], type(effect) in OUTSIDE
    return {
        "cause": effect.cause, "form": effect.form, "joint": joint, "foreign": foreign, "outside": outside,
        "kin": list(effect.kin), "parameters": effect.parameters(), "comparable": not foreign,
        "target_share": hidden.share, "share": share_of(effect, ledger, rows), "active_from": plan.start * plan.seconds,
        "raw_rms": _by_joint(scene.rig, rms(ledger.effect[rows])), "smoothed_rms": _by_joint(scene.rig, smoothed),
        "projected_rms": _by_joint(scene.rig, left), "snr": _by_joint(scene.rig, left / np.maximum(floor, 1e-12)),
    }  # fmt: skip


def expected(plan: Plan) -> list[str]:
    """The verdicts that would be right."""
    if plan.data is not None:
        return ["data"]
    if not plan.hidden:
        return ["nothing"]
    if plan.start > 0.5:
        return ["nothing", "unknown"]
    names = {kind.cause for kind in OUTSIDE}
    if all(hidden.cause in names for hidden in plan.hidden):
        return ["unknown"]
    return ["named", "ambiguous"]
