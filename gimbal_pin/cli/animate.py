"""``gimbal-pin animate``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import read_logs
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import check_shown, play, say, tell
from gimbal_pin.errors import UsageError
from gimbal_pin.report import PRESETS, VIEWS

USUAL_SIZE = (960, 540)
if TYPE_CHECKING:
    View = str
    Preset = str
else:
    View = Literal[tuple(VIEWS)]
    Preset = Literal[tuple(PRESETS)]


def list_films(output: str | Path, given: Mapping[str, Any]) -> list[Path]:
    """Return the file of each log: the output, numbered where there are several."""
    path = Path(output)
    count = len(given["logs"])
    return [
        path if count == 1 else path.with_name(f"{path.stem}-{k}{path.suffix}")
        for k in range(1, count + 1)
    ]


def list_film_suffixes() -> tuple[str, ...]:
    """Return the suffixes of animations and pictures."""
    from gimbal_pin.report.view.output import FRAME_RATES

    return tuple(FRAME_RATES)


def animate(
    rig: opt.RigName,
    logs: Annotated[
        Positional[tuple[str, ...]], arg(metavar="LOG …", help_behavior_hint="(at least one)")
    ],
    output: Annotated[opt.File, Writes(list_film_suffixes, list_films), opt.TO] = None,
    *,
    payload: opt.Payload = None,
    map: opt.Map = (),
    speed: Annotated[float, opt.between("--speed", 0.001, 1000)] = 1.0,
    fps: Annotated[opt.Maybe[float], opt.between("--fps", 0.1, 240)] = None,
    ghost: bool = True,
    at: Annotated[
        opt.Maybe[float], opt.between("--at", -1e10, 1e10, "s")
    ] = None,  # from a boot, or from 1970
    beside: Annotated[opt.Maybe[str], arg(metavar="LOG")] = None,
    camera: opt.Maybe[View] = None,
    preset: opt.Maybe[Preset] = None,
    live: opt.LiveView = False,
) -> None:
    """Recorded animation (.html .gif .webp .mp4 .png); HTML needs no display, browser or server.

    Args:
        logs: logs or trajectories
        speed: seconds of the log per second of playing
        fps: frames per second (default: what suits the format)
        ghost: show the reference as a ghost
        at: time of a picture, by the log (default: where the reference is farthest)
        beside: a second log, played beside the first or below it; the ghosts of both show their errors magnified
        camera: where it is looked at from
        preset: size and frame rate for a post, a paper or an overview
    """
    from gimbal_pin.log.io import read_log, split_payload
    from gimbal_pin.report import view

    check_shown(output, live)
    if not logs:
        raise UsageError("LOG", "is missing", "name a log")
    if live and len(logs) > 1:
        raise UsageError("--live", "plays one log", "name one, or -o FILE")
    size, rate, written = PRESETS[preset] if preset is not None else (USUAL_SIZE, None, True)
    load = payload or split_payload(logs[0])[1]
    loaded, every = read_logs(rig, load, logs, map, need_tau=False)
    other = None if beside is None else read_log(beside, loaded, map, need_tau=False)
    if output is not None:
        suffix = output.suffix.lower()
        fps = fps or rate
        for read, path in zip(every, list_films(output, {"logs": logs}), strict=True):
            started = perf_counter()
            shown = view.animate(
                read, loaded, path, speed=speed, fps=fps, ghost=ghost, at=at, size=size, camera=camera, written=written,
                beside=other,
            )  # fmt: skip
            tell(shown.events)
            drawn = "" if suffix == ".html" else f"{size[0]} × {size[1]}, "
            many = "" if suffix == ".png" else f"{shown.frames} frames, "
            took = perf_counter() - started
            say(f"{many}{drawn}{path.stat().st_size / 1e6:.1f} MB, {took:.1f} s → {path}")
    if live:
        play(loaded, every[0])
