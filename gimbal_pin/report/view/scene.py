"""A recording: the rig in motion, a ghost of the reference, lines of sight and the stage, in one offline HTML page."""

from __future__ import annotations

import base64
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array, Imu, Log
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.report import VIEWS
from gimbal_pin.report.elements import template
from gimbal_pin.report.format import list_shown_joints
from gimbal_pin.report.view import figure, gaze, stage, three
from gimbal_pin.report.view.motion import Frames, Poses, motion, poses
from gimbal_pin.report.view.solids import Solid, find_frame, stand_ins, visuals
from gimbal_pin.rig.rig import Rig

RUN_ROOTS = ("/meshcat", "/meshcat/beside")
"""Where the first and the second run are drawn."""
RIG_ROOT, GHOST_ROOT, MOTION_PATH = "/meshcat/rig", "/meshcat/ghost", "/motion"
APART = 4e-3
"""Distance from the reference, in radii of the rig, from which on the ghost of a link is drawn: a pixel where the rig
fills 540 of them. Nearer, the two would be drawn into each other."""
BEAM = 0.6
"""Length of the line of sight in radii of the rig."""
ROUND = 1e-3
"""How far a drawn circle may be from a true one, in radii of the rig: a quarter of a pixel where it fills 540 of them.
"""
FADE = 2.0
"""Time after which the path of a line of sight has faded away, s of playing."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything the viewer is told.

    Attributes:
        commands: Objects, poses and properties, in order; last the motion, where there is more than one frame.
        events: Sentences about what could not be drawn as the URDF says.
        views: Name → the commands that place the camera there; first what is shown.
        aspect: The width over the height of the picture that the views fill.
        tops: Where the name of each run stands, above its rig, m, (3,).
        corner: Where words stand: the corner of the picture with the least behind them.
    """

    commands: tuple[three.Json, ...]
    events: tuple[str, ...]
    views: Mapping[str, Sequence[three.Json]]
    aspect: float
    tops: tuple[Array, ...]
    corner: str


def scene(
    rig: Rig,
    motion: Frames,
    room: float = 1.0,
    camera: str | None = None,
    beside: Frames | None = None,
    aspect: float = stage.STAGE_ASPECT,
) -> Scene:
    """Return the scene of a rig in motion, looked at from `room` times as far away as holds all of it.

    Args:
        rig: What moves.
        motion: How it moves.
        room: How many times as far away.
        camera: One of `VIEWS`; None: the usual one, with a target over the camera's shoulder.
        beside: How it moves in a second run, shown to the right of the first, or below where both are larger so.
        aspect: The picture's width over its height.
    """
    solids, events, missing = visuals(rig)
    full = {solid.joint for solid in solids}
    bare = (
        {find_frame(rig, link).parentJoint for link in missing} - full
        if full
        else set(range(rig.n + 1))
    )
    if bare:
        solids = (*solids, *(one for one in stand_ins(rig) if one.joint in bare))
        what = ", ".join((rig.base, *rig.links)[joint] for joint in sorted(bare))
        events = (*events, f"nothing to draw of {what}: stand-ins sized from the kinematics")
    runs = [motion] if beside is None else [motion, beside]
    moved = [poses(rig.model, run.q, run.base, run.pivot) for run in runs]
    points = np.vstack([figure.hull(solids, one.world) for one in moved])
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))) / 2, 1e-3)
    solids = tuple(solid.refine(ROUND * size) for solid in solids)
    reach = size * (BEAM if motion.wanted is None else stage.REACH)
    tips = np.vstack([figure.tips(rig, one, reach) for one in moved])
    marks = list[three.Json]()
    around = points[:0]
    if motion.wanted is not None:
        marks, around = stage.marks(rig, solids, moved[0], motion.wanted, size)
    seen = np.vstack([points, tips, around])
    heading = figure.compute_heading(rig, moved[0])
    camera = camera or (stage.USUAL if motion.wanted is None else stage.AIMING)
    top = np.append(
        np.mean([points.min(axis=0), points.max(axis=0)], axis=0)[:2],
        points[:, 2].max() + 0.1 * size,
    )
    named = np.vstack([seen, top])
    shift = stage.place_second(named, heading, camera, aspect) if len(runs) > 1 else np.zeros(3)
    tops = tuple(top + k * shift for k in range(len(runs)))
    seen, points = (np.vstack([p + k * shift for k in range(len(runs))]) for p in (seen, points))
    seen = np.vstack([seen, tops]) if len(runs) > 1 else seen
    views = {
        name: stage.camera(seen, heading, name, room, aspect, motion.wanted is not None)
        for name in VIEWS
    }
    commands = [
        *stage.commands(views[camera], views.values(), np.vstack([points, around]), size),
        *marks,
    ]
    clips: figure.Tracks = {}
    for run, shown, home, place in zip(runs, moved, RUN_ROOTS, (np.zeros(3), shift)):
        drawn, tracks = one_run(rig, solids, run, shown, home, reach, size)
        commands += (
            [three.command_pose(home, three.pose(place)), *drawn] if home != RUN_ROOTS[0] else drawn
        )
        clips |= tracks
    if len(motion.t) > 1:
        commands.append(three.play_tracks(clips, MOTION_PATH))
    placed = {name: stage.look(views[name]) for name in (camera, *views)}
    corner = views[camera].find_free_corner(seen, aspect) if motion.wanted is None else "upper left"
    return Scene(tuple(commands), events, placed, aspect, tops, corner)


def one_run(
    rig: Rig,
    solids: Sequence[Solid],
    motion: Frames,
    shown: Poses,
    home: str,
    reach: float,
    size: float,
) -> tuple[list[three.Json], figure.Tracks]:
    """Return what draws the rig, its line of sight and the ghost of its reference under a path, and what moves them."""
    root = f"{home}/rig"
    other = f"{home}/ghost"
    commands = [
        *figure.build_figure(rig, solids, root),
        *figure.pose_commands(rig, shown, root),
        *figure.beam(rig, root, reach, figure.MEASURED),
        figure.trail(f"{home}/trail", figure.tips(rig, shown, reach), figure.MEASURED),
    ]
    clips = figure.tracks(rig, shown, motion.clock, root)
    if motion.q_ref is not None:
        reference = poses(rig.model, motion.q_ref, motion.base, motion.pivot)
        commands += [
            *figure.ghost(rig, solids, other),
            *figure.pose_commands(rig, reference, other),
            *figure.beam(rig, other, reach, figure.REFERENCE),
            figure.trail(f"{home}/reference", figure.tips(rig, reference, reach), figure.REFERENCE),
        ]
        clips |= figure.tracks(rig, reference, motion.clock, other)
        clips |= figure.apart(
            rig, solids, shown, reference, motion.clock, other, APART * size, reach
        )
    return commands, clips


# -- its page ----------------------------------------------------------------------------------------------------------


def record(rig: Rig, log: Log, *, fps: float = 30, speed: float = 1.0, ghost: bool = True) -> str:
    """Return an HTML page that plays the log on opening, over and over, and needs nothing but a browser.

    Args:
        rig: What moves.
        log: How it moves; `q_ref`, if there, is shown as a ghost.
        fps: Keyframes per second of playing; the browser interpolates between them.
        speed: Seconds of the log per second of playing.
        ghost: Whether the reference is shown.

    Raises:
        UsageError: An argument out of range.
        LogError: The log is empty or lacks a joint of the rig.
    """
    shown = motion(rig, log, fps, speed, ghost)
    return render_scene(rig, log.name, shown, scene(rig, shown))


def onboard(rig: Rig, run: Pointing, seen: gaze.Outlook, wanted: Array) -> str:
    """Return a page that plays a run: the platform turns about the point where the axes meet, the camera stands.

    The ghost is the rig with its joints locked where a level platform's camera looks as wanted; beside the scene
    stands what the cameras see. The stretch of `seen` is played; `wanted`: R_d, (3, 3).
    """
    first, last = np.searchsorted(run.t, [seen.t[0], seen.t[-1]])
    rows = slice(int(first), int(last) + 1)
    sight = Sight(rig)
    locked = np.tile(sight.reached(np.eye(3), wanted, sight.home), (rows.stop - rows.start, 1))
    name = f"held by {seen.held[-1].called} on platform {run.platform}"
    imus = {rig.base: Imu(quat=run.base[rows])}
    log = Log(
        name, rig.joints, run.t[rows], run.q[rows], q_ref=locked, imus=imus, payload=rig.payload
    )
    frames = motion(rig, log, 30.0, 1.0, True)
    moved = replace(frames, pivot=sight.centre, wanted=wanted, ghost_name="joints locked")
    return render_scene(rig, name, moved, scene(rig, moved), gaze.draw_pictures(seen, wanted, 2))


def render_scene(
    rig: Rig,
    name: str,
    shown: Frames,
    drawn: Scene,
    inset: three.Json | None = None,
    live: int | None = None,
    written: bool = True,
    beside: Frames | None = None,
    names: Sequence[str] = (),
    strip: three.Json | None = None,
) -> str:
    """Return the page of a scene, with pictures in its corner where there are any.

    Args:
        rig: What moves.
        name: What stands under its title.
        shown: How it moves.
        drawn: The scene.
        inset: What cameras see, as the page's script draws it, see `gaze.draw_pictures`.
        live: Its number at the server that sends it news, see `view.live`; None: it is a file and hears of none.
        written: Whether title, legend, angles and time stand in the frames of a film.
        beside: A second run that is drawn, too.
        names: What stands above the rig of each run.
        strip: What stands below the frames of a film, see `plot_strip`.
    """
    runs = [shown] if beside is None else [shown, beside]
    recorded = {
        "commands": [packed(command) for command in drawn.commands],
        "start": float(shown.t[0]),
        "end": float(shown.t[-1]),
        "duration": float(shown.clock[-1]),
        "speed": shown.speed,
        "fov": stage.FOV,
        "aspect": drawn.aspect,
        "sky": stage.SKY,
        "views": {
            name: [packed(command) for command in view] for name, view in drawn.views.items()
        },
        "frames": len(shown.t),
        "step": float(shown.clock[1]) if len(shown.t) > 1 else 1.0,
        "fade": FADE,
        "joints": readings(rig, runs),
        "names": [{"name": name, "at": top.tolist()} for name, top in zip(names, drawn.tops)],
        "written": written,
        "corner": drawn.corner,
        "strip": strip,
    }
    return template(
        "gimbal_pin.report.view",
        "page.html.j2",
        title=rig.title,
        subtitle=name,
        legend=legend(runs[-1]),
        views=list(drawn.views),
        ghost=runs[-1].q_ref is not None,
        bundle=bundle(),
        scene=recorded,
        gaze=gaze.script() if inset else "",
        seen=inset,
        live=live,
    )


def packed(command: three.Json) -> str:
    """Return a command as meshcat's viewer takes it, in base 64."""
    import umsgpack

    return base64.b64encode(umsgpack.packb(command)).decode()


def readings(rig: Rig, runs: Sequence[Frames]) -> list[three.Json]:
    """Return each joint's name and what each run reads at every frame: degrees, or millimetres of one that slides."""
    looks = [(" mm", 1e3) if slides else ("°", 180 / np.pi) for slides in rig.slides]
    return [
        {
            "name": name,
            "unit": unit,
            "values": [np.round(scale * run.q[:, k], 1).tolist() for run in runs],
        }
        for k, (name, (unit, scale)) in enumerate(zip(rig.joints, looks, strict=True))
    ]


def plot_strip(rig: Rig, runs: Sequence[Frames]) -> three.Json:
    """Return what stands below a film: each joint's tracking error in each run; without references its position.

    Units as `readings`; `low` and `high` are the ends of the axis, `share` how much of the film's height it takes.
    """
    tracked = all(run.q_ref is not None for run in runs)
    joints = list_shown_joints(rig)
    scales = np.array([joint.scale for joint in joints])
    shown = [
        scales * (run.q if run.q_ref is None or not tracked else run.q_ref - run.q) for run in runs
    ]
    low = float(np.min(shown))
    high = float(np.max(shown))
    units = ", ".join(dict.fromkeys(joint.unit for joint in joints))
    dashes = "" if len(runs) == 1 else "; dashed: second"
    return {
        "title": f"{'tracking error' if tracked else 'position'}, {units}{dashes}",
        "names": [joint.name for joint in joints],
        "colours": [joint.colour for joint in joints],
        "curves": [[column.round(6).tolist() for column in values.T] for values in shown],
        "low": low,
        "high": max(high, low + 1e-6),
        "share": 0.18,
    }


def legend(shown: Frames) -> list[tuple[str, str]]:
    """Return colours, and what they mean."""
    marks = [(figure.MEASURED, "line of sight")]
    if shown.q_ref is not None:
        marks.append((figure.REFERENCE, shown.ghost_name))
    if shown.wanted is not None:
        marks += [(stage.RED, "target"), (stage.LEVEL, "horizon")]
    return [(f"#{three.hex_colour(rgb):06x}", name) for rgb, name in marks]


def bundle() -> str:
    """Return the viewer's script out of the installed meshcat, without importing its server."""
    spec = importlib.util.find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise UsageError("meshcat", "is not installed", "pip install meshcat")
    return (Path(spec.origin).parent / "viewer" / "dist" / "main.min.js").read_text(
        encoding="utf-8"
    )
