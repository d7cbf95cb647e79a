"""``gimbal-pin montecarlo``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import describe_origin, load_rig, read_payload, read_plant, read_tuned
from gimbal_pin.cli.present import present


def montecarlo(
    rig: opt.RigName,
    model: Annotated[Positional[Path | None], arg(metavar="[MODEL]", help_behavior_hint="")] = None,
    *,
    output: opt.Results,
    count: Annotated[int, opt.between("--count", 1, 10**6, kind=int)] = 100,
    vary: opt.File = None,
    spec: Annotated[opt.Repeated, arg(metavar="'FIGURE < NUMBER'")] = (),
    sobol: bool = False,
    payload: opt.Payload = None,
    controller: opt.File = None,
    retune: bool = False,
    platform: Literal["none", "S"] = "none",
    seconds: Annotated[float, opt.between("--seconds", 0.6, 600, "s")] = 5.0,
    workers: opt.Workers = 0,
    scheduler: opt.Scheduler = None,
    seed: opt.Seed = 0,
    json: opt.Json = None,
) -> None:
    """Simulate rigs that differ: how many meet a specification, which inputs use most of it, and the worst ten.

    Args:
        model: a model's YAML, from identify (default: as the URDF states it)
        count: rigs; with --sobol base points of the design
        vary: YAML of what varies (default: covariance or 5 % inertials, payload, delay)
        spec: a rig has to meet it, angles in degrees: 'jitter < 0.005'
        sobol: Sobol indices: count times (inputs + 2) rigs, count a power of two
        controller: a controller's YAML, from tune (default: tuned for the nominal rig)
        retune: tune a controller for each rig, as if its model were exact
        platform: hold the camera still on profile S, instead of stepping all axes
        seconds: length of each run
    """
    origin = describe_origin(montecarlo, locals())
    from gimbal_pin.fleet import open_executor
    from gimbal_pin.fleet.montecarlo import monte_carlo
    from gimbal_pin.log.io.files import atomic_write
    from gimbal_pin.report.pages import describe_record

    loaded = load_rig(rig, payload or read_payload(model) or read_payload(controller))
    known = read_plant(model, loaded)
    stored = None if controller is None else read_tuned(controller, loaded)
    with open_executor(workers, scheduler) as executor:
        study = monte_carlo(
            loaded, known, count=count, folder=output, vary=vary, spec=spec, controller=stored, retune=retune,
            platform=platform == "S", seconds=seconds, sobol=sobol, seed=seed, executor=executor, quiet=False,
        )  # fmt: skip
    page = replace(describe_record(study), origin=origin)
    atomic_write(output / "report.html", page.to_html())
    present(page.to_text(), study.to_dict(), json)
