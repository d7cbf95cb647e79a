"""``gimbal-pin identify``."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from gimbal_pin import text
from gimbal_pin.cli.cameras import cameras, tags_of
from gimbal_pin.cli.following import followed
from gimbal_pin.cli.inputs import alone, filtering, load_logs
from gimbal_pin.cli.options import (
    Alignment,
    Bootstrap,
    Cutoff,
    EstimatorName,
    Holdout,
    Json,
    Logs,
    Map,
    MaybeOutput,
    Payload,
    RigName,
    Seed,
    Trust,
)
from gimbal_pin.cli.present import present
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.estimators import Estimator


def identify(
    rig: RigName,
    logs: Logs,
    output: MaybeOutput = None,
    *,
    urdf: Annotated[
        Path | None, arg(metavar="FILE", help="write the rig's URDF with the parameters in it", help_behavior_hint="")
    ] = None,
    payload: Payload = None,
    map: Map = (),
    cutoff: Cutoff = None,
    alignment: Alignment = None,
    estimator: EstimatorName = "weighted",
    holdout: Holdout = None,
    known: Annotated[
        str | None,
        arg(
            metavar="MODEL",
            help="a model's YAML of this gimbal: only the new camera is estimated, 10 s of motion do",
            help_behavior_hint="",
        ),
    ] = None,
    bias: Annotated[bool, arg(help="test whether least squares is biased even where there is little noise")] = False,
    trust: Trust = None,
    bootstrap: Bootstrap = 0,
    seed: Seed = 0,
    follow: Annotated[
        bool, arg(help="learn from one growing CSV file, or from - (standard input), as it is written; Ctrl-C ends it")
    ] = False,
    forget: Annotated[
        float | None,
        arg(metavar="SECONDS", help="with --follow: what is older counts less", help_behavior_hint="(default: never)"),
    ] = None,
    anew: Annotated[
        Literal["payload", "everything"],
        arg(help="with --follow: what is estimated anew when the payload has changed"),
    ] = "payload",
    idle: Annotated[
        float | None,
        arg(
            metavar="SECONDS",
            help="with --follow: end when the file has not grown for so long",
            help_behavior_hint="(default: never)",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="with --follow: write the estimates over time: .png, .svg or .pdf",
            help_behavior_hint="",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Model with uncertainty from logs, and its fit on held-out data; LOG@PAYLOAD … of several cameras at once."""
    from gimbal_pin.balance import reported
    from gimbal_pin.bodies import TRUST
    from gimbal_pin.identification import identify as run
    from gimbal_pin.io.files import atomic_write
    from gimbal_pin.io.model import write_model

    trusted = TRUST if trust is None else trust
    method = estimator_of(estimator, trusted, bootstrap, seed)
    options: Any = {"estimator": method, "holdout": holdout, "filtering": filtering(cutoff, alignment)}
    if follow:
        batch_only = {
            "--estimator": estimator != "weighted",
            "--holdout": holdout is not None,
            "--bias": bias,
            "--trust": trust is not None,
            "--bootstrap": bootstrap > 0,
        }
        alone("--follow", batch_only, "it learns by weighted least squares and is tested on what comes next")
        wish = {"fading": inf if forget is None else forget, "everything": anew == "everything"}
        followed(
            rig, payload, logs, map, known, {**wish, "filtering": options["filtering"]}, idle, output, urdf, plot, json
        )
        return
    given = {"--forget": forget, "--idle": idle, "--plot": plot, "--anew": anew if anew != "payload" else None}
    alone("a log that is whole", {name: value is not None for name, value in given.items()}, "add --follow")
    if known is not None or len(tags_of(logs)) > 1:
        several = cameras(rig, payload, logs, map, known, options)
        if urdf is not None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        if output is not None:
            write_model(several.first, output, several.identified)
        present(text.several(several), several.to_dict(), json)
        return
    loaded, read = load_logs(rig, payload, logs, map)
    found = replace(run(loaded, read, **options, examined="always" if bias else "noisy"), trust=trusted)
    if output is not None:
        write_model(found, output)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())
    present(text.identified(found), reported(found), json)


def estimator_of(name: EstimatorName, trust: float, bootstrap: int, seed: int) -> Estimator:
    """Return the estimator of a name, its deviations by repetition if so many are asked for."""
    from gimbal_pin.estimators import ESTIMATORS, Bootstrap, Ridge

    ridge = Ridge(trust)  # it checks the trust, which matters to all
    chosen = ridge if name == "ridge" else ESTIMATORS[name]
    if bootstrap == 0:
        return chosen
    import numpy as np

    return Bootstrap(chosen, np.random.default_rng(seed), bootstrap)
