"""``gimbal-pin studio``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import choose_filter, describe_run, load_logs, load_rig, read_payload
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import say


def list_saved_files(given: object) -> tuple[str, ...]:
    """Return the names of the files that may come to stand in the studio's folder."""
    from gimbal_pin.studio.saving import list_studio_files

    return list_studio_files()


def studio(
    rig: opt.RigName,
    logs: Annotated[Positional[tuple[str, ...]], arg(metavar="LOG …", help_behavior_hint="")] = (),
    output: Annotated[Path, Writes(run=list_saved_files), opt.INTO, arg(metavar="DIR")] = Path(
        "gimbal-pin-studio"
    ),
    *,
    payload: opt.Payload = None,
    model: Annotated[
        Path | None,
        opt.optional(
            "MODEL",
            "a model's YAML, from identify or diagnose",
            "identified from LOG; without LOG the URDF's",
        ),
    ] = None,
    map: opt.Map = (),
    cutoff: opt.Cutoff = None,
    browser: Annotated[bool, arg(help="open a window of the browser on the page")] = True,
    check: Annotated[
        bool, arg(help="read and tune once, say what the page would show, and end")
    ] = False,
) -> None:
    """Tune by hand on a local page: sliders, loops, residual, camera swap; needs gimbal-pin[studio].

    Args:
        logs: logs: their residual is shown, and without --model a model is identified from them
    """
    about = describe_run("studio", locals())
    from gimbal_pin.identification.model_file import read_model
    from gimbal_pin.studio import Desk, StudioSource, StudioState, tune_state
    from gimbal_pin.studio.server import check_nicegui, serve_desk

    check_nicegui()
    load = payload or read_payload(model)
    loaded, read = load_logs(rig, load, logs, map) if logs else (load_rig(rig, load), [])
    known = None if model is None else read_model(model, loaded)
    desk = Desk(
        StudioSource(loaded, tuple(read), known, choose_filter(cutoff, None)), output, about
    )
    subject = desk.find_subject(StudioState())
    if check:
        say(str(tune_state(subject, StudioState())))
        return
    from gimbal_pin.report.view.live import open_window

    def announce(url: str) -> None:
        say(f"studio at {url} (Ctrl-C ends it)")
        if browser:
            open_window(url)

    serve_desk(desk, announce)
