"""``gimbal-pin animate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from gimbal_pin.cli.inputs import load_rig, mounted, play, shown_somewhere
from gimbal_pin.cli.options import Map, MaybeOutput, Payload, RigName, Yes, between, optional
from gimbal_pin.cli.paths import Reads, logs
from gimbal_pin.cli.present import noted, say
from gimbal_pin.cli.work import affordable

if TYPE_CHECKING:
    from gimbal_pin.log import Array, Log
    from gimbal_pin.rig import Rig


def animate(
    rig: RigName,
    log: Annotated[Positional[str], Reads(logs), arg(metavar="LOG", help="a log or trajectory")],
    output: MaybeOutput = None,
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
    yes: Yes = False,
    live: Annotated[bool, arg(help="play it in a browser on this machine")] = False,
) -> None:
    """Recorded animation (.html .gif .webp .mp4 .png); HTML needs no display, browser or server."""
    from gimbal_pin import view
    from gimbal_pin.io import read_log, split_payload
    from gimbal_pin.view.output import ENCODERS, FPS

    shown_somewhere(output, live)
    loaded = load_rig(rig, payload or split_payload(log)[1] or mounted(residual))
    read = read_log(log, loaded, map, need_tau=residual is not None)
    colour = None if residual is None else warmth(residual, loaded, read)
    if output is not None:
        frames = (read.t[-1] - read.t[0]) / speed * (fps or FPS.get(output.suffix.lower(), 1.0))
        drawn = frames if output.suffix.lower() in ENCODERS else 0
        affordable(yes, frame_of_a_joint=frames * loaded.n, rendered_frame=drawn)
        noted(view.save(loaded, read, output, speed=speed, fps=fps, ghost=ghost, colour=colour, at=at))
        say(f"{read.t[-1] - read.t[0]:.1f} s → {output}")
    if live:
        play(loaded, read)


def warmth(name: Path, rig: Rig, log: Log) -> Array:
    """Return what the model of a YAML leaves of a log's torques, as `view.save` colours it."""
    from gimbal_pin.diagnosis.heat import heat
    from gimbal_pin.io.model import read_model

    return heat(read_model(name, rig), log)
