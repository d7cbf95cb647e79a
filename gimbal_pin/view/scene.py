"""The scene: the rig's figure in motion, a ghost of the reference, the lines of sight, the stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.rig import Rig
from gimbal_pin.view import afar, figure, sight, stage, three
from gimbal_pin.view.motion import Frames, poses
from gimbal_pin.view.solid import rounded
from gimbal_pin.view.stand_in import stand_ins
from gimbal_pin.view.visuals import visuals

RIG, GHOST, MOTION = "/meshcat/rig", "/meshcat/ghost", "/motion"
APART = 4e-3
"""Distance from the reference, in radii of the rig, from which on the ghost of a link is drawn: a pixel where the rig
fills 540 of them. Nearer, the two would be drawn into each other."""
BEAM = 0.8
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


def scene(rig: Rig, motion: Frames, room: float = 1.0, camera: str | None = None) -> Scene:
    """Return the scene of a rig in motion, looked at from `room` times as far away as holds all of it.

    `camera`: one of `stage.VIEWS`; None: the usual one, with a target over the camera's shoulder.
    """
    solids, events = visuals(rig)
    if not solids:
        solids = stand_ins(rig)
        events = (*events, f"rig {rig.name} draws no solids: stand-ins sized from its kinematics")
    shown = poses(rig.model, motion.q, motion.base, motion.pivot)
    points = figure.hull(rig, solids, shown.world)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))) / 2, 1e-3)
    solids = tuple(rounded(solid, ROUND * size) for solid in solids)
    reach = size * (BEAM if motion.wanted is None else afar.REACH)
    tips = sight.tips(rig, shown, reach)
    marks, around = ([], points[:0]) if motion.wanted is None else afar.marks(rig, solids, shown, motion.wanted, size)
    seen, heading = np.vstack([points, tips, around]), sight.heading(rig, shown)
    views = {name: stage.camera(seen, heading, name, room) for name in stage.VIEWS}
    if camera is None:
        camera = stage.USUAL if motion.wanted is None else stage.AIMING
    commands = [
        *stage.commands(views[camera], np.vstack([points, around]), size),
        *figure.figure(rig, solids, RIG),
        *figure.pose_commands(rig, shown, RIG),
        *sight.beam(rig, RIG, reach, sight.MEASURED),
        sight.trail("/meshcat/trail", tips, sight.MEASURED),
        *marks,
    ]
    clips = figure.merged(figure.tracks(rig, shown, motion.clock, RIG), figure.colour_tracks(rig, solids, motion, RIG))
    if motion.q_ref is not None:
        reference = poses(rig.model, motion.q_ref, motion.base, motion.pivot)
        commands += [
            *figure.ghost(rig, solids, GHOST),
            *figure.pose_commands(rig, reference, GHOST),
            *sight.beam(rig, GHOST, reach, sight.REFERENCE),
            sight.trail("/meshcat/reference", sight.tips(rig, reference, reach), sight.REFERENCE),
        ]
        apart = figure.apart(rig, solids, shown, reference, motion.clock, GHOST, APART * size)
        clips = figure.merged(clips, figure.tracks(rig, reference, motion.clock, GHOST), apart)
    animation = three.animate(clips, MOTION) if len(motion.t) > 1 else None
    placed = {name: stage.look(view) for name, view in views.items()}
    first = {camera: placed.pop(camera)}  # the list of views begins with what is shown
    return Scene(tuple(commands), animation, events, first | placed)
