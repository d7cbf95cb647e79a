"""What stands still in the world while a platform moves: a target, the horizon; and the platform that moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.figure import frame, list_scene_paths
from gimbal_pin.report.view.motion import Poses
from gimbal_pin.report.view.sight import rays
from gimbal_pin.report.view.solid import Y_TO_Z, Solid
from gimbal_pin.rig.rig import Rig

RED, PALE, LEVEL, DECK = (0.85, 0.20, 0.12), (1.0, 0.99, 0.96), (0.09, 0.13, 0.18), (0.36, 0.41, 0.48)
DISTANCE, REACH = 0.95, 0.93
"""From the camera to the target, and to where the line of sight ends just before it, in radii of the rig."""
BOARD = (0.15, 0.105, 0.06, 0.022)
"""Radii of the target's rings, red and pale by turns, in radii of the rig."""
DECK_SIZE, DECK_HIGH = 0.52, 0.02
"""Radius and thickness of the platform's deck, in radii of the rig."""


def marks(
    rig: Rig, solids: Sequence[Solid], poses: Poses, wanted: Array, size: float
) -> tuple[list[three.Json], Array]:
    """Return the commands that draw target, horizon and platform, and the points that the view must hold, (K, 3).

    `wanted`: the camera's attitude that should be kept, (3, 3); `size`: radius of the rig, m.
    """
    eye = rays(rig, poses)[0].mean(axis=0)
    place = eye + DISTANCE * size * wanted[:, 0]
    corners = place + BOARD[0] * size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    commands = [
        three.draw_object("/meshcat/target", target(place, wanted, size)),
        three.draw_object("/meshcat/horizon", horizon(eye, size)),
        three.draw_object(f"{list_scene_paths(rig, '/meshcat/rig')[0]}/platform", deck(rig, solids, size)),
    ]
    return commands, np.vstack([corners, rim(deck_pose(rig, solids, size), poses, size)])


def rim(pose: Array, poses: Poses, size: float) -> Array:
    """Return points on the deck's rim over some of the frames, m, (K, 3)."""
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    own = pose[:3, 3] + DECK_SIZE * size * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    some = poses.world[:: max(1, len(poses.world) // 40), 0]
    return np.concatenate([own @ one[:3, :3].T + one[:3, 3] for one in some])


def target(place: Array, wanted: Array, size: float) -> three.Json:
    """Return a board of rings that faces the camera."""
    parts, ahead = [], wanted[:, 0]
    for k, radius in enumerate(BOARD):
        pose = three.pose(place - 0.002 * k * size * ahead, np.column_stack([wanted[:, 1], wanted[:, 2], ahead]))
        disc = {"type": "CircleGeometry", "radius": radius * size, "segments": 64}
        parts.append(three.Drawable(disc, pose, three.flat(PALE if k % 2 else RED, side=2)))
    return three.group(parts, "target")


def horizon(eye: Array, size: float) -> three.Json:
    """Return a level ring at the camera's height."""
    ring = {"type": "TorusGeometry", "radius": size, "tube": 0.005 * size, "radialSegments": 8}
    part = three.Drawable({**ring, "tubularSegments": 128}, three.pose(eye), three.flat(LEVEL, 0.75), order=2)
    return three.group([part], "horizon")


def deck(rig: Rig, solids: Sequence[Solid], size: float) -> three.Json:
    """Return the platform as a disc."""
    pose = deck_pose(rig, solids, size) @ Y_TO_Z
    disc = {"type": "CylinderGeometry", "radiusTop": DECK_SIZE * size, "radiusBottom": DECK_SIZE * size}
    disc |= {"height": DECK_HIGH * size, "radialSegments": 72}
    return three.group([three.Drawable(disc, pose, three.glossy((*DECK, 0.55)), receives=True, order=1)], "platform")


def deck_pose(rig: Rig, solids: Sequence[Solid], size: float) -> Array:
    """Return the deck's pose in the base, (4, 4): on the far side of it from what the joints move."""
    own = base_corners(rig, solids)
    low, high = own[:, 2].min(), own[:, 2].max()
    up = float(rig.model.jointPlacements[1].translation[2]) >= (low + high) / 2
    height = (low if up else high) + (-1 if up else 1) * DECK_HIGH / 2 * size
    return three.pose(np.array([0.0, 0.0, height]))


def base_corners(rig: Rig, solids: Sequence[Solid]) -> Array:
    """Return the corners of what is fixed to the base in its frame, m, (K, 3); its origin where it draws nothing."""
    fixed = [(frame(rig, solid.link), solid) for solid in solids]
    own = [
        solid.corners @ at.placement.rotation.T + at.placement.translation for at, solid in fixed if at.parentJoint == 0
    ]
    return np.concatenate(own) if own else np.zeros((1, 3))
