"""``gimbal-pin track``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gimbal_pin.cli.holding import MOTIONS, NO_PAGES, STILL, Holding, Pages
from gimbal_pin.cli.inputs import load_rig, mounted, plant_of, read_controller
from gimbal_pin.cli.options import DELAY_SAMPLES, Json, ModelFile, Payload, RigName, Seed, Verbose, optional
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import present
from gimbal_pin.control.controllers import COMPILED
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Law, Stored
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.dynamics.simulation import Controller
    from gimbal_pin.export import Library
    from gimbal_pin.rig.rig import Rig


def track(
    rig: RigName,
    controller: Annotated[
        Positional[str | None],
        Reads(),
        arg(
            metavar="CONTROLLER",
            help="a controller's YAML, from tune; on a platform its model is what is known, its gains are 'tuned''s",
        ),
    ] = None,
    *,
    compiled: Annotated[
        Path | None,
        Reads(),
        optional("FILE", "CONTROLLER's compiled library (.so), see export: steps and holds the camera beside it"),
    ] = None,
    payload: Payload = None,
    model: ModelFile = None,
    delay_samples: Annotated[
        int | None,
        DELAY_SAMPLES,
        arg(
            help="samples between measurement and torque",
            help_behavior_hint="(default: what the controller was tuned for, else 1)",
        ),
    ] = None,
    held: Annotated[Holding, OmitArgPrefixes] = STILL,
    pages: Annotated[Pages, OmitArgPrefixes] = NO_PAGES,
    seed: Seed = 0,
    verbose: Verbose = False,
    json: Json = None,
) -> None:
    """Step tracking against a PID; on a platform that moves, every camera-holding controller at equal margins."""
    if controller is None and not held.moving:
        raise UsageError("CONTROLLER", "is missing", f"name a controller's YAML, or a motion: {MOTIONS}")
    if controller is None and compiled is not None:
        raise UsageError("--compiled", "has no CONTROLLER to stand beside", "name the YAML that it was exported from")
    held.check()
    pages.check(held.moving)
    loaded = load_rig(rig, payload or mounted(controller))
    tuned = None if controller is None else read_controller(controller, loaded)
    machine = None if compiled is None else library(compiled, loaded)
    wish = None if tuned is None else tuned.wish
    late, held_late = (1, 1) if wish is None else (wish.samples, wish.holding_samples)
    if delay_samples is not None:
        late = held_late = delay_samples
    stood = "the rig as its URDF states it" if model is None else f"the model in {model}"
    log = held.taught(rig, loaded.payload) if held.moving else None
    steps = None if tuned is None else stepped(tuned, machine, plant_of(model, loaded), late, seed)
    verified = None
    if held.moving:
        plant = None if model is None else plant_of(model, loaded)
        known, law = (None, None) if tuned is None else (tuned.model, tuned.law)
        verified = held.verified(loaded, plant, known, law, log, held_late, pages.report is not None, machine)
    pages.write(loaded, verified, steps, stood)
    told = [] if steps is None else [text.tracking(steps, stood, loaded if verbose else None)]
    told += [] if verified is None else [text.verified(verified, verbose)]
    own, more = ({} if one is None else one.to_dict() for one in (steps, verified))
    experiments = [*own.get("experiments", ()), *more.get("experiments", ())]
    present("\n\n".join(told), {"schema": 1, **own, **more, "experiments": experiments}, json)


def rivals(tuned: Stored) -> dict[str, Law]:
    """Return a controller under its kind, and beside it a PID that was asked for the same."""
    from gimbal_pin.control.tuning import tune as run

    if tuned.wish.kind == "pid":
        return {"pid": tuned.law}
    wish = replace(tuned.wish, kind="pid", robust=False)
    if wish.disk_margin is not None:  # a PID may not have it at any bandwidth
        granted = {joint: hz for joint, hz in tuned.bandwidth_hz.items() if hz is not None}
        wish = replace(wish, bandwidth_hz=granted, disk_margin=None)
    return {tuned.wish.kind: tuned.law, "pid": run(tuned.model, **vars(wish)).controller}


def library(path: Path, rig: Rig) -> Library:
    """Load a compiled controller."""
    from gimbal_pin.export import Library

    return Library.load(path, rig)


def stepped(tuned: Stored, machine: Library | None, plant: Model, late: int, seed: int) -> Tracking:
    """Step a controller, its compiled twin if there is one, and its rival."""
    import numpy as np

    from gimbal_pin.control.tracking import track as run

    twin: dict[str, Controller] = {} if machine is None else {COMPILED: machine.law}
    return run(plant, {**rivals(tuned), **twin}, rng=np.random.default_rng(seed), delay=late)
