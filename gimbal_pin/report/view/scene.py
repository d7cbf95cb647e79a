"""The scene: the rig's figure in motion, a ghost of the reference, the lines of sight, the stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.report import VIEWS
from gimbal_pin.report.view import afar, figure, sight, stage, three
from gimbal_pin.report.view.motion import Frames, Poses, poses
from gimbal_pin.report.view.solid import Solid, refine_solid
from gimbal_pin.report.view.stand_in import stand_ins
from gimbal_pin.report.view.visuals import visuals
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


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything the viewer is told.

    Attributes:
        commands: Objects, poses and properties, in order.
        animation: The command that plays the motion, or None where there is but one frame.
        events: Sentences about what could not be drawn as the URDF says.
        views: Name → the commands that place the camera there.
    """

    commands: tuple[three.Json, ...]
    animation: three.Json | None
    events: tuple[str, ...]
    views: Mapping[str, Sequence[three.Json]]


def scene(
    rig: Rig, motion: Frames, room: float = 1.0, camera: str | None = None, beside: Frames | None = None
) -> Scene:
    """Return the scene of a rig in motion, looked at from `room` times as far away as holds all of it.

    Args:
        rig: What moves.
        motion: How it moves.
        room: How many times as far away.
        camera: One of `VIEWS`; None: the usual one, with a target over the camera's shoulder.
        beside: How it moves in a second run, which is shown to the right of the first; None: there is none.
    """
    solids, events, missing = visuals(rig)
    full = {figure.frame(rig, solid.link).parentJoint for solid in solids}
    bare = {figure.frame(rig, link).parentJoint for link in missing} - full if full else set(range(rig.n + 1))
    if bare:
        solids = (*solids, *(one for one in stand_ins(rig) if figure.frame(rig, one.link).parentJoint in bare))
        what = ", ".join((rig.base, *rig.links)[joint] for joint in sorted(bare))
        events = (*events, f"nothing to draw of {what}: stand-ins sized from the kinematics")
    runs = [motion] if beside is None else [motion, beside]
    moved = [poses(rig.model, run.q, run.base, run.pivot) for run in runs]
    points = np.vstack([figure.hull(rig, solids, one.world) for one in moved])
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))) / 2, 1e-3)
    solids = tuple(refine_solid(solid, ROUND * size) for solid in solids)
    reach = size * (BEAM if motion.wanted is None else afar.REACH)
    tips = np.vstack([sight.tips(rig, one, reach) for one in moved])
    marks, around = (
        ([], points[:0]) if motion.wanted is None else afar.marks(rig, solids, moved[0], motion.wanted, size)
    )
    seen, heading = np.vstack([points, tips, around]), sight.compute_heading(rig, moved[0])
    if camera is None:
        camera = stage.USUAL if motion.wanted is None else stage.AIMING
    shift = stage.to_the_right(seen, heading, camera) if len(runs) > 1 else np.zeros(3)
    seen, points = (np.vstack([p + k * shift for k in range(len(runs))]) for p in (seen, points))
    views = {name: stage.camera(seen, heading, name, room) for name in VIEWS}
    commands = [*stage.commands(views[camera], np.vstack([points, around]), size), *marks]
    clips: figure.Tracks = {}
    for run, shown, home, place in zip(runs, moved, RUN_ROOTS, (np.zeros(3), shift)):
        drawn, tracks = one_run(rig, solids, run, shown, home, reach, size)
        commands += [three.command_pose(home, three.pose(place)), *drawn] if home != RUN_ROOTS[0] else drawn
        clips |= tracks
    animation = three.play_tracks(clips, MOTION_PATH) if len(motion.t) > 1 else None
    placed = {name: stage.look(view) for name, view in views.items()}
    first = {camera: placed.pop(camera)}  # the list of views begins with what is shown
    return Scene(tuple(commands), animation, events, first | placed)


def one_run(
    rig: Rig, solids: Sequence[Solid], motion: Frames, shown: Poses, home: str, reach: float, size: float
) -> tuple[list[three.Json], figure.Tracks]:
    """Return what draws the rig, its line of sight and the ghost of its reference under a path, and what moves them."""
    root, other = f"{home}/rig", f"{home}/ghost"
    commands = [
        *figure.build_figure(rig, solids, root),
        *figure.pose_commands(rig, shown, root),
        *sight.beam(rig, root, reach, sight.MEASURED),
        sight.trail(f"{home}/trail", sight.tips(rig, shown, reach), sight.MEASURED),
    ]
    clips = figure.merged(
        figure.tracks(rig, shown, motion.clock, root), figure.colour_tracks(rig, solids, motion, root)
    )
    if motion.q_ref is not None:
        reference = poses(rig.model, motion.q_ref, motion.base, motion.pivot)
        commands += [
            *figure.ghost(rig, solids, other),
            *figure.pose_commands(rig, reference, other),
            *sight.beam(rig, other, reach, sight.REFERENCE),
            sight.trail(f"{home}/reference", sight.tips(rig, reference, reach), sight.REFERENCE),
        ]
        apart = figure.apart(rig, solids, shown, reference, motion.clock, other, APART * size)
        clips = figure.merged(clips, figure.tracks(rig, reference, motion.clock, other), apart)
    return commands, clips
