"""``gimbal-pin track``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, UseAppendAction, arg

from gimbal_pin import text
from gimbal_pin.cli.inputs import carried, load_logs, load_rig, mounted, plant_of, positive, read_controller
from gimbal_pin.cli.options import Json, Map, ModelFile, Payload, RigName, Seed
from gimbal_pin.cli.present import present
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.model import Model
    from gimbal_pin.pointing import Verified
    from gimbal_pin.rig import Rig
    from gimbal_pin.tracking import Tracking
    from gimbal_pin.tuning import Law


def track(
    rig: RigName,
    controller: Annotated[
        Positional[str | None],
        arg(
            metavar="CONTROLLER",
            help="a controller's YAML, from tune; on a platform its model is what is known, its gains are 'tuned''s",
        ),
    ] = None,
    *,
    payload: Payload = None,
    model: ModelFile = None,
    delay_samples: Annotated[
        int | None,
        arg(
            help="samples between measurement and torque",
            help_behavior_hint="(default: what the controller was tuned for, else 1)",
        ),
    ] = None,
    platform: Annotated[
        Literal["none", "S"], arg(help="hold the camera still on a platform that moves along profile S")
    ] = "none",
    platform_log: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="and, or, along a recorded motion: gyro_ and accel_ of the base link, low-passed at 20 Hz",
            help_behavior_hint="",
        ),
    ] = None,
    platform_size: Annotated[float, arg(help="profile S times this")] = 1.0,
    map: Map = (),
    steps: Annotated[
        bool, arg(help="step the thesis's angles beside that, with every law that a base at rest tells apart")
    ] = False,
    controllers: Annotated[
        str | None,
        arg(metavar="NAME,…", help="which controllers meet the platform", help_behavior_hint="(default: all)"),
    ] = None,
    learn: Annotated[
        str | None,
        arg(
            metavar="LOG",
            help="a log of the rig on a shaken platform: model and the platform's spectrum come from it",
            help_behavior_hint="(default: one is simulated, 60 s)",
        ),
    ] = None,
    find: Annotated[bool, arg(help="let diagnose look for causes in that log, and compensate them")] = False,
    effect: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="CAUSE:JOINT:NAME=VALUE,…", help="plant a cause, e.g. cogging:yaw:amplitude=0.1,harmonic=42"),
    ] = (),
    seeds: Annotated[int, arg(help="runs on a platform, each with its own motion and noise")] = 5,
    seconds: Annotated[float, arg(help="length of each of these runs, s")] = 30.0,
    jobs: Annotated[int, arg(help="processes that share these runs")] = 1,
    plot: Annotated[
        Path | None,
        arg(metavar="FILE", help="draw line of sight, spectrum, torque and budget", help_behavior_hint=""),
    ] = None,
    report: Annotated[
        Path | None,
        arg(metavar="FILE", help="write a report: what the camera sees, errors, torque", help_behavior_hint=""),
    ] = None,
    animation: Annotated[
        Path | None,
        arg(metavar="FILE", help="write the rig on its platform as an offline page", help_behavior_hint=""),
    ] = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Step tracking against a PID; on a platform that moves, every camera-holding controller at equal margins."""
    import numpy as np

    from gimbal_pin.tracking import track as run

    moving = platform != "none" or platform_log is not None
    if not moving:
        standing(controller, animation, steps)
    loaded = load_rig(rig, payload or (mounted(controller) if controller else None))
    told, result, found, verified = [], {}, None, None
    late = delay_samples if delay_samples is not None else 1 if controller is None else lateness(controller)
    stood = "the rig as its URDF states it" if model is None else f"the model in {model}"
    if controller is not None:
        found = run(plant_of(model, loaded), rivals(controller, loaded), rng=np.random.default_rng(seed), delay=late)
        told, result = [text.tracking(found, stood)], found.to_dict()
    if moving:
        from gimbal_pin.pointing.verify import Asked, verify

        for option, value in (("--seconds", seconds), ("--seeds", seeds), ("--jobs", jobs)):
            positive(option, value)
        carrier = carried(loaded, "none", platform_log, map, 1.0, 0.0, 1e-3, seed)
        asked = Asked(
            plant=None if model is None else plant_of(model, loaded),
            known=None if controller is None else known_by(controller, loaded),
            law=None if controller is None else read_controller(controller, loaded),
            recorded=carrier,
            profile=platform == "S",
            steps=steps,
            size=platform_size,
            names=None if controllers is None else tuple(controllers.split(",")),
            log=None if learn is None else load_logs(rig, loaded.payload, [learn], map)[1][0],
            find=find,
            causes=tuple(effect),
            seeds=seeds,
            seconds=seconds,
            jobs=jobs,
            delay=late,
            sweep=report is not None,
        )
        verified = verify(loaded, asked)
        whole = verified.to_dict()
        whole["experiments"] = [*result.get("experiments", ()), *whole.get("experiments", ())]
        told, result = [*told, text.verified(verified)], {**result, **whole}
    pages(loaded, verified, found, stood, plot, report, animation)
    present("\n\n".join(told), {"schema": 1, "experiments": [], **result}, json)


def standing(controller: str | None, animation: Path | None, steps: bool) -> None:
    """Refuse what makes no sense without a platform that moves."""
    motions = "--platform S, --platform-log FILE"
    if controller is None:
        raise UsageError("CONTROLLER", "is missing", f"name a controller's YAML, or a motion: {motions}")
    if animation is not None:
        raise UsageError("--animation", "has no platform to show", f"name a motion: {motions}")
    if steps:
        raise UsageError("--steps", "goes with a motion; a controller's own steps are run anyway", "give --platform S")


def pages(
    rig: Rig,
    held: Verified | None,
    steps: Tracking | None,
    plant: str,
    plot: Path | None,
    report: Path | None,
    animation: Path | None,
) -> None:
    """Write the pictures and pages that were asked for."""
    from gimbal_pin.io.files import atomic_write, replacing
    from gimbal_pin.pointing.chart import chart
    from gimbal_pin.report.carried import carried as whole
    from gimbal_pin.report.carried import moving

    if plot is not None and held is not None:
        with replacing(plot) as temporary:
            chart(held.contest).savefig(temporary)
    if report is not None:
        atomic_write(report, whole(rig, held, steps, plant))
    if animation is not None and held is not None:
        atomic_write(animation, moving(rig, held))


def known_by(name: str, rig: Rig) -> Model:
    """Return the model that the controller of a YAML was made for."""
    from gimbal_pin.model import model_from
    from gimbal_pin.reading import read_yaml

    read_controller(name, rig)
    return model_from(read_yaml(name)["model"], rig)


def lateness(name: str) -> int:
    """Return the samples from measurement to torque that a controller's YAML was tuned for."""
    from gimbal_pin.control.design import Wish
    from gimbal_pin.errors import ModelError
    from gimbal_pin.reading import read_yaml

    wish = read_yaml(name, ModelError).get("wish")
    if wish is None:
        raise ModelError(name, "holds no controller", "make one from a model: gimbal-pin tune RIG MODEL -o FILE")
    return Wish(delay=wish["delay"], dt=wish["dt"]).samples


def rivals(name: str, rig: Rig) -> dict[str, Law]:
    """Return the controller of a YAML under its kind, and beside it a PID that was asked for the same."""
    from gimbal_pin.model import model_from
    from gimbal_pin.reading import read_yaml
    from gimbal_pin.tuning import tune as run

    law, data = read_controller(name, rig), read_yaml(name)
    wish = {**data["wish"], "kind": "pid", "robust": False}
    if wish.get("disk_margin") is not None:  # a PID may not have it at any bandwidth
        granted = {joint: row["bandwidth_hz"] for joint, row in data["joints"].items()}
        wish |= {"bandwidth_hz": granted, "disk_margin": None}
    known = model_from(data["model"], rig)
    laws: dict[str, Law] = {} if data["controller"] == "pid" else {"pid": run(known, **wish).controller}
    return {data["controller"]: law, **laws}
