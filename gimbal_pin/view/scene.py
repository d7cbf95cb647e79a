"""The scene: the rig's figure in motion, a ghost of the reference, the lines of sight, the stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimbal_pin.rig import Rig
from gimbal_pin.view import afar, figure, sight, stage, three
from gimbal_pin.view.motion import Frames, poses
from gimbal_pin.view.stand_in import stand_ins
from gimbal_pin.view.visuals import visuals

RIG, GHOST, MOTION = "/meshcat/rig", "/meshcat/ghost", "/motion"
BEAM = 0.8
"""Length of the line of sight in radii of the rig."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything the viewer is told.

    Attributes:
        commands: Objects, poses and properties, in order.
        animation: The command that plays the motion, or None where there is but one frame.
        events: Sentences about what could not be drawn as the URDF says.
    """

    commands: tuple[three.Json, ...]
    animation: three.Json | None
    events: tuple[str, ...]


def scene(rig: Rig, motion: Frames, room: float = 1.0) -> Scene:
    """Return the scene of a rig in motion, looked at from `room` times as far away as holds all of it."""
    solids, events = visuals(rig)
    if not solids:
        solids = stand_ins(rig)
        events = (*events, f"rig {rig.name} draws no solids: stand-ins sized from its kinematics")
    shown = poses(rig.model, motion.q, motion.base, motion.pivot)
    points = figure.hull(rig, solids, shown.world)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))) / 2, 1e-3)
    reach = size * (BEAM if motion.wanted is None else afar.REACH)
    tips = sight.tips(rig, shown, reach)
    marks, around = ([], points[:0]) if motion.wanted is None else afar.marks(rig, solids, shown, motion.wanted, size)
    side = (stage.AZIMUTH, 0.0) if motion.wanted is None else (stage.BEHIND, stage.ASIDE)
    view = stage.camera(np.vstack([points, tips, around]), sight.heading(rig, shown), room, *side)
    commands = [
        *stage.commands(view, np.vstack([points, around]), size),
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
        clips = figure.merged(clips, figure.tracks(rig, reference, motion.clock, GHOST))
    animation = three.animate(clips, MOTION) if len(motion.t) > 1 else None
    return Scene(tuple(commands), animation, events)
