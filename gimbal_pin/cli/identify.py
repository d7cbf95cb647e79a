"""``gimbal-pin identify``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin.cli.cameras import Fit, cameras, tags_of
from gimbal_pin.cli.following import WHOLE, Following, by_line, concluded, followed
from gimbal_pin.cli.inputs import filtering, load_logs
from gimbal_pin.cli.options import (
    Alignment,
    Cutoff,
    EstimatorName,
    Holdout,
    Json,
    Logs,
    Map,
    Mass,
    MaybeYaml,
    Payload,
    RigName,
    Seed,
    Yes,
    between,
    optional,
)
from gimbal_pin.cli.paths import Reads, Writes
from gimbal_pin.cli.present import present
from gimbal_pin.cli.work import affordable
from gimbal_pin.errors import UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.effects import Effect
    from gimbal_pin.identification import Identified, WhenTested
    from gimbal_pin.log.log import Log
    from gimbal_pin.regression import Estimator
    from gimbal_pin.rig.rig import Rig


def identify(
    rig: RigName,
    logs: Logs,
    output: MaybeYaml = None,
    *,
    urdf: Annotated[
        Path | None,
        Writes(suffixes=(".urdf", ".xml")),
        optional("FILE", "write the rig's URDF with the parameters in it"),
    ] = None,
    payload: Payload = None,
    mass: Mass = None,
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
        Reads(unless="force"),
        optional("MODEL", "a model's YAML of this gimbal: only the new camera is estimated, 10 s of motion do"),
    ] = None,
    force: Annotated[bool, arg(help="write -o over the model of --known")] = False,
    extended: Annotated[
        str | None,
        Reads(),
        optional("MODEL", "a model that diagnose found: its causes stand in the equations, so that they bend no body"),
    ] = None,
    bias: Annotated[bool, arg(help="test whether least squares is biased even where there is little noise")] = False,
    trust: Annotated[
        float | None,
        between("--trust", 0.001, 10),
        optional(
            None,
            "how far the URDF's bodies may be off: for the ridge estimator, and for what the log does not show",
            "0.3",
        ),
    ] = None,
    bootstrap: Annotated[
        int,
        between("--bootstrap", 0, 100000, kind=int),
        arg(help="deviations by so many repetitions with blocks of residuals, not by their colour"),
    ] = 0,
    seed: Seed = 0,
    yes: Yes = False,
    online: Annotated[Following, OmitArgPrefixes] = WHOLE,
    json: Json = None,
) -> None:
    """Model with uncertainty from logs, and its fit on held-out data; LOG@PAYLOAD … of several cameras at once."""
    from gimbal_pin.identification import compare_payload, refittable_effects, report_with_payload
    from gimbal_pin.identification.model_file import read_model
    from gimbal_pin.regression import TRUST, Filtering

    trusted, filters = TRUST if trust is None else trust, filtering(cutoff, alignment)
    fit = Fit(estimator_of(estimator, trusted, bootstrap, seed), holdout, filters)
    asked = {
        "--extended": extended is not None,
        "--estimator": estimator != "weighted",
        "--holdout": holdout is not None,
        "--bias": bias,
        "--refit": refit,
        "--mass": mass is not None,
    }
    online.check({**asked, "--trust": trust is not None, "--bootstrap": bootstrap > 0})
    if online.follow:
        start = online.start(rig, payload, logs, known, filters or Filtering())
        learned = followed(start, logs[0], map, online, by_line(json))
        write(learned, output, urdf)
        concluded(learned, json)
        return
    if extended is not None and known is not None:
        raise UsageError("--extended", "is given beside --known", "give the extended model as --known: its causes stay")
    if known is not None or len(tags_of(logs)) > 1:
        if urdf is not None and known is None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        if mass is not None and known is None:
            raise UsageError("--mass", "is of one payload", "give it with that payload's logs alone")
        several = replace(cameras(rig, payload, logs, map, known, extended, fit, refit), mass=mass)
        write(several.first, output, urdf, several.identified)
        present(text.several(several), several.to_dict(), json)
        return
    loaded, read = load_logs(rig, payload, logs, map, moving=True)
    affordable(yes, sample_of_a_repetition=bootstrap * sum(log.q.size for log in read))
    causes = () if extended is None else refittable_effects(read_model(extended, loaded))
    found = identified(loaded, read, fit, bias, refit, trusted, causes)
    write(found, output, urdf)
    about = compare_payload(found, mass)
    present(text.identified(found, about), report_with_payload(found, about), json)


def identified(
    rig: Rig, logs: Sequence[Log], fit: Fit, bias: bool, refit: bool, trust: float, causes: tuple[Effect, ...] = ()
) -> Identified:
    """Identify a rig from logs of one payload; with `refit` from all data, once the held-out error is known."""
    from gimbal_pin.identification import identify as run
    from gimbal_pin.identification import keep_held_out_accuracy

    examined: WhenTested = "always" if bias else "noisy"
    found = run(rig, logs, causes, **vars(fit), examined=examined, trust=trust)
    if not refit:
        return found
    kept = tuple(term.effect for term in found.model.terms if term.effect in causes)
    return keep_held_out_accuracy(
        found, run(rig, logs, kept, **vars(replace(fit, holdout="none")), examined=examined, trust=trust)
    )


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


def estimator_of(name: EstimatorName, trust: float, bootstrap: int, seed: int) -> Estimator:
    """Return the estimator of a name, its deviations by repetition if so many are asked for."""
    from gimbal_pin.identification import ESTIMATORS, Bootstrap
    from gimbal_pin.regression import Method, check_trust, fit_ridge

    check_trust(trust)
    chosen = partial(fit_ridge, trust=trust) if Method(name) is Method.RIDGE else ESTIMATORS[Method(name)]
    if bootstrap == 0:
        return chosen
    import numpy as np

    return Bootstrap(chosen, np.random.default_rng(seed), bootstrap)
