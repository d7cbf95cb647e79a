"""``gimbal-pin auto``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin.cli.inputs import filtering, load_logs, play, run_of
from gimbal_pin.cli.options import (
    USUAL,
    Alignment,
    Cutoff,
    EstimatorName,
    Folder,
    Gains,
    Holdout,
    Json,
    Logs,
    Map,
    Mass,
    Payload,
    Plants,
    RigName,
    Seed,
    Verbose,
)
from gimbal_pin.cli.present import noted, present
from gimbal_pin.report import text


def auto(
    rig: RigName,
    logs: Logs,
    output: Folder,
    *,
    payload: Payload = None,
    mass: Mass = None,
    map: Map = (),
    cutoff: Cutoff = None,
    alignment: Alignment = None,
    estimator: EstimatorName = "weighted",
    holdout: Holdout = None,
    gains: Annotated[Gains, OmitArgPrefixes] = USUAL,
    live: Annotated[bool, arg(help="show the result in a browser")] = False,
    plants: Plants = 50,
    seed: Seed = 0,
    verbose: Verbose = False,
    json: Json = None,
) -> None:
    """All of it: identify, diagnose, extend the model, tune, verify, report and animation."""
    asked_for = run_of("auto", locals())
    import numpy as np

    from gimbal_pin.identification import ESTIMATORS
    from gimbal_pin.log.log import find_interval
    from gimbal_pin.regression import Method
    from gimbal_pin.report.pipeline import auto as run

    loaded, read = load_logs(rig, payload, logs, map, moving=True)
    found = run(
        loaded,
        read,
        output,
        rng=np.random.default_rng(seed),
        estimator=ESTIMATORS[Method(estimator)],
        holdout=holdout,
        filtering=filtering(cutoff, alignment),
        wish=gains.to_wish(find_interval(log.dt for log in read)),
        run=asked_for,
        mass=mass,
        plants=plants,
    )
    noted(found.notes)
    present(text.auto(found, verbose), found.to_dict(), json)
    if live:
        play(loaded, found.animated)
