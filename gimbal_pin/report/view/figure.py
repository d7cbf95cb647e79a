"""The rig's figure: solids and line of sight in a tree of groups, one per moved link, which the joints' poses move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.motion import Poses
from gimbal_pin.report.view.solids import Solid, find_frame
from gimbal_pin.rig.rig import Rig

"""Colour of a link whose `colour` is 1."""
MEASURED = (0.93, 0.36, 0.06)
REFERENCE = (0.16, 0.45, 0.95)
"""Colours of the line of sight, and of that of the reference and of its ghost."""
ALONG_X = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
"""Turns a three.js cylinder, which stands on y, onto +x."""

Tracks = dict[str, list[three.Json]]
"""Scene path → what is animated there."""


def list_scene_paths(rig: Rig, root: str) -> tuple[str, ...]:
    """Return the scene path of each joint's group; index 0 is the base's. Groups nest as the joints do."""
    found = [root]
    for joint, link in enumerate(rig.links, start=1):
        found.append(f"{found[rig.model.parents[joint]]}/{link.replace('/', ':')}")
    return tuple(found)


def moved_by(solids: Sequence[Solid], joint: int) -> list[Solid]:
    """Return the solids that a joint moves; 0: none does."""
    return [solid for solid in solids if solid.joint == joint]


def build_figure(rig: Rig, solids: Sequence[Solid], root: str) -> list[three.Json]:
    """Return the commands that draw the rig."""
    commands = []
    for joint, path in enumerate(list_scene_paths(rig, root)):
        parts = [
            three.Drawable(
                x.shape.geometry,
                x.placement,
                three.glossy(x.rgba, **facets(x)),
                casts=x.rgba[3] >= 1,
                receives=True,
            )
            for x in moved_by(solids, joint)
        ]
        commands += [three.draw_group(f"{path}/solids", parts, f"j{joint}p")] if parts else []
    return commands


def ghost(rig: Rig, solids: Sequence[Solid], root: str) -> list[three.Json]:
    """Return the commands that draw a translucent copy of what moves.

    A first pass writes depth alone, so that the second one tints each pixel once, however many parts lie behind it.
    Both are pushed back a little: where rig and reference agree the ghost is not seen.
    """
    behind: three.Json = {
        "polygonOffset": True,
        "polygonOffsetFactor": 1.0,
        "polygonOffsetUnits": 8.0,
    }
    depth = three.flat(REFERENCE, 0.0, colorWrite=False, **behind) | {"depthWrite": True}
    tint = three.flat(REFERENCE, 0.32, kind="MeshLambertMaterial", **behind)
    commands = []
    for joint, path in enumerate(list_scene_paths(rig, root)[1:], start=1):
        parts = [
            three.Drawable(
                solid.shape.geometry, solid.placement, material | facets(solid), order=order
            )
            for order, material in ((1, depth), (2, tint))
            for solid in moved_by(solids, joint)
        ]
        commands += [three.draw_group(f"{path}/solids", parts, f"ghostj{joint}p")] if parts else []
    return commands


def facets(solid: Solid) -> three.Json:
    """Return what a mesh's material needs besides: its triangles may face either way and come without normals."""
    return {"type": "MeshPhongMaterial", "flatShading": True, "side": 2} if solid.facets else {}


def pose_commands(rig: Rig, poses: Poses, root: str) -> list[three.Json]:
    """Return the commands that put the groups where the first frame has them."""
    return [
        three.command_pose(*pair)
        for pair in zip(list_scene_paths(rig, root), poses.local[0], strict=True)
    ]


def tracks(rig: Rig, poses: Poses, clock: Array, root: str) -> Tracks:
    """Return what moves the groups: attitudes of all joints, positions where one slides, the base where it turns."""
    found: Tracks = {}
    for joint, path in enumerate(list_scene_paths(rig, root)):
        own = poses.local[:, joint]
        if joint or np.ptp(own, axis=0).max() > 0:
            attitude = Rotation.from_matrix(own[:, :3, :3]).as_quat()
            found[path] = [three.animate_property(".quaternion", "quaternion", clock, attitude)]
        if np.ptp(own[:, :3, 3], axis=0).max() > 0:
            found[path].append(three.animate_property(".position", "vector3", clock, own[:, :3, 3]))
    return found


def apart(
    rig: Rig,
    solids: Sequence[Solid],
    poses: Poses,
    reference: Poses,
    clock: Array,
    root: str,
    least: float,
    reach: float,
) -> Tracks:
    """Return what shows each link's solids only while some of them may be `least`, m, or more from the reference.

    The same of the line of sight and its end, `reach`, m, away.
    No point within r of a joint's frame is further away than ``|Δp| + ‖ΔR‖ r``, ‖ΔR‖ the spectral norm.
    """
    away = np.linalg.norm(tips(rig, poses, reach) - tips(rig, reference, reach), axis=1)
    paths = list_scene_paths(rig, root)
    beam_path = f"{paths[find_frame(rig, rig.camera_frame).parentJoint]}/line of sight"
    found: Tracks = {beam_path: [three.animate_property(".visible", "bool", clock, away >= least)]}
    for joint, path in enumerate(paths[1:], start=1):
        if corners := [solid.corners for solid in moved_by(solids, joint)]:
            change = poses.world[:, joint] - reference.world[:, joint]
            radius = np.linalg.norm(np.concatenate(corners), axis=1).max()
            turned = np.linalg.norm(change[:, :3, :3], axis=(1, 2)) / np.sqrt(
                2
            )  # of a difference of two rotations
            shown = np.linalg.norm(change[:, :3, 3], axis=1) + turned * radius >= least
            found[f"{path}/solids"] = [three.animate_property(".visible", "bool", clock, shown)]
    return found


def hull(solids: Sequence[Solid], world: Array) -> Array:
    """Return the corners of all solids' boxes over some of the frames, in the world, m, (K, 3)."""
    some = np.unique(np.linspace(0, len(world) - 1, 40).astype(int))
    poses = [(solid.corners, world[some, solid.joint]) for solid in solids]
    points = [
        (at[:, None, :3, :3] @ corners[:, :, None])[..., 0] + at[:, None, :3, 3]
        for corners, at in poses
    ]
    return np.concatenate([block.reshape(-1, 3) for block in points])


# -- the line of sight -------------------------------------------------------------------------------------------------


def beam(rig: Rig, root: str, length: float, colour: tuple[float, ...]) -> list[three.Json]:
    """Return the commands that draw a beam of `length`, m, from the camera's frame along its +x, a dot at its end."""
    fixed = find_frame(rig, rig.camera_frame)
    path = f"{list_scene_paths(rig, root)[fixed.parentJoint]}/line of sight"
    thin = 0.004 * length
    (middle, end) = (three.pose(np.array([x, 0.0, 0.0]), ALONG_X) for x in (length / 2, length))
    ray, cone = (
        {"type": "CylinderGeometry", "radiusTop": far, "radiusBottom": near, "height": length}
        | {"radialSegments": 32, "openEnded": True}
        for far, near in ((thin, thin), (0.09 * length, 2 * thin))
    )
    dot = {"type": "SphereGeometry", "radius": 4 * thin}
    parts = [
        three.Drawable(ray, middle, three.flat(colour, 0.9), order=4),
        three.Drawable(cone, middle, three.flat(colour, 0.10, side=2), order=3),
        three.Drawable(dot, end, three.flat(colour, 0.95), order=5),
    ]
    drawn = three.draw_group(path, parts, f"sight-{root.rpartition('/')[2]}-")
    return [drawn, three.command_pose(path, fixed.placement.homogeneous)]


def rays(rig: Rig, poses: Poses) -> tuple[Array, Array]:
    """Return origin, m, and direction of the line of sight in the world at each frame, both (F, 3)."""
    fixed = find_frame(rig, rig.camera_frame)
    pose = poses.world[:, fixed.parentJoint] @ fixed.placement.homogeneous
    return pose[:, :3, 3], pose[:, :3, 0]


def tips(rig: Rig, poses: Poses, length: float) -> Array:
    """Return where the beam ends at each frame, m, (F, 3)."""
    origin, direction = rays(rig, poses)
    return origin + length * direction


def trail(path: str, points: Array, colour: tuple[float, ...]) -> three.Json:
    """Return the command that draws the path of the beam's end; the page lets it fade by the points' opacities."""
    material = three.flat(colour, 0.75, kind="LineBasicMaterial", vertexColors=2)
    line = three.buffer(points, colours=np.ones((len(points), 4)))
    part = three.Drawable(line, three.IDENTITY, material, kind="Line", order=3)
    return three.draw_group(path, [part], path.rpartition("/")[2])


def compute_heading(rig: Rig, poses: Poses) -> float:
    """Return the mean compass direction of the line of sight, rad from the world's x; 0 where it is upright."""
    direction = rays(rig, poses)[1].mean(axis=0)
    return (
        float(np.arctan2(direction[1], direction[0]))
        if np.hypot(direction[0], direction[1]) > 1e-6
        else 0.0
    )
