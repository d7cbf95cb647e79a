"""``gimbal-pin identify``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.cameras import list_tags, read_cameras
from gimbal_pin.cli.following import learn
from gimbal_pin.cli.inputs import choose_filter, load_logs, load_rig, read_payload
from gimbal_pin.cli.paths import Reads
from gimbal_pin.cli.present import present, say
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.identification import IdentificationResult, Online, Several, WhenTested
    from gimbal_pin.regression import Filtering
    from gimbal_pin.rig.rig import Rig


def identify(
    rig: opt.RigName,
    logs: opt.Logs,
    output: opt.MaybeYaml = None,
    *,
    urdf: opt.Urdf = None,
    mcap: opt.Mcap = None,
    rrd: opt.Rrd = None,
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
    follow: bool = False,
    forget: Annotated[opt.Maybe[float], opt.between("--forget", 0.1, 1e6, "s")] = None,
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
        follow: learn from a growing CSV file, - (standard input), or a gimbal: udp://HOST:PORT, serial:DEVICE@BAUD
        forget: with --follow: what is older counts less (default: never)
        idle: with --follow: end when the file has not grown for so long (default: never)
        plot: with --follow: write the estimates over time: .png, .svg or .pdf
    """
    from gimbal_pin.diagnosis import limit_band
    from gimbal_pin.export.recordings import check_recordings, write_recordings
    from gimbal_pin.identification import identify as run
    from gimbal_pin.regression import TRUST

    check_recordings(mcap, rrd)
    check_follow_options(
        follow=follow,
        whole=(
            *(
                ("--extended", extended),
                ("--estimator", estimator != "weighted"),
                ("--holdout", holdout),
            ),
            *(("--bias", bias), ("--refit", refit), ("--mass", mass), ("--trust", trust)),
            *(("--mcap", mcap), ("--rrd", rrd)),
        ),
        growing=(("--forget", forget), ("--idle", idle is not None), ("--plot", plot)),
    )
    if extended is not None and known is not None:
        raise UsageError(
            "--extended",
            "is given beside --known",
            "give the extended model as --known: its causes stay",
        )
    filters = choose_filter(cutoff, alignment)
    trusted = trust or TRUST
    if not follow and (known is not None or len(list_tags(logs)) > 1):
        if known is None and urdf is not None:
            raise UsageError(
                "--urdf", "takes one payload", "write it from that payload's logs alone"
            )
        if known is None and mass is not None:
            raise UsageError(
                "--mass", "is of one payload", "give it with that payload's logs alone"
            )
        if mcap is not None or rrd is not None:
            raise UsageError(
                "--mcap, --rrd",
                "take one payload without --known",
                "write them with 'gimbal-pin diagnose'",
            )
        estimate = partial(
            read_cameras(rig, payload, logs, map, known, extended),
            estimator=estimator,
            trust=trusted,
            filtering=filters,
        )
        return tell_cameras(estimate, holdout, refit, mass, output, urdf, json)
    if follow:
        online = start_online(rig, logs, payload, known, filters, forget)
        found = learn(online, logs[0], map, idle, plot, json == Path("-"))
    else:
        loaded, read = load_logs(rig, payload, logs, map, moving=True)
        when: WhenTested = "always" if bias else "noisy"
        fit = partial(
            run, loaded, read, estimator=estimator, filtering=filters, trust=trusted, examined=when
        )
        found = identify_beside_causes(fit, loaded, extended, holdout, refit)
        write_recordings(found.model, read, filters or limit_band(read), mcap, rrd)
    write_models(found, output, urdf)
    tell_model(found, mass, json, as_lines=follow and json == Path("-"))


def check_follow_options(
    *, follow: bool, whole: Sequence[tuple[str, object]], growing: Sequence[tuple[str, object]]
) -> None:
    """Raise `UsageError` for an option of whole logs beside ``--follow``, or of a growing one without."""
    for option, given in whole if follow else growing:
        if given and follow:
            mend = "it learns by weighted least squares and is tested on what comes next"
            raise UsageError(option, "does not go with --follow", mend)
        if given:
            raise UsageError(option, "does not go with a log that is whole", "add --follow")


def tell_cameras(
    estimate: Callable[..., Several],
    holdout: str | None,
    refit: bool,
    mass: float | None,
    output: Path | None,
    urdf: Path | None,
    json: Path | None,
) -> None:
    """Estimate several cameras, or a new one on a known gimbal, write their models, and tell them."""
    from gimbal_pin.report.pages import describe_record

    several = estimate(holdout=holdout or "last-third" if refit else holdout)
    several = replace(several.refitted(estimate(holdout="none")) if refit else several, mass=mass)
    write_models(several.first, output, urdf, several.identified)
    present(describe_record(several).to_text(), several.to_dict(), json)


def start_online(
    rig: str,
    logs: Sequence[str],
    payload: str | None,
    known: str | None,
    filters: Filtering | None,
    forget: float | None,
) -> Online:
    """Return what learns from a log that grows."""
    from gimbal_pin.identification import Online, read_model

    if len(logs) != 1:
        raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
    loaded = load_rig(rig, payload or list_tags(logs)[0])
    before = None if known is None else read_model(known, load_rig(rig, read_payload(known)))
    return Online.of(loaded, filtering=filters, fading=forget or inf, known=before)


def identify_beside_causes(
    fit: Callable[..., IdentificationResult],
    rig: Rig,
    extended: str | None,
    holdout: str | None,
    refit: bool,
) -> IdentificationResult:
    """Fit a rig beside the causes of an extended model, if one is named, and from all data at last, if that is asked.

    Args:
        fit: What fits it, of causes and what is held out.
        rig: The rig.
        extended: The extended model's file.
        holdout: What is held out.
        refit: Whether all data teach at last.
    """
    from gimbal_pin.identification import (
        describe_omitted_effects,
        keep_held_out_accuracy,
        read_model,
        refittable_effects,
    )

    further = None if extended is None else read_model(extended, rig)
    causes = () if further is None else refittable_effects(further)
    found = fit(causes, holdout=holdout)
    if refit:
        kept = tuple(term.effect for term in found.model.terms if term.effect in causes)
        found = keep_held_out_accuracy(found, fit(kept, holdout="none"))
    return replace(
        found, notes=(*found.notes, *(() if further is None else describe_omitted_effects(further)))
    )


def tell_model(
    found: IdentificationResult, mass: float | None, json: Path | None, as_lines: bool
) -> None:
    """Tell a model: as one more line of JSON, or as a page's sections."""
    from gimbal_pin.identification import compare_payload, report_with_payload
    from gimbal_pin.log.io.files import to_json
    from gimbal_pin.report.pages import describe_record

    result = report_with_payload(found, compare_payload(found, mass))
    if as_lines:
        return say(to_json({**result, "kind": "result"}, None)[:-1])
    present(describe_record(replace(found, mass=mass)).to_text(), result, json)


def write_models(
    found: IdentificationResult,
    output: Path | None,
    urdf: Path | None,
    each: Mapping[str, IdentificationResult] | None = None,
) -> None:
    """Write the model, of every payload where there are several, and the URDF, each if it is asked for."""
    from gimbal_pin.identification.model_file import write_model
    from gimbal_pin.log.io.files import atomic_write

    if output is not None:
        write_model(found, output, each)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())
