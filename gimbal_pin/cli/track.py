"""``gimbal-pin track``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import (
    describe_origin,
    load_logs,
    load_rig,
    read_payload,
    read_plant,
    read_platform,
    read_tuned,
)
from gimbal_pin.cli.present import present, tell, write_figure
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import StoredController
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.pointing import Verified


def track(
    rig: opt.RigName,
    controller: Annotated[
        Positional[str | None], arg(metavar="CONTROLLER", help_behavior_hint="")
    ] = None,
    *,
    payload: opt.Payload = None,
    model: opt.ModelFile = None,
    delay_samples: Annotated[opt.Maybe[int], opt.DELAY_SAMPLES] = None,
    platform: Literal["none", "S"] = "none",
    platform_log: opt.File = None,
    platform_size: opt.PlatformSize = 1.0,
    map: opt.Map = (),
    learn: Annotated[opt.Maybe[str], arg(metavar="LOG")] = None,
    effect: opt.Effects = (),
    seeds: Annotated[int, opt.between("--seeds", 1, 10000, kind=int)] = 5,
    seconds: Annotated[float, opt.between("--seconds", 0.1, 3600, "s")] = 30.0,
    jobs: Annotated[int, opt.between("--jobs", 1, 64, kind=int)] = 1,
    plot: opt.Plotted = None,
    report: opt.Page = None,
    animation: opt.Page = None,
    plants: opt.Plants = 50,
    seed: opt.Seed = 0,
    verbose: opt.Verbose = False,
    json: opt.Json = None,
) -> None:
    """Step tracking against a PID; on a platform that moves, a camera held by computed torque and by a PID.

    Args:
        controller: a controller's YAML, from tune: it steps, and holds the camera with its model and its gains
        delay_samples: samples between measurement and torque (default: what the controller was tuned for, else 1)
        platform: hold the camera still on a platform that moves along profile S
        platform_log: or along a recorded motion: gyro_ and accel_ of the base link, low-passed at 20 Hz
        learn: log of a shaken platform, --map's where there is no --platform-log (default: 60 s are simulated)
        seeds: runs on a platform, each with its own motion and noise
        seconds: length of each of these runs
        jobs: processes that share these runs
        plot: draw line of sight, spectrum and torque: .png, .svg or .pdf
        report: write a report: what the camera sees, errors, torque
        animation: write the rig on its platform as an offline page
    """
    origin = None if report is None else describe_origin(track, locals())
    from gimbal_pin.checks import check_platform_log
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.pointing import verify
    from gimbal_pin.report.elements import join_documents
    from gimbal_pin.report.pages import describe_record, render_held

    moving = platform != "none" or platform_log is not None
    check_camera_options(controller, moving, (animation, plot, effect, learn, platform_size != 1.0))
    mounted = payload or read_payload(controller)
    loaded = load_rig(rig, mounted)
    tuned = None if controller is None else read_tuned(controller, loaded)
    plant = None if model is None else read_plant(model, loaded)
    log = None
    held = None
    if moving and learn is not None:
        own, (log,) = load_logs(rig, mounted, [learn], map if platform_log is None else ())
        if own.base in log.imus:
            tell(check_platform_log(log.t, log.imus[own.base], log.name).notes)
    steps, judged = None, None
    if tuned is not None:
        tell(
            ("--effect stands in the plant whose camera is held; the steps are without it",)
            if effect
            else ()
        )
        steps, judged = step_controllers(tuned, plant or tuned.model, delay_samples, plants, seed)
        steps = replace(
            steps, plant="the controller's own model" if model is None else f"the model in {model}"
        )
    if moving:
        recorded = read_platform(loaded, platform, platform_log, map)
        known, law = (None, None) if tuned is None else (tuned.model, tuned.law)
        late = (
            delay_samples
            if delay_samples is not None
            else 1
            if tuned is None
            else tuned.wish.holding_samples
        )
        held = verify(
            loaded, log=log, plant=plant, known=known, law=law, recorded=recorded, size=platform_size, causes=effect,
            seeds=seeds, seconds=seconds, jobs=jobs, delay=late,
        )  # fmt: skip
        write_figure(held.plot, plot)
    page = join_documents(
        [describe_record(one) for one in (judged, steps, held) if one is not None]
    )
    if report is not None:
        replace(page, origin=origin).write(report)
    if animation is not None and held is not None:
        atomic_write(animation, render_held(held))
    present(page.to_text(verbose), collect_results(steps, judged, held), json)


def collect_results(
    steps: Tracking | None, judged: Judgement | None, held: Verified | None
) -> dict[str, Any]:
    """Return what JSON holds of steps and of a held camera."""
    own, more = ({} if one is None else one.to_dict() for one in (steps, held))
    return {
        "schema": 1,
        "experiments": [],
        **own,
        **({} if judged is None else {"judged": judged.to_dict()}),
        **more,
    }


def check_camera_options(controller: str | None, moving: bool, held: Sequence[object]) -> None:
    """Raise `UsageError` for what is missing; `held`: what the options that need a platform were given."""
    motions = "--platform S, --platform-log FILE"
    needing = "--animation --plot --effect --learn --platform-size"
    if controller is None and not moving:
        raise UsageError(
            "CONTROLLER", "is missing", f"name a controller's YAML, or a motion: {motions}"
        )
    for option, given in zip(needing.split(), held):
        if given and not moving:
            raise UsageError(option, "has no platform that moves", f"name a motion: {motions}")


def step_controllers(
    tuned: StoredController, plant: Model, late: int | None, plants: int, seed: int
) -> tuple[Tracking, Judgement]:
    """Step a controller and its rival; judge them on plants around that one.

    `late`: samples of delay; None: what the controller was tuned for.
    """
    import numpy as np

    from gimbal_pin.control.judging import judge_controllers
    from gimbal_pin.control.tracking import track as run
    from gimbal_pin.control.tuning import RIVAL, pair_rivals

    laws = {tuned.wish.kind: tuned.law, RIVAL: pair_rivals(tuned)[RIVAL]}
    samples = tuned.wish.samples if late is None else late
    delay = tuned.wish.delay if samples == tuned.wish.samples else samples * tuned.wish.dt
    steps = run(plant, laws, rng=np.random.default_rng(seed), delay=samples)
    return steps, judge_controllers(plant, laws, rng=seed, plants=plants, delay=delay)
