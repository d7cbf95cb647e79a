"""``gimbal-pin tune``."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import choose_filter, load_logs, load_rig, read_payload
from gimbal_pin.cli.present import present, write_figure


def tune(
    rig: opt.RigName,
    source: Annotated[
        Positional[tuple[str, ...]], arg(metavar="LOG|MODEL", help_behavior_hint="(at least one)")
    ],
    output: opt.MaybeYaml = None,
    *,
    payload: opt.Payload = None,
    map: opt.Map = (),
    cutoff: opt.Cutoff = None,
    gains: Annotated[opt.Gains, OmitArgPrefixes] = opt.GAINS_READER,
    plants: opt.Plants = 50,
    plot: opt.Plotted = None,
    verbose: opt.Verbose = False,
    json: opt.Json = None,
) -> None:
    """Gains, margins and robust term from logs or from a model.

    Args:
        source: logs, or a model's YAML
        plot: write the loops' plots: .png, .svg or .pdf
    """
    from gimbal_pin.control.judging import judge_controllers
    from gimbal_pin.control.tuning import pair_rivals, write_controller
    from gimbal_pin.control.tuning import tune as run
    from gimbal_pin.identification import identify
    from gimbal_pin.identification.model_file import is_model, read_model
    from gimbal_pin.report.elements import join_documents
    from gimbal_pin.report.pages import describe_record

    if len(source) == 1 and is_model(source[0]):
        model = read_model(source[0], load_rig(rig, payload or read_payload(source[0])))
    else:
        model = identify(
            *load_logs(rig, payload, source, map),
            filtering=choose_filter(cutoff, None),
            examined="never",
        ).model
    found = run(
        model, kind=gains.kind, bandwidth_hz=gains.bandwidth_hz, disk_margin=gains.disk_margin, damping=gains.damping,
        integral=gains.integral, delay=gains.delay, dt=gains.dt, robust=gains.robust,
    )  # fmt: skip
    if output is not None:
        write_controller(found, output, output.parent)
    write_figure(found.plot, plot)
    judged = judge_controllers(
        model, pair_rivals(found.stored), rng=0, plants=plants, delay=found.wish.delay
    )
    page = join_documents([describe_record(found), describe_record(judged)])
    present(page.to_text(verbose), {**found.to_dict(), "judged": judged.to_dict()}, json)
