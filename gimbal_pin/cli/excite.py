"""``gimbal-pin excite``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import UseAppendAction, arg

from gimbal_pin.cli.inputs import load_logs, load_rig, mounted, plant_of
from gimbal_pin.cli.options import Json, Map, ModelFile, Output, Payload, RigName, Seed, Yes, between, optional
from gimbal_pin.cli.paths import Reads, logs
from gimbal_pin.cli.present import present
from gimbal_pin.cli.work import affordable
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.effects import Effect
    from gimbal_pin.rig.rig import Rig


def excite(
    rig: RigName,
    output: Output,
    *,
    payload: Payload = None,
    seconds: Annotated[float, between("--seconds", 0.5, 3600, "s"), arg(help="length of the motion")] = 25.0,
    periods: Annotated[
        int | None,
        between("--periods", 1, 1000, kind=int),
        arg(
            help="periods in it: what differs between them is noise, what all show and a model does not is structure",
            help_behavior_hint="(default: five, of 4 s or more each)",
        ),
    ] = None,
    harmonics: Annotated[
        int | None,
        between("--harmonics", 2, 200, kind=int),
        arg(
            help="harmonics of a period's Fourier series",
            help_behavior_hint="(default: up to half a hertz, at least five)",
        ),
    ] = None,
    starts: Annotated[int, between("--starts", 1, 1000, kind=int), arg(help="random starts of the optimisation")] = 5,
    criterion: Literal["condition", "determinant"] = "condition",
    after: Annotated[
        tuple[str, ...],
        Reads(logs),
        optional("LOG …", "earlier logs: design what teaches most beyond them, by log det of the information"),
    ] = (),
    map: Map = (),
    effect: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="CAUSE:JOINT:NAME=VALUE,…", help="a cause to be shown as well, as simulate plants it; of any size"),
    ] = (),
    model: ModelFile = None,
    limit: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="JOINT.QUANTITY=NUMBER",
            help="a limit in place of the rig's own, e.g. pan.velocity=2: velocity "
            "rad/s, acceleration rad/s^2, effort N m, lower and upper rad",
        ),
    ] = (),
    first: Annotated[bool, arg(help="the same motion to run first: at a tenth of its amplitude, and slow")] = False,
    margin: Annotated[float, between("--margin", 0, 0.95), arg(help="share of every limit that is left free")] = 0.05,
    clearance: Annotated[
        float, between("--clearance", 0, 1, "m"), arg(help="distance that parts keep which can hit each other")
    ] = 0.005,
    speed: Annotated[
        float, between("--speed", 0, 0.95), arg(help="rms rate that shows friction, share of the rate limit")
    ] = 0.3,
    rate: Annotated[float, between("--rate", 1, 20000, "Hz"), arg(help="samples per second of the file")] = 1000.0,
    log_rate: Annotated[
        float | None,
        between("--log-rate", 1, 20000, "Hz"),
        arg(help="samples per second of the log to come", help_behavior_hint="(default: --rate)"),
    ] = None,
    torque_noise: Annotated[
        float, between("--torque-noise", 0, 10), arg(help="noise on the torque of the log to come, share of its rms")
    ] = 0.01,
    lag: Annotated[
        float | None,
        between("--lag", 0, 1, "s"),
        arg(
            help="time by which the torque may act later than its stamp",
            help_behavior_hint="(default: half a sample of the log)",
        ),
    ] = None,
    seed: Seed = 0,
    yes: Yes = False,
    json: Json = None,
) -> None:
    """Design an excitation trajectory under the rig's limits."""
    import numpy as np

    from gimbal_pin.excitation import build_sequential_criterion, count_periods, predict_estimate
    from gimbal_pin.excitation import excite as run
    from gimbal_pin.log.io import write_motion

    camera = payload or mounted(model)
    loaded, read = load_logs(rig, camera, after, map) if after else (load_rig(rig, camera), [])
    plant = plant_of(model, loaded)
    plant = replace(plant, rig=with_limits(plant.rig, limit))
    shown = to_show(plant, effect)
    terms = (harmonics or 10) * plant.rig.n
    affordable(yes, squared_variable_of_a_start=starts * terms**2, sample_of_a_motion=seconds * rate)
    found = run(
        plant.rig,
        seconds=seconds,
        periods=count_periods(seconds) if periods is None else periods,
        harmonics=harmonics,
        starts=starts,
        criterion=build_sequential_criterion(plant.rig, read, seconds, shown) if read else criterion,
        effects=shown,
        torque_model=plant,
        margin=margin,
        first=first,
        clearance=clearance,
        speed=speed,
        dt=1 / rate,
        rng=np.random.default_rng(seed),
    )
    write_motion(found.motion, found.joints, output)
    motion = found.motion
    if log_rate is not None:
        times = np.arange(0.0, found.seconds * (1 + 1e-12), 1 / log_rate)
        motion = found.series.motion(found.coefficients, times)
    told = predict_estimate(plant, motion, effects=shown, torque_noise=torque_noise, lag=lag, rng=seed)
    said = [text.excitation(found), text.expectation(told), next_step(rig, output, first, bool(read))]
    present("\n".join(said).rstrip(), {**found.to_dict(), "expected": told.to_dict()}, json)


def with_limits(rig: Rig, texts: Sequence[str]) -> Rig:
    """Return the rig with limits such as ``pan.velocity=2`` in place of its own.

    Raises:
        UsageError: A text names no joint or limit of the rig, or no number that such a limit may have.
    """
    from gimbal_pin.rig.config import Limits
    from gimbal_pin.rig.records import read_fields

    limits = dict(zip(rig.joints, rig.limits))
    for given in texts:
        name, _, number = given.partition("=")
        joint, _, quantity = name.rpartition(".")
        place, mend = f"--limit {given}", f"write JOINT.velocity=NUMBER with a joint out of {', '.join(rig.joints)}"
        if joint not in limits:
            raise UsageError(place, f"the rig {rig.name} has no joint '{joint}'", mend)
        try:
            value = float(number)
        except ValueError:
            raise UsageError(place, f"'{number}' is no number", mend) from None
        limits[joint] = replace(limits[joint], **read_fields(Limits, {quantity: value}, place, UsageError))
    return replace(rig, limits=tuple(limits.values()))


def next_step(rig: str, output: Path, first: bool, later: bool) -> str:
    """Return what to do next: after a first motion the design from its log, before one the motion itself."""
    if first:
        log = f"{output.stem}_log.csv"
        return (
            "a tenth of the amplitude, and at most a tenth of each torque limit beyond gravity and friction: record it "
            f"as {log}; 'diagnose {rig} {log}' tells wrong signs, units and order of joints before the full motion runs"
        )
    return "" if later else "never moved this machine? --first writes this motion at a tenth, to be run before it"


def to_show(model: Model, texts: Sequence[str]) -> list[Effect]:
    """Return the effects of a model but its Coulomb and viscous friction, and those that the texts name.

    Raises:
        UsageError: A text names a cause that is no torque at a joint; it says what shows that.
    """
    from gimbal_pin.dynamics.model import build_friction_effects
    from gimbal_pin.effects import Term
    from gimbal_pin.effects.parse import parse_effect

    terms = [term.effect for term in model.terms]
    for named in texts:
        planted = parse_effect(named, model.rig)
        if not isinstance(planted, Term):
            what = "adds no torque of its own at a joint, which is what a motion is designed to show"
            mend = f"what shows it is {planted.experiment}; 'simulate --effect' plants it"
            raise UsageError(f"--effect {planted.name}", what, mend)
        terms.append(planted.effect)
    friction = build_friction_effects(model.rig.joints)
    return [effect for k, effect in enumerate(terms) if effect not in (*friction, *terms[:k])]
