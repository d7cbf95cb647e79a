"""``gimbal-pin auto``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.cameras import read_known_gimbal
from gimbal_pin.cli.inputs import choose_filter, describe_origin, describe_run, load_logs
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import play, present, tell


def auto(
    rig: opt.RigName,
    logs: opt.Logs,
    output: opt.AutoFolder,
    *,
    payload: opt.Payload = None,
    mass: opt.Mass = None,
    known: Annotated[opt.Maybe[str], Reads(), arg(metavar="MODEL")] = None,
    map: opt.Map = (),
    cutoff: opt.Cutoff = None,
    alignment: opt.Alignment = None,
    estimator: opt.EstimatorName = "weighted",
    holdout: opt.Holdout = None,
    gains: Annotated[opt.Gains, OmitArgPrefixes] = opt.GAINS_READER,
    live: opt.LiveView = False,
    plants: opt.Plants = 50,
    seed: opt.Seed = 0,
    verbose: opt.Verbose = False,
    json: opt.Json = None,
) -> None:
    """All of it: identify, diagnose, extend the model, tune, verify, report and animation.

    Args:
        known: a model's YAML of this gimbal: only the new camera is estimated, 10 s of motion do
    """
    asked = describe_run("auto", locals())
    origin = describe_origin(auto, locals())
    import numpy as np

    from gimbal_pin.report.pipeline import auto as run
    from gimbal_pin.report.pipeline import describe_outcome

    loaded, read = load_logs(rig, payload, logs, map, moving=known is None)
    first = None if known is None else read_known_gimbal(rig, payload, logs, known)
    found = run(
        loaded, read, output, rng=np.random.default_rng(seed), estimator=estimator, holdout=holdout,
        filtering=choose_filter(cutoff, alignment), wish=gains.to_wish, run=asked, mass=mass, plants=plants,
        known=first, origin=origin,
    )  # fmt: skip
    tell(found.notes)
    present(describe_outcome(found, verbose), found.to_dict(), json)
    if live:
        play(loaded, found.animated)
