"""The camera's line of sight: a beam along +x of its frame, and the path that the beam's end draws."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.figure import frame, list_scene_paths
from gimbal_pin.report.view.motion import Poses
from gimbal_pin.rig.rig import Rig

MEASURED = (0.93, 0.36, 0.06)
REFERENCE = (0.16, 0.45, 0.95)

ALONG_X = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
"""Turns a three.js cylinder, which stands on y, onto +x."""


def beam(rig: Rig, root: str, length: float, colour: tuple[float, ...]) -> list[three.Json]:
    """Return the commands that draw a beam of `length`, m, from the camera's frame along its +x, a dot at its end."""
    fixed = frame(rig, rig.camera_frame)
    path = f"{list_scene_paths(rig, root)[fixed.parentJoint]}/line of sight"
    thin = 0.004 * length
    parts = [
        three.Drawable(rod(length, thin, thin), along(length / 2), three.flat(colour, 0.9), order=4),
        three.Drawable(
            rod(length, 0.09 * length, 2 * thin), along(length / 2), three.flat(colour, 0.10, side=2), order=3
        ),
        three.Drawable(
            {"type": "SphereGeometry", "radius": 4 * thin}, along(length), three.flat(colour, 0.95), order=5
        ),
    ]
    return [
        three.draw_object(path, three.group(parts, f"sight-{root.rpartition('/')[2]}-")),
        three.command_pose(path, fixed.placement.homogeneous),
    ]


def rod(length: float, far: float, near: float) -> three.Json:
    """Return a cylinder or cone with the radii of its ends, m."""
    shape = {"type": "CylinderGeometry", "radiusTop": far, "radiusBottom": near, "height": length}
    return {**shape, "radialSegments": 32, "openEnded": True}


def along(distance: float) -> Array:
    """Return the pose of a rod centred at `distance` along +x."""
    return three.pose(np.array([distance, 0.0, 0.0]), ALONG_X)


def rays(rig: Rig, poses: Poses) -> tuple[Array, Array]:
    """Return origin, m, and direction of the line of sight in the world at each frame, both (F, 3)."""
    fixed = frame(rig, rig.camera_frame)
    pose = poses.world[:, fixed.parentJoint] @ fixed.placement.homogeneous
    return pose[:, :3, 3], pose[:, :3, 0]


def tips(rig: Rig, poses: Poses, length: float) -> Array:
    """Return where the beam ends at each frame, m, (F, 3)."""
    origin, direction = rays(rig, poses)
    return origin + length * direction


def trail(path: str, points: Array, colour: tuple[float, ...]) -> three.Json:
    """Return the command that draws the path of the beam's end; the page lets it fade by the points' opacities."""
    material = three.flat(colour, 0.75, kind="LineBasicMaterial", vertexColors=2)
    path_of_it = three.buffer(points, colours=np.ones((len(points), 4)))
    part = three.Drawable(path_of_it, three.IDENTITY, material, kind="Line", order=3)
    return three.draw_object(path, three.group([part], path.rpartition("/")[2].replace(" ", "-")))


def compute_heading(rig: Rig, poses: Poses) -> float:
    """Return the mean compass direction of the line of sight, rad from the world's x; 0 where it is upright."""
    direction = rays(rig, poses)[1].mean(axis=0)
    return float(np.arctan2(direction[1], direction[0])) if np.hypot(direction[0], direction[1]) > 1e-6 else 0.0
