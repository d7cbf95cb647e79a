"""A recording: one offline HTML file that plays the rig moving."""

from __future__ import annotations

import base64
import importlib.util
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Log
from gimbal_pin.report.html import template
from gimbal_pin.report.view import afar, gaze, sight, stage, three
from gimbal_pin.report.view.motion import Frames, motion
from gimbal_pin.report.view.scene import Scene, scene
from gimbal_pin.rig.rig import Rig


def record(
    rig: Rig, log: Log, *, fps: float = 30, speed: float = 1.0, ghost: bool = True, colour: Array | None = None
) -> str:
    """Return an HTML page that plays the log on opening, over and over, and needs nothing but a browser.

    Args:
        rig: What moves.
        log: How it moves; `q_ref`, if there, is shown as a ghost.
        fps: Keyframes per second of playing; the browser interpolates between them.
        speed: Seconds of the log per second of playing.
        ghost: Whether the reference is shown.
        colour: One value per sample and joint, 0..1, (N, n): turns the link that the joint moves from its own colour
            (0) to red (1), for instance by the residual.

    Raises:
        UsageError: An argument out of range.
        LogError: The log is empty or lacks a joint of the rig.
    """
    shown = motion(rig, log, fps, speed, ghost, colour)
    return render_scene(rig, log.name, shown, scene(rig, shown))


FADE = 2.0
"""Time after which the path of a line of sight has faded away, s of playing."""
Inset = tuple[Sequence[gaze.Picture], three.Json]
"""What cameras see, to be shown in a corner, and the numbers that it is drawn from."""


def render_scene(
    rig: Rig,
    name: str,
    shown: Frames,
    drawn: Scene,
    inset: Inset | None = None,
    live: int | None = None,
    written: bool = True,
    beside: Frames | None = None,
) -> str:
    """Return the page of a scene, with pictures in its corner where there are any.

    Args:
        rig: What moves.
        name: What stands under its title.
        shown: How it moves.
        drawn: The scene.
        inset: The pictures.
        live: Its number at the server that sends it news, see `view.server`; None: it is a file and hears of none.
        written: Whether title, legend, angles and time stand in the frames of a film.
        beside: A second run that is drawn, too.
    """
    pictures, seen = ((), None) if inset is None else inset
    return template(
        "gimbal_pin.report.view",
        "page.html.j2",
        title=rig.title,
        subtitle=name,
        legend=legend(shown),
        ramp="" if shown.colour is None else shown.scale,
        views=list(drawn.views),
        ghost=shown.q_ref is not None,
        bundle=bundle(),
        scene=list_scene_data(rig, shown, drawn, written, beside),
        gaze=gaze.script() if inset else "",
        pictures=pictures,
        seen=seen,
        live=live,
    )


def packed(command: three.Json) -> str:
    """Return a command as meshcat's viewer takes it, in base 64."""
    import umsgpack

    return base64.b64encode(umsgpack.packb(command)).decode()


def readings(rig: Rig, runs: Sequence[Frames]) -> list[three.Json]:
    """Return each joint's name and what each run reads at every frame: degrees, or millimetres of one that slides."""
    found = []
    for k, (name, joint) in enumerate(zip(rig.joints, list(rig.model.joints)[1:], strict=True)):
        slides = joint.shortname().startswith("JointModelP")  # prismatic
        values = [np.round(run.q[:, k] * (1e3 if slides else 180 / np.pi), 1).tolist() for run in runs]
        found.append({"name": name, "unit": " mm" if slides else "°", "values": values})
    return found


def list_scene_data(rig: Rig, shown: Frames, drawn: Scene, written: bool, beside: Frames | None) -> three.Json:
    """Return the commands and the times that the page's script plays."""
    commands = drawn.commands if drawn.animation is None else (*drawn.commands, drawn.animation)
    return {
        "commands": [packed(command) for command in commands],
        "start": float(shown.t[0]),
        "end": float(shown.t[-1]),
        "duration": float(shown.clock[-1]),
        "speed": shown.speed,
        "fov": stage.FOV,
        "aspect": stage.STAGE_ASPECT,
        "sky": stage.SKY,
        "views": {name: [packed(command) for command in view] for name, view in drawn.views.items()},
        "frames": len(shown.t),
        "step": float(shown.clock[1]) if len(shown.t) > 1 else 1.0,
        "fade": FADE,
        "joints": readings(rig, [shown] if beside is None else [shown, beside]),
        "written": written,
    }


def legend(shown: Frames) -> list[tuple[str, str]]:
    """Return colours, and what they mean."""
    marks = [(sight.MEASURED, "line of sight")]
    if shown.q_ref is not None:
        marks.append((sight.REFERENCE, "reference" if shown.wanted is None else "joints locked"))
    if shown.wanted is not None:
        marks += [(afar.RED, "target"), (afar.LEVEL, "horizon")]
    return [(f"#{three.hex_colour(rgb):06x}", name) for rgb, name in marks]


def bundle() -> str:
    """Return the viewer's script out of the installed meshcat, without importing its server."""
    spec = importlib.util.find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise UsageError("meshcat", "is not installed", "pip install meshcat")
    return (Path(spec.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
