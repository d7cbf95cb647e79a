"""The rig's figure: its solids in a tree of groups, one per moved link, which the joints' poses move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.motion import Frames, Poses
from gimbal_pin.report.view.solid import Solid
from gimbal_pin.rig.rig import Rig

GHOST_COLOUR = (0.16, 0.45, 0.95)
HOT = (0.88, 0.12, 0.10)
"""Colour of a link whose `colour` is 1."""

Tracks = dict[str, list[three.Json]]
"""Scene path → what is animated there."""


def list_scene_paths(rig: Rig, root: str) -> tuple[str, ...]:
    """Return the scene path of each joint's group; index 0 is the base's. Groups nest as the joints do."""
    found = [root]
    for joint, link in enumerate(rig.links, start=1):
        found.append(f"{found[rig.model.parents[joint]]}/{link.replace('/', ':')}")
    return tuple(found)


def frame(rig: Rig, link: str) -> pin.Frame:
    """Return a link's frame: `parentJoint` moves it, `placement` is its pose in that joint's group."""
    return rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)]


def build_figure(rig: Rig, solids: Sequence[Solid], root: str) -> list[three.Json]:
    """Return the commands that draw the rig."""
    commands = []
    for joint, path in enumerate(list_scene_paths(rig, root)):
        own = moved_by(rig, solids, joint)
        parts = [
            three.Drawable(s.geometry, at, three.glossy(s.rgba, **facets(s)), casts=s.rgba[3] >= 1, receives=True)
            for s, at in own
        ]
        commands += [three.draw_object(f"{path}/solids", three.group(parts, prefix(joint)))] if parts else []
    return commands


def ghost(rig: Rig, solids: Sequence[Solid], root: str) -> list[three.Json]:
    """Return the commands that draw a translucent copy of what moves.

    A first pass writes depth alone, so that the second one tints each pixel once, however many parts lie behind it.
    Both are pushed back a little: where rig and reference agree the ghost is not seen.
    """
    behind: three.Json = {"polygonOffset": True, "polygonOffsetFactor": 1.0, "polygonOffsetUnits": 8.0}
    depth = three.flat(GHOST_COLOUR, 0.0, colorWrite=False, **behind) | {"depthWrite": True}
    tint = three.flat(GHOST_COLOUR, 0.32, kind="MeshLambertMaterial", **behind)
    commands = []
    for joint, path in enumerate(list_scene_paths(rig, root)):
        own = moved_by(rig, solids, joint) if joint else []
        parts = [
            three.Drawable(solid.geometry, placement, material | facets(solid), order=order)
            for order, material in ((1, depth), (2, tint))
            for solid, placement in own
        ]
        commands += [three.draw_object(f"{path}/solids", three.group(parts, f"ghost{prefix(joint)}"))] if parts else []
    return commands


def prefix(joint: int) -> str:
    """Return what the names of a joint's parts begin with."""
    return f"j{joint}p"


def moved_by(rig: Rig, solids: Sequence[Solid], joint: int) -> list[tuple[Solid, Array]]:
    """Return the solids that a joint moves (0: none does) with their placement in its group."""
    frames = {link: frame(rig, link) for link in {solid.link for solid in solids}}
    return [
        (solid, frames[solid.link].placement.homogeneous @ solid.placement)
        for solid in solids
        if frames[solid.link].parentJoint == joint
    ]


def facets(solid: Solid) -> three.Json:
    """Return what a mesh's material needs besides: its triangles may face either way and come without normals."""
    return {"type": "MeshPhongMaterial", "flatShading": True, "side": 2} if solid.facets else {}


def pose_commands(rig: Rig, poses: Poses, root: str) -> list[three.Json]:
    """Return the commands that put the groups where the first frame has them."""
    positions = (poses.place[0], *poses.position[0])
    attitudes = (poses.base[0], *poses.quaternion[0])
    return [
        three.command_pose(path, three.pose(position, pin.Quaternion(attitude).matrix()))
        for path, position, attitude in zip(list_scene_paths(rig, root), positions, attitudes, strict=True)
    ]


def tracks(rig: Rig, poses: Poses, clock: Array, root: str) -> Tracks:
    """Return what moves the groups: attitudes of all joints, positions where one slides, the base where it turns."""
    found: Tracks = {}
    base, *groups = list_scene_paths(rig, root)
    if np.ptp(poses.base, axis=0).max() > 0:
        found[base] = [three.animate_property(".quaternion", "quaternion", clock, poses.base)]
        if np.ptp(poses.place, axis=0).max() > 0:
            found[base].append(three.animate_property(".position", "vector3", clock, poses.place))
    for joint, path in enumerate(groups):
        found[path] = [three.animate_property(".quaternion", "quaternion", clock, poses.quaternion[:, joint])]
        if np.ptp(poses.position[:, joint], axis=0).max() > 0:
            found[path].append(three.animate_property(".position", "vector3", clock, poses.position[:, joint]))
    return found


def apart(
    rig: Rig, solids: Sequence[Solid], poses: Poses, reference: Poses, clock: Array, root: str, least: float
) -> Tracks:
    """Return what shows each link's solids only while some of them may be `least`, m, or more from the reference.

    No point within r of a joint's frame is further away than ``|Δp| + ‖ΔR‖ r``, ‖ΔR‖ the spectral norm.
    """
    found: Tracks = {}
    for joint, path in enumerate(list_scene_paths(rig, root)[1:], start=1):
        corners = [solid.corners @ at[:3, :3].T + at[:3, 3] for solid, at in moved_by(rig, solids, joint)]
        if corners:
            change = poses.world[:, joint] - reference.world[:, joint]
            radius = np.linalg.norm(np.concatenate(corners), axis=1).max()
            turned = np.linalg.norm(change[:, :3, :3], axis=(1, 2)) / np.sqrt(2)  # of a difference of two rotations
            shown = np.linalg.norm(change[:, :3, 3], axis=1) + turned * radius >= least
            found[f"{path}/solids"] = [three.switch(".visible", clock, shown)]
    return found


def colour_tracks(rig: Rig, solids: Sequence[Solid], motion: Frames, root: str) -> Tracks:
    """Return what turns each moved link from its own colours (0) to red (1); empty without `motion.colour`."""
    found: Tracks = {}
    if motion.colour is None:
        return found
    for joint, path in enumerate(list_scene_paths(rig, root)[1:], start=1):
        first: dict[tuple[float, ...], int] = {}
        for k, (solid, _) in enumerate(moved_by(rig, solids, joint)):
            first.setdefault((*solid.rgba, float(solid.facets)), k)  # equal looks share one material
        share = motion.colour[:, joint - 1, None]
        found[path] = [
            three.animate_property(
                f"{prefix(joint)}{k}.material.color",
                "color",
                motion.clock,
                (1 - share) * np.array(look[:3]) + share * np.array(HOT),
            )
            for look, k in first.items()
        ]
    return found


def merged(*parts: Mapping[str, list[three.Json]]) -> Tracks:
    """Return all tracks, joined path by path."""
    found: Tracks = {}
    for part in parts:
        for path, some in part.items():
            found[path] = [*found.get(path, []), *some]
    return found


def hull(rig: Rig, solids: Sequence[Solid], world: Array) -> Array:
    """Return the corners of all solids' boxes over some of the frames, in the world, m, (K, 3)."""
    some = np.unique(np.linspace(0, len(world) - 1, 40).astype(int))
    points = []
    for solid in solids:
        fixed = frame(rig, solid.link)
        pose = world[some, fixed.parentJoint] @ fixed.placement.homogeneous
        points.append((pose[:, None, :3, :3] @ solid.corners[:, :, None])[..., 0] + pose[:, None, :3, 3])
    return np.concatenate([block.reshape(-1, 3) for block in points])
