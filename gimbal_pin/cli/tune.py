"""``gimbal-pin tune``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gimbal_pin.cli.inputs import filtering, load_logs, load_rig, mounted
from gimbal_pin.cli.options import (
    USUAL,
    Cutoff,
    Gains,
    Json,
    Map,
    MaybeYaml,
    Payload,
    Plants,
    Plotted,
    RigName,
    Verbose,
)
from gimbal_pin.cli.paths import Reads, logs
from gimbal_pin.cli.present import present
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.dynamics.model import Model


def tune(
    rig: RigName,
    source: Annotated[
        Positional[tuple[str, ...]], Reads(logs), arg(metavar="LOG|MODEL", help="logs, or a model's YAML")
    ],
    output: MaybeYaml = None,
    *,
    payload: Payload = None,
    map: Map = (),
    cutoff: Cutoff = None,
    gains: Annotated[Gains, OmitArgPrefixes] = USUAL,
    plants: Plants = 50,
    plot: Annotated[Plotted, arg(metavar="FILE", help="write the loops' plots: .png, .svg or .pdf")] = None,
    verbose: Verbose = False,
    json: Json = None,
) -> None:
    """Gains, margins and robust term from logs or from a model."""
    from gimbal_pin.control.judging import judge_controllers
    from gimbal_pin.control.tuning import pair_rivals
    from gimbal_pin.control.tuning import tune as run
    from gimbal_pin.log.io.files import open_replacement, write_yaml

    model = model_of(rig, payload, source, map, cutoff)
    found = run(model, **vars(gains))
    if output is not None:
        write_yaml(found.to_dict(), output)
    if plot is not None:
        with open_replacement(plot) as temporary:
            found.plot().savefig(temporary)
    judged = judge_controllers(model, pair_rivals(found.stored), rng=0, plants=plants, delay=found.wish.delay)
    told = f"{text.tuning(found, verbose)}\n\n{text.judgement(judged, model.rig)}"
    present(told, {**found.to_dict(), "judged": judged.to_dict()}, json)


def model_of(
    rig: str, payload: str | None, source: Sequence[str], mapping: Sequence[str], cutoff: float | None
) -> Model:
    """Read a model's YAML, or identify one from logs."""
    from gimbal_pin.identification import identify as run
    from gimbal_pin.identification.model_file import is_model, read_model

    if len(source) == 1 and is_model(source[0]):
        return read_model(source[0], load_rig(rig, payload or mounted(source[0])))
    loaded, logs = load_logs(rig, payload, source, mapping)
    return run(loaded, logs, filtering=filtering(cutoff, None)).model
