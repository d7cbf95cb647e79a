"""``gimbal-pin track``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gimbal_pin.cli.holding import MOTIONS, STILL, Holding
from gimbal_pin.cli.inputs import load_rig, read_controller, read_payload, read_plant
from gimbal_pin.cli.options import DELAY_SAMPLES, Json, ModelFile, Payload, Plants, RigName, Seed, Verbose, optional
from gimbal_pin.cli.present import present
from gimbal_pin.control.controllers import COMPILED
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Stored
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.dynamics.simulation import Controller
    from gimbal_pin.export import Library
    from gimbal_pin.rig.rig import Rig


def track(
    rig: RigName,
    controller: Annotated[
        Positional[str | None],
        arg(
            metavar="CONTROLLER",
            help="a controller's YAML, from tune: it steps, and holds the camera with its model and its gains",
        ),
    ] = None,
    *,
    compiled: Annotated[
        Path | None,
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
    plants: Plants = 50,
    seed: Seed = 0,
    verbose: Verbose = False,
    json: Json = None,
) -> None:
    """Step tracking against a PID; on a platform that moves, a camera held by computed torque and by a PID."""
    if controller is None and not held.moving:
        raise UsageError("CONTROLLER", "is missing", f"name a controller's YAML, or a motion: {MOTIONS}")
    if controller is None and compiled is not None:
        raise UsageError("--compiled", "has no CONTROLLER to stand beside", "name the YAML that it was exported from")
    held.check()
    loaded = load_rig(rig, payload or read_payload(controller))
    tuned = None if controller is None else read_controller(controller, loaded)
    machine = None if compiled is None else library(compiled, loaded)
    wish = None if tuned is None else tuned.wish
    late, held_late = (1, 1) if wish is None else (wish.samples, wish.holding_samples)
    if delay_samples is not None:
        late = held_late = delay_samples
    stood = "the controller's own model" if model is None else f"the model in {model}"
    log = held.taught(rig, loaded.payload) if held.moving else None
    steps, judged = None, None
    if tuned is not None:
        believed = tuned.model if model is None else read_plant(model, loaded)
        steps, judged = stepped(tuned, machine, believed, late, plants, seed)
    verified = None
    if held.moving:
        plant = None if model is None else read_plant(model, loaded)
        verified = held.verified(loaded, log, plant, tuned, machine, held_late)
    held.write(loaded, verified, steps, stood, judged)
    told = [] if steps is None or judged is None else [text.tracking(steps, judged, loaded)]
    told += [] if verified is None else [text.verified(verified, verbose)]
    own, more = ({} if one is None else one.to_dict() for one in (steps, verified))
    own |= {} if judged is None else {"judged": judged.to_dict()}
    present("\n\n".join(told), {"schema": 1, "experiments": [], **own, **more}, json)


def library(path: Path, rig: Rig) -> Library:
    """Load a compiled controller."""
    from gimbal_pin.export import Library

    return Library.load(path, rig)


def stepped(
    tuned: Stored, machine: Library | None, plant: Model, late: int, plants: int, seed: int
) -> tuple[Tracking, Judgement]:
    """Step a controller, its compiled twin if there is one, and its rival; judge them on plants around that one."""
    import numpy as np

    from gimbal_pin.control.judging import judge_controllers
    from gimbal_pin.control.tracking import track as run
    from gimbal_pin.control.tuning import RIVAL, pair_rivals

    twin: dict[str, Controller] = {} if machine is None else {COMPILED: machine.law}
    laws = {tuned.wish.kind: tuned.law, **twin, RIVAL: pair_rivals(tuned)[RIVAL]}
    delay = tuned.wish.delay if late == tuned.wish.samples else late * tuned.wish.dt
    steps = run(plant, laws, rng=np.random.default_rng(seed), delay=late)
    return steps, judge_controllers(plant, laws, rng=seed, plants=plants, delay=delay)
