"""``gimbal-pin identify``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin import text
from gimbal_pin.cli.cameras import cameras, tags_of
from gimbal_pin.cli.following import WHOLE, Following, by_line, concluded, followed
from gimbal_pin.cli.inputs import filtering, load_logs
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
    from gimbal_pin.identification import Identified


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
    refit: Annotated[
        bool, arg(help="once the held-out error is known, estimate from all data: the newest log teaches, too")
    ] = False,
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
    online: Annotated[Following, OmitArgPrefixes] = WHOLE,
    json: Json = None,
) -> None:
    """Model with uncertainty from logs, and its fit on held-out data; LOG@PAYLOAD … of several cameras at once."""
    from gimbal_pin.balance import reported
    from gimbal_pin.bodies import TRUST
    from gimbal_pin.identification import identify as run
    from gimbal_pin.identification import refitted

    trusted, filters = TRUST if trust is None else trust, filtering(cutoff, alignment)
    method = estimator_of(estimator, trusted, bootstrap, seed)
    asked = {"--estimator": estimator != "weighted", "--holdout": holdout is not None, "--bias": bias, "--refit": refit}
    online.check({**asked, "--trust": trust is not None, "--bootstrap": bootstrap > 0})
    if online.follow:
        start = online.start(rig, payload, logs, known, filters)
        learned = followed(start, logs[0], map, online, by_line(json))
        write(learned, output, urdf)
        concluded(learned, json)
        return
    options: Any = {"estimator": method, "holdout": holdout, "filtering": filters}
    if known is not None or len(tags_of(logs)) > 1:
        if urdf is not None and known is None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        several = cameras(rig, payload, logs, map, known, options, refit)
        write(several.first, output, urdf, several.identified)
        present(text.several(several), several.to_dict(), json)
        return
    loaded, read = load_logs(rig, payload, logs, map)
    options["examined"] = "always" if bias else "noisy"
    found = run(loaded, read, **options)
    if refit:
        found = refitted(found, run(loaded, read, **{**options, "holdout": "none"}))
    found = replace(found, trust=trusted)
    write(found, output, urdf)
    present(text.identified(found), reported(found), json)


def write(
    found: Identified, output: Path | None, urdf: Path | None, each: Mapping[str, Identified] | None = None
) -> None:
    """Write the model, of every payload where there are several, and the URDF, each if it is asked for."""
    from gimbal_pin.io.files import atomic_write
    from gimbal_pin.io.model import write_model

    if output is not None:
        write_model(found, output, each)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())


def estimator_of(name: EstimatorName, trust: float, bootstrap: int, seed: int) -> Estimator:
    """Return the estimator of a name, its deviations by repetition if so many are asked for."""
    from gimbal_pin.estimators import ESTIMATORS, Bootstrap, Ridge

    ridge = Ridge(trust)  # it checks the trust, which matters to all
    chosen = ridge if name == "ridge" else ESTIMATORS[name]
    if bootstrap == 0:
        return chosen
    import numpy as np

    return Bootstrap(chosen, np.random.default_rng(seed), bootstrap)
