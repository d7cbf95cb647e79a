"""The rig in motion as a file: HTML, a picture, or a video."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.log.io.files import atomic_write, open_replacement
from gimbal_pin.log.log import Log
from gimbal_pin.report import VIEWS
from gimbal_pin.report.view.browser import take_pictures
from gimbal_pin.report.view.motion import Frames, frame_times, magnify, motion
from gimbal_pin.report.view.scene import plot_strip, render_scene, scene
from gimbal_pin.report.view.stage import STAGE_ASPECT
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig

ENCODERS: Mapping[str, str] = {
    ".gif": "-filter_complex split[a][b];[a]palettegen=stats_mode=full[p];[b][p]paletteuse=dither=bayer:bayer_scale=4 "
    "-loop 0 -f gif",
    ".webp": "-c:v libwebp_anim -quality 75 -compression_level 1 -loop 0 -f webp",
    ".mp4": "-vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -c:v libx264 -pix_fmt yuv420p -crf 18 -preset veryfast "
    "-movflags +faststart -f mp4",
}
"""Suffix → what ffmpeg is told."""

FRAME_RATES: Mapping[str, float] = {
    ".html": 30.0,
    ".gif": 20.0,
    ".webp": 25.0,
    ".mp4": 30.0,
    ".png": 30.0,
}
"""Suffix → frames per second; a GIF counts hundredths of a second, so that 20 is exact and 30 is not."""


@dataclass(frozen=True)
class Animation:
    """A recorded scene, which a notebook shows.

    Attributes:
        name: What moves.
        page: The page that plays it, as `record` returns it.
        events: A sentence for each thing that could not be drawn as the URDF says.
        frames: How many instants it shows.
    """

    name: str
    page: str
    events: tuple[str, ...] = ()
    frames: int = 1

    __repr__ = brief

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, which reaches nothing outside of it."""
        look = "width: 100%; aspect-ratio: 16 / 9; border: 0; border-radius: 10px"
        frame = '<iframe title="{}" srcdoc="{}" style="{}" sandbox="allow-scripts" allow="fullscreen"></iframe>'
        return str(Markup(frame).format(self.name, self.page, look))

    def write(self, path: str | Path) -> None:
        """Write the page."""
        atomic_write(path, self.page)


@check_arguments
def animate(
    log: Log,
    rig: Rig,
    path: str | Path | None = None,
    *,
    fps: float | None = None,
    speed: float = 1.0,
    ghost: bool = True,
    size: tuple[int, int] = (960, 540),
    at: float | None = None,
    camera: str | None = None,
    written: bool = True,
    beside: Log | None = None,
) -> Animation:
    """Return what `record` shows, and write it in the format of the path's suffix: .html, .png, .gif, .webp or .mp4.

    All but .html need Chromium and the extra ``gimbal-pin[video]``; frames are rendered one by one at exact instants,
    whatever the machine's speed. The file is written whole or not at all.

    Args:
        log: How it moves.
        rig: What moves.
        path: Where to; None: nowhere, a notebook shows what is returned.
        fps: Frames per second; None: 30, of a GIF 20, of a WebP 25.
        speed: As for `record`.
        ghost: As for `record`.
        size: Width and height, pixels; HTML fills its window.
        at: Time of a picture, s of the log; None: where the rig is farthest from its reference, or from its mean pose.
        camera: Where it is looked at from, a name of `view.stage.VIEWS`; None: three-quarter.
        written: Whether title, time, legend and joint angles stand in pictures and films, and below films a plot.
        beside: A second log of the rig, played beside or below the first, whichever shows both larger, for as long as
            both last; the ghosts of both show their errors magnified.

    Raises:
        UsageError: An argument, the suffix or the path cannot be used, or Chromium is missing.
        LogError: The log is empty or lacks a joint of the rig.
    """
    suffix = ".html" if path is None else Path(path).suffix.lower()
    if suffix not in FRAME_RATES:
        raise UsageError(
            str(path), f"has the suffix '{suffix}'", f"use one of {', '.join(FRAME_RATES)}"
        )
    if len(log) == 1 and suffix != ".png":
        raise LogError(log.name, "has one sample, which does not move", "write a picture: .png")
    if not all(16 <= side <= 4096 for side in size):
        raise UsageError("size", f"is {size[0]} × {size[1]} pixels", "give 16 to 4096 each way")
    if at is not None and not log.t[0] <= at <= log.t[-1]:
        raise UsageError(
            "at", f"is {at} s", f"log {log.name} runs from {log.t[0]:.6g} to {log.t[-1]:.6g} s"
        )
    rate = FRAME_RATES[suffix] if fps is None else fps
    if camera is not None and camera not in VIEWS:
        raise UsageError("camera", f"is '{camera}'", f"choose one of {', '.join(VIEWS)}")
    shown = motion(rig, log, rate, speed, ghost)
    other = None
    name = Path(log.name).name
    names = tuple[str, ...]()
    if beside is not None:
        other = motion(rig, beside, rate, speed, ghost)
        both = min(len(shown.t), len(other.t))
        shown = shown.first(both)
        other = other.first(both)
        names = (
            (log.name, beside.name)
            if Path(beside.name).name == name
            else (name, Path(beside.name).name)
        )
        name = " | ".join(names)
    strip = (
        plot_strip(rig, [shown, other] if other else [shown])
        if written and suffix in ENCODERS
        else None
    )
    if other is not None and ghost:
        shown, other = magnify(rig, shown, other)
    height = size[1] * (1 - strip["share"] if strip else 1)
    wide = size[0] / height if suffix in (".png", *ENCODERS) else STAGE_ASPECT
    drawn = scene(rig, shown, camera=camera, beside=other, aspect=wide)
    recorded = render_scene(
        rig, name, shown, drawn, written=written, beside=other, names=names, strip=strip
    )
    shot = Animation(name, recorded, drawn.events, len(shown.t))
    if path is None:
        return shot
    if suffix == ".html":
        shot.write(path)
    elif suffix == ".png":
        away = (log.q - (log.q.mean(axis=0) if log.q_ref is None else log.q_ref))[
            :, log.columns(rig)
        ]
        farthest = log.t[int(np.argmax(np.sum(np.nan_to_num(away) ** 2, axis=1)))]
        found: list[bytes] = []
        instant = ((farthest if at is None else at) - log.t[0]) / speed
        take_pictures(recorded, [float(instant)], size, found.append)
        atomic_write(path, found[0])
    else:
        film(recorded, shown, rate, size, Path(path))
    return shot


def film(recorded: str, shown: Frames, fps: float, size: tuple[int, int], path: Path) -> None:
    """Render every frame of a recorded page and encode them with ffmpeg."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise UsageError(
            "video", "imageio-ffmpeg is not installed", "pip install 'gimbal-pin[video]'"
        ) from error
    times = frame_times(shown.clock, 1 / fps).tolist()
    source = ("-f", "image2pipe", "-framerate", f"{fps:g}", "-c:v", "png", "-i", "-")
    with open_replacement(path) as temporary:
        command = (imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *source)
        encode = (*command, *ENCODERS[path.suffix.lower()].split(), str(temporary))
        with (
            subprocess.Popen(encode, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process,
            ExitStack() as cut_off,
        ):
            assert process.stdin is not None and process.stderr is not None  # both were asked for
            cut_off.callback(process.kill)
            with suppress(BrokenPipeError):  # ffmpeg ended early: its own words follow
                take_pictures(recorded, times, size, process.stdin.write)
            cut_off.pop_all()
            reason = process.communicate()[1].decode(errors="replace").strip()
        if process.returncode:
            raise UsageError(
                str(path),
                f"could not be encoded ({reason or 'ffmpeg gave no reason'})",
                "write .html",
            )
