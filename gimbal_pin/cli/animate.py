"""``gimbal-pin animate``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from gimbal_pin.cli.inputs import mounted, play, read_logs, shown_somewhere
from gimbal_pin.cli.options import INTO_FILE, Map, Payload, RigName, Yes, between, optional
from gimbal_pin.cli.paths import Reads, Writes
from gimbal_pin.cli.paths import logs as files_of_logs
from gimbal_pin.cli.present import noted, say
from gimbal_pin.cli.work import affordable
from gimbal_pin.errors import UsageError
from gimbal_pin.report import PRESETS, VIEWS

if TYPE_CHECKING:
    from gimbal_pin.log.log import Array, Log
    from gimbal_pin.rig.rig import Rig

USUAL_SIZE = (960, 540)
if TYPE_CHECKING:
    View = str
    Preset = str
else:
    View, Preset = Literal[tuple(VIEWS)], Literal[tuple(PRESETS)]


def films(output: str | Path, given: Mapping[str, Any]) -> list[Path]:
    """Return the file of each log: the output, numbered where there are several."""
    path, count = Path(output), len(given["logs"])
    numbered = [path.with_name(f"{path.stem}-{k}{path.suffix}") for k in range(1, count + 1)]
    return [path] if count == 1 else numbered


def film_suffixes() -> tuple[str, ...]:
    """Suffixes of animations and pictures."""
    from gimbal_pin.report.view.output import FPS

    return tuple(FPS)


def animate(
    rig: RigName,
    logs: Annotated[
        Positional[tuple[str, ...]], Reads(files_of_logs), arg(metavar="LOG …", help="logs or trajectories")
    ],
    output: Annotated[Path | None, Writes(films, chosen=film_suffixes), INTO_FILE] = None,
    *,
    payload: Payload = None,
    map: Map = (),
    speed: Annotated[
        float, between("--speed", 0.001, 1000), arg(help="seconds of the log per second of playing")
    ] = 1.0,
    fps: Annotated[
        float | None, between("--fps", 0.1, 240), optional(None, "frames per second", "what suits the format")
    ] = None,
    ghost: Annotated[bool, arg(help="show the reference as a ghost")] = True,
    at: Annotated[
        float | None,
        between("--at", -1e10, 1e10, "s"),  # stamps count from a boot, or from 1970
        optional(None, "time of a picture, by the log", "where the reference is farthest"),
    ] = None,
    residual: Annotated[
        Path | None,
        Reads(),
        optional(
            "MODEL", "turn each joint red by what this model's YAML leaves of its torque; all red from a tenth of it on"
        ),
    ] = None,
    beside: Annotated[
        str | None, Reads(files_of_logs), optional("LOG", "a second log, played to the right of the first")
    ] = None,
    camera: Annotated[View | None, arg(help="where it is looked at from")] = None,
    preset: Annotated[Preset | None, arg(help="size and frame rate for a post, a paper or an overview")] = None,
    yes: Yes = False,
    live: Annotated[bool, arg(help="play it in a browser on this machine")] = False,
) -> None:
    """Recorded animation (.html .gif .webp .mp4 .png); HTML needs no display, browser or server."""
    from gimbal_pin.log.io import read_log, split_payload
    from gimbal_pin.report import view
    from gimbal_pin.report.view.output import ENCODERS, FPS

    shown_somewhere(output, live)
    if not logs:
        raise UsageError("LOG", "is missing", "name a log")
    if live and len(logs) > 1:
        raise UsageError("--live", "plays one log", "name one, or -o FILE")
    size, rate, written = PRESETS[preset] if preset is not None else (USUAL_SIZE, None, True)
    chosen = fps or rate
    load = payload or split_payload(logs[0])[1] or mounted(residual)
    loaded, every = read_logs(rig, load, logs, map, need_tau=residual is not None)
    other = None if beside is None else read_log(beside, loaded, map, need_tau=False)
    scale, colours = "", [None if residual is None else warmth(residual, loaded, read) for read in every]
    if residual is not None:
        from gimbal_pin.diagnosis.gain import FULL

        scale = f"residual: red from {100 * FULL:.0f} % of the joint's torque"
    if output is not None:
        suffix = output.suffix.lower()
        frames = sum(read.t[-1] - read.t[0] for read in every) / speed * (chosen or FPS.get(suffix, 1.0))
        pixels = size[0] * size[1] / (USUAL_SIZE[0] * USUAL_SIZE[1])
        drawn = frames * max(pixels, 1.0) if suffix in ENCODERS else 0
        affordable(yes, frame_of_a_joint=frames * loaded.n, rendered_frame=drawn)
        for read, colour, path in zip(every, colours, films(output, {"logs": logs}), strict=True):
            told = view.animate(
                loaded,
                read,
                path,
                speed=speed,
                fps=chosen,
                ghost=ghost,
                colour=colour,
                at=at,
                size=size,
                camera=camera,
                written=written,
                beside=other,
                scale=scale,
            )
            noted(told)
            say(f"{read.t[-1] - read.t[0]:.1f} s → {path}")
    if live:
        play(loaded, every[0])


def warmth(name: Path, rig: Rig, log: Log) -> Array:
    """Return what the model of a YAML leaves of a log's torques, as `view.animate` colours it."""
    from gimbal_pin.diagnosis.gain import heat
    from gimbal_pin.identification.model_file import read_model

    return heat(read_model(name, rig), log)
