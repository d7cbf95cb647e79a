"""``gimbal-pin montecarlo``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction, arg

from gimbal_pin.cli.inputs import load_rig, mounted, plant_of, read_controller
from gimbal_pin.cli.options import HERE, Json, Payload, RigName, Seed, Workers, between, optional
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import present
from gimbal_pin.cli.work import affordable


@dataclass(frozen=True)
class StudyOptions:
    """Options of what each rig goes through."""

    controller: Annotated[
        Path | None, Reads(), optional("FILE", "a controller's YAML, from tune", "tuned for the nominal rig")
    ] = None
    retune: Annotated[bool, arg(help="tune a controller for each rig, as if its model were exact")] = False
    platform: Annotated[
        Literal["none", "S"], arg(help="hold the camera still on profile S, instead of stepping all axes")
    ] = "none"
    seconds: Annotated[float, between("--seconds", 0.6, 600, "s"), arg(help="length of each run")] = 5.0


DEFAULT_STUDY = StudyOptions()


def montecarlo(
    rig: RigName,
    model: Annotated[
        Positional[Path | None], Reads(), optional("[MODEL]", "a model's YAML, from identify", "as the URDF states it")
    ] = None,
    *,
    output: Annotated[
        str, arg(aliases=["-o"], metavar="DIR", help="folder or URL for the results; what is there goes on")
    ],
    count: Annotated[
        int, between("--count", 1, 10**7, kind=int), arg(help="rigs; with --sobol base points of the design")
    ] = 100,
    vary: Annotated[
        Path | None, Reads(), optional("FILE", "YAML of what varies", "covariance or 5 % inertials, payload, delay")
    ] = None,
    spec: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="'FIGURE < NUMBER'", help="a rig has to meet it, angles in degrees: 'jitter < 0.005'; repeatable"),
    ] = (),
    sobol: Annotated[bool, arg(help="Sobol indices: count times (inputs + 2) rigs, count a power of two")] = False,
    payload: Payload = None,
    study: Annotated[StudyOptions, OmitArgPrefixes] = DEFAULT_STUDY,
    workers: Annotated[Workers, OmitArgPrefixes] = HERE,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Simulate rigs that differ: how many meet a specification, what costs most of it, and the worst ten."""
    from gimbal_pin.fleet.engine import write_whole
    from gimbal_pin.fleet.montecarlo import monte_carlo
    from gimbal_pin.fleet.page import describe_monte_carlo
    from gimbal_pin.fleet.variation import Variation, choose_default_vary, read_vary

    loaded = load_rig(rig, payload or mounted(model) or mounted(study.controller))
    known = plant_of(model, loaded)
    varied = choose_default_vary(known) if vary is None else read_vary(vary)
    variation = Variation(known, varied, "variation" if vary is None else str(vary))
    variation.check()
    rigs = count * (len(variation.inputs) + 2 if sobol else 1)
    if workers.scheduler is None:
        kind = "second_of_a_joint_on_a_platform" if study.platform == "S" else "second_of_a_joint_in_a_fleet"
        affordable(workers.yes, workers.workers or 4096, **{kind: rigs * study.seconds * loaded.n})
    with workers.running() as (executor, several):
        found = monte_carlo(
            loaded,
            known,
            count=count,
            folder=output,
            vary=varied,
            spec=spec,
            controller=None if study.controller is None else read_controller(str(study.controller), loaded),
            retune=study.retune,
            platform=study.platform == "S",
            seconds=study.seconds,
            sobol=sobol,
            seed=seed,
            executor=executor,
            workers=several,
            quiet=False,
        )
    page = describe_monte_carlo(found)
    write_whole(output, "report.html", page.to_html().encode())
    present(page.to_text(), found.to_dict(), json)
