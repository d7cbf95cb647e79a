"""``gimbal-pin identify``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.cameras import list_tags, read_cameras
from gimbal_pin.cli.following import WHOLE, Following
from gimbal_pin.cli.inputs import choose_filter, load_logs
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import present, say
from gimbal_pin.cli.work import check_cost
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.identification import Identified
    from gimbal_pin.regression import Estimator


def identify(
    rig: opt.RigName,
    logs: opt.Logs,
    output: opt.MaybeYaml = None,
    *,
    urdf: opt.Urdf = None,
    payload: opt.Payload = None,
    mass: opt.Mass = None,
    map: opt.Map = (),
    cutoff: opt.Cutoff = None,
    alignment: opt.Alignment = None,
    estimator: opt.EstimatorName = "weighted",
    holdout: opt.Holdout = None,
    refit: bool = False,
    known: Annotated[opt.Maybe[str], Reads(unless="force"), arg(metavar="MODEL")] = None,
    force: bool = False,
    extended: Annotated[opt.Maybe[str], arg(metavar="MODEL")] = None,
    bias: bool = False,
    trust: Annotated[opt.Maybe[float], opt.between("--trust", 0.001, 10)] = None,
    bootstrap: Annotated[int, opt.between("--bootstrap", 0, 100000, kind=int)] = 0,
    seed: opt.Seed = 0,
    yes: opt.Yes = False,
    online: Annotated[Following, OmitArgPrefixes] = WHOLE,
    json: opt.Json = None,
) -> None:
    """Model with uncertainty from logs, and its fit on held-out data; LOG@PAYLOAD … of several cameras at once.

    Args:
        urdf: write the rig's URDF with the parameters in it
        refit: once the held-out error is known, estimate from all data: the newest log teaches, too
        known: a model's YAML of this gimbal: only the new camera is estimated, 10 s of motion do
        force: write -o over the model of --known
        extended: a model that diagnose found: its causes stand in the equations, so that they bend no body
        bias: test whether least squares is biased even where there is little noise
        trust: how far the URDF's bodies may be off, for ridge and for what the log does not show (default: 0.3)
        bootstrap: deviations by so many repetitions with blocks of residuals, not by their colour
    """
    from gimbal_pin.identification import (
        compare_payload,
        keep_held_out_accuracy,
        read_model,
        refittable_effects,
        report_with_payload,
    )
    from gimbal_pin.identification import identify as run
    from gimbal_pin.log.io.files import to_json
    from gimbal_pin.regression import TRUST

    online.check(
        {
            "--extended": extended is not None,
            "--estimator": estimator != "weighted",
            "--holdout": holdout is not None,
            "--bias": bias,
            "--refit": refit,
            "--mass": mass is not None,
            "--trust": trust is not None,
            "--bootstrap": bootstrap > 0,
        }
    )
    if extended is not None and known is not None:
        raise UsageError("--extended", "is given beside --known", "give the extended model as --known: its causes stay")
    filters, trusted = choose_filter(cutoff, alignment), trust or TRUST
    chosen = choose_estimator(estimator, trusted, bootstrap, seed)
    if not online.follow and (known is not None or len(list_tags(logs)) > 1):
        if known is None and urdf is not None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        if known is None and mass is not None:
            raise UsageError("--mass", "is of one payload", "give it with that payload's logs alone")
        fit = partial(read_cameras(rig, payload, logs, map, known, extended), estimator=chosen, filtering=filters)
        several = fit(holdout=holdout)
        if refit:
            several = fit(holdout=holdout or "last-third").refitted(fit(holdout="none"))
        several = replace(several, mass=mass)
        write(several.first, output, urdf, several.identified)
        return present(text.several(several), several.to_dict(), json)
    if online.follow:
        found = online.learn(online.start(rig, payload, logs, known, filters), logs[0], map, as_lines=json == Path("-"))
    else:
        loaded, read = load_logs(rig, payload, logs, map, moving=True)
        check_cost(yes, sample_of_a_repetition=bootstrap * sum(log.q.size for log in read))
        causes = () if extended is None else refittable_effects(read_model(extended, loaded))
        fitted = partial(run, loaded, read, estimator=chosen, filtering=filters, trust=trusted)
        found = fitted(causes, holdout=holdout, examined="always" if bias else "noisy")
        if refit:
            kept = tuple(term.effect for term in found.model.terms if term.effect in causes)
            whole = fitted(kept, holdout="none", examined="always" if bias else "noisy")
            found = keep_held_out_accuracy(found, whole)
    write(found, output, urdf)
    about = compare_payload(found, mass)
    result = report_with_payload(found, about)
    if online.follow and json == Path("-"):
        return say(to_json({**result, "kind": "result"}, None)[:-1])
    present(text.identified(found, about), result, json)


def write(
    found: Identified, output: Path | None, urdf: Path | None, each: Mapping[str, Identified] | None = None
) -> None:
    """Write the model, of every payload where there are several, and the URDF, each if it is asked for."""
    from gimbal_pin.identification.model_file import write_model
    from gimbal_pin.log.io.files import atomic_write

    if output is not None:
        write_model(found, output, each)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())


def choose_estimator(name: str, trust: float, bootstrap: int, seed: int) -> Estimator:
    """Return the estimator of a name, its deviations by repetition if so many are asked for."""
    import numpy as np

    from gimbal_pin.identification import ESTIMATORS, Bootstrap
    from gimbal_pin.regression import Method, fit_ridge

    chosen = partial(fit_ridge, trust=trust) if Method(name) is Method.RIDGE else ESTIMATORS[Method(name)]
    return chosen if bootstrap == 0 else Bootstrap(chosen, np.random.default_rng(seed), bootstrap)
