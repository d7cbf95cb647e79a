"""Stand-ins for links that draw nothing: a cylinder on each joint's axis, a translucent bar from joint to joint."""

from __future__ import annotations

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.solid import Solid, box, cylinder, sphere
from gimbal_pin.rig import urdf
from gimbal_pin.rig.rig import Rig

STAND_IN_COLOURS = ((0.23, 0.45, 0.80, 1.0), (0.85, 0.35, 0.25, 1.0), (0.20, 0.62, 0.40, 1.0), (0.60, 0.40, 0.72, 1.0))
BONE = (0.45, 0.50, 0.58, 0.6)


def stand_ins(rig: Rig) -> tuple[Solid, ...]:
    """Return solids that show the rig's joints and reach.

    Lengths come from the joints' placements, and from the bodies' centres of mass and radii of gyration where the axes
    meet in one point.
    """
    axes = {joint.name: joint.axis for joint in urdf.load_checked(rig.urdf, str(rig.path)).joints}
    radius = 0.06 * reach(rig)
    drawn = [bone(rig.base, end, 0.5 * radius) for end in ends(rig, 0) if np.linalg.norm(end) > radius]
    for i, (joint, link) in enumerate(zip(rig.joints, rig.links), start=1):
        axis = np.array([1.0, 0.0, 0.0]) if axes[joint] is None else np.asarray(axes[joint], dtype=float)
        drawn.append(
            cylinder(
                link,
                aligned(axis, np.zeros(3)),
                radius,
                2.6 * radius,
                STAND_IN_COLOURS[(i - 1) % len(STAND_IN_COLOURS)],
            )
        )
        drawn += [bone(link, end, 0.5 * radius) for end in ends(rig, i) if np.linalg.norm(end) > radius]
        drawn.append(sphere(link, three.pose(rig.model.inertias[i].lever), 0.7 * radius, BONE))
    return tuple(drawn)


def reach(rig: Rig) -> float:
    """Return a length that the rig's size is judged by, m: joint to joint along the chain, or the bodies' extent."""
    chain = sum(float(np.linalg.norm(place.translation)) for place in rig.model.jointPlacements)
    bodies = [
        float(np.linalg.norm(body.lever) + np.sqrt(max(np.trace(body.inertia), 0.0) / body.mass))
        for body in rig.model.inertias[1:]
    ]
    return max(chain, *bodies, 0.02)


def ends(rig: Rig, joint: int) -> list[Array]:
    """Return where the bones of a body end, in its joint's frame, m: at the next joints and at its centre of mass."""
    model = rig.model
    children = [k for k in range(1, model.njoints) if model.parents[k] == joint]
    points = [np.array(model.jointPlacements[k].translation) for k in children]
    return [*points, np.array(model.inertias[joint].lever)] if joint else points


def bone(link: str, end: Array, width: float) -> Solid:
    """Return a square bar from the joint's origin to `end`."""
    return box(link, aligned(end, end / 2), np.array([width, width, float(np.linalg.norm(end))]), BONE)


def aligned(direction: Array, origin: Array) -> Array:
    """Return the pose, (4, 4), at `origin` whose z points along `direction`."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return three.pose(origin, np.column_stack([x, np.cross(z, x), z]))
