"""``gimbal-pin identify``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.cameras import list_tags, read_cameras
from gimbal_pin.cli.following import learn
from gimbal_pin.cli.inputs import choose_filter, load_logs, load_rig, read_payload
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import present, say
from gimbal_pin.cli.work import check_cost
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.identification import Identified, WhenTested
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
    follow: bool = False,
    forget: Annotated[opt.Maybe[float], opt.between("--forget", 0.1, 1e6, "s")] = None,
    anew: Literal["payload", "everything"] = "payload",
    idle: Annotated[opt.Maybe[float], opt.between("--idle", 0, 1e6, "s")] = None,
    plot: opt.Plotted = None,
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
        follow: learn from a growing CSV file, - (standard input), or a gimbal: udp://HOST:PORT, serial:DEVICE@BAUD
        forget: with --follow: what is older counts less (default: never)
        anew: with --follow: what is estimated anew when the payload has changed
        idle: with --follow: end when the file has not grown for so long (default: never)
        plot: with --follow: write the estimates over time: .png, .svg or .pdf
    """
    from gimbal_pin.identification import (
        Online,
        compare_payload,
        describe_omitted_effects,
        keep_held_out_accuracy,
        read_model,
        refittable_effects,
        report_with_payload,
    )
    from gimbal_pin.identification import identify as run
    from gimbal_pin.log.io.files import to_json
    from gimbal_pin.regression import TRUST
    from gimbal_pin.report.html import join_text
    from gimbal_pin.report.sections.model import show_cameras, show_parameters, show_torque

    whole = (
        *(("--extended", extended), ("--estimator", estimator != "weighted"), ("--holdout", holdout), ("--bias", bias)),
        *(("--refit", refit), ("--mass", mass), ("--trust", trust), ("--bootstrap", bootstrap)),
    )
    growing = (("--forget", forget), ("--idle", idle is not None), ("--plot", plot), ("--anew", anew != "payload"))
    for option, given in whole if follow else growing:
        if given and follow:
            mend = "it learns by weighted least squares and is tested on what comes next"
            raise UsageError(option, "does not go with --follow", mend)
        if given:
            raise UsageError(option, "does not go with a log that is whole", "add --follow")
    if extended is not None and known is not None:
        raise UsageError("--extended", "is given beside --known", "give the extended model as --known: its causes stay")
    filters, trusted, as_lines = choose_filter(cutoff, alignment), trust or TRUST, follow and json == Path("-")
    chosen = choose_estimator(estimator, trusted, bootstrap, seed)
    if not follow and (known is not None or len(list_tags(logs)) > 1):
        if known is None and urdf is not None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        if known is None and mass is not None:
            raise UsageError("--mass", "is of one payload", "give it with that payload's logs alone")
        estimate = partial(read_cameras(rig, payload, logs, map, known, extended), estimator=chosen, filtering=filters)
        several = estimate(holdout=holdout or "last-third" if refit else holdout)
        several = replace(several.refitted(estimate(holdout="none")) if refit else several, mass=mass)
        write_models(several.first, output, urdf, several.identified)
        return present(join_text([show_cameras(several)]), several.to_dict(), json)
    if follow:
        if len(logs) != 1:
            raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
        loaded = load_rig(rig, payload or list_tags(logs)[0])
        before = None if known is None else read_model(known, load_rig(rig, read_payload(known)))
        anything = anew == "everything"
        online = Online.of(loaded, filtering=filters, fading=forget or inf, everything=anything, known=before)
        found = learn(online, logs[0], map, idle, plot, as_lines)
    else:
        loaded, read = load_logs(rig, payload, logs, map, moving=True)
        check_cost(yes, sample_of_a_repetition=bootstrap * sum(log.q.size for log in read))
        further = None if extended is None else read_model(extended, loaded)
        causes = () if further is None else refittable_effects(further)
        when: WhenTested = "always" if bias else "noisy"
        fit = partial(run, loaded, read, estimator=chosen, filtering=filters, trust=trusted, examined=when)
        found = fit(causes, holdout=holdout)
        if refit:
            kept = tuple(term.effect for term in found.model.terms if term.effect in causes)
            found = keep_held_out_accuracy(found, fit(kept, holdout="none"))
        found = replace(found, notes=(*found.notes, *(() if further is None else describe_omitted_effects(further))))
    write_models(found, output, urdf)
    about = compare_payload(found, mass)
    result = report_with_payload(found, about)
    if as_lines:
        return say(to_json({**result, "kind": "result"}, None)[:-1])
    present(join_text([show_parameters(found, about), show_torque(found)]), result, json)


def write_models(
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
