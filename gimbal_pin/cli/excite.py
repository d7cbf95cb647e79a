"""``gimbal-pin excite``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import load_logs, load_rig, read_payload, read_plant
from gimbal_pin.cli.present import present


def excite(
    rig: opt.RigName,
    output: opt.Output,
    *,
    payload: opt.Payload = None,
    seconds: Annotated[float, opt.between("--seconds", 0.5, 3600, "s")] = 25.0,
    periods: Annotated[opt.Maybe[int], opt.between("--periods", 1, 1000, kind=int)] = None,
    harmonics: Annotated[opt.Maybe[int], opt.between("--harmonics", 2, 200, kind=int)] = None,
    starts: Annotated[int, opt.between("--starts", 1, 1000, kind=int)] = 5,
    criterion: Literal["condition", "determinant"] = "condition",
    after: Annotated[tuple[str, ...], arg(metavar="LOG …", help_behavior_hint="")] = (),
    map: opt.Map = (),
    effect: Annotated[opt.Repeated, arg(metavar="CAUSE:JOINT:NAME=VALUE,…")] = (),
    model: opt.ModelFile = None,
    limit: Annotated[opt.Repeated, arg(metavar="JOINT.QUANTITY=NUMBER")] = (),
    first: bool = False,
    margin: Annotated[float, opt.between("--margin", 0, 0.95)] = 0.05,
    clearance: Annotated[float, opt.between("--clearance", 0, 1, "m")] = 0.005,
    speed: Annotated[float, opt.between("--speed", 0, 0.95)] = 0.3,
    rate: Annotated[float, opt.between("--rate", 1, 20000, "Hz")] = 1000.0,
    log_rate: Annotated[opt.Maybe[float], opt.between("--log-rate", 1, 20000, "Hz")] = None,
    torque_noise: Annotated[opt.Maybe[float], opt.between("--torque-noise", 0, 10)] = None,
    form_error: Annotated[opt.Maybe[float], opt.between("--form-error", 0, 1)] = None,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """Design an excitation trajectory under the rig's limits.

    Args:
        seconds: length of the motion
        periods: periods in it: noise differs between them, structure does not (default: five, of 4 s or more each)
        harmonics: harmonics of a period's Fourier series (default: up to half a hertz, at least five)
        starts: random starts of the optimisation
        criterion: what is made small: condition number, or volume of the parameters' uncertainty
        after: earlier logs, whose information is added: the volume of all uncertainty is made small
        effect: a cause to be shown as well, as simulate plants it; of any size
        limit: in place of the rig's own, e.g. pan.velocity=2 (rad/s): acceleration, effort, lower or upper, too
        first: the same motion to run first: at a tenth of its amplitude, and slow
        margin: share of every limit that is left free
        clearance: distance that parts keep which can hit each other
        speed: rms rate that shows friction, share of the rate limit
        rate: samples per second of the file
        log_rate: samples per second of the log to come (default: --rate)
        torque_noise: noise on the reported torque, share of its rms (default: as identified, or 0.01)
        form_error: what neither rigid bodies nor friction do, share of its rms (default: as identified, or 0.015)
    """
    import numpy as np

    from gimbal_pin.excitation import (
        build_criterion_after_logs,
        count_periods,
        list_shown_effects,
        predict_estimate,
    )
    from gimbal_pin.excitation import excite as run
    from gimbal_pin.log.io import write_motion
    from gimbal_pin.report.elements import join_documents
    from gimbal_pin.report.pages import describe_record
    from gimbal_pin.rig.config import read_limits

    camera = payload or read_payload(model)
    loaded, read = load_logs(rig, camera, after, map) if after else (load_rig(rig, camera), [])
    plant = read_plant(model, loaded)
    plant = replace(
        plant, rig=replace(plant.rig, limits=read_limits(limit, plant.rig.joints, plant.rig.limits))
    )
    shown = list_shown_effects(plant, effect)
    found = run(
        plant.rig, seconds=seconds, periods=count_periods(seconds) if periods is None else periods, harmonics=harmonics,
        criterion=build_criterion_after_logs(plant.rig, read, seconds, shown) if read else criterion, starts=starts,
        effects=shown, torque_model=plant, margin=margin, first=first, clearance=clearance, speed=speed, dt=1 / rate,
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    write_motion(found.motion, found.joints, output)
    told = predict_estimate(
        plant,
        found.sample(log_rate),
        effects=shown,
        torque_noise=torque_noise,
        form_error=form_error,
        rng=seed,
    )
    said = join_documents([describe_record(found), describe_record(told)]).to_text()
    said = f"{said}\n{describe_next_step(rig, output, first, bool(read))}".rstrip()
    present(said, {**found.to_dict(), "expected": told.to_dict()}, json)


def describe_next_step(rig: str, output: Path, first: bool, later: bool) -> str:
    """Return what to do next: after a first motion the design from its log, before one the motion itself."""
    if first:
        log = f"{output.stem}_log.csv"
        return (
            "a tenth of the amplitude, and at most a tenth of each torque limit beyond gravity and friction: record it "
            f"as {log}; 'diagnose {rig} {log}' tells wrong signs, units and order of joints before the full motion runs"
        )
    return (
        ""
        if later
        else "never moved this machine? --first writes this motion at a tenth, to be run before it"
    )
