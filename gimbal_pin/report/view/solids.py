"""The solids that a rig's URDF draws, and stand-ins for links of which it draws nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.rig import urdf
from gimbal_pin.rig.meshes import Mesh, find_meshes
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    import yourdfpy

Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Turns a three.js cylinder, which stands on y, onto the z of a URDF cylinder."""
TONES = (
    (0.55, 0.59, 0.65, 1.0),
    (0.42, 0.52, 0.64, 1.0),
    (0.66, 0.56, 0.44, 1.0),
    (0.44, 0.56, 0.50, 1.0),
)
"""Colours of visuals without one, link by link in turns, so that neighbours differ."""
STAND_IN_COLOURS = (
    (0.23, 0.45, 0.80, 1.0),
    (0.85, 0.35, 0.25, 1.0),
    (0.20, 0.62, 0.40, 1.0),
    (0.60, 0.40, 0.72, 1.0),
)
BONE = (0.45, 0.50, 0.58, 0.6)


@dataclass(frozen=True, eq=False)
class Shape:
    """A three.js geometry without its uuid, and the box around it.

    Attributes:
        geometry: The geometry.
        half: Half the edges of the box, m, (3,).
        centre: Centre of the box, m, (3,).
    """

    geometry: three.Json
    half: Array
    centre: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class Solid:
    """A coloured solid fixed to a link.

    Attributes:
        link: The link it belongs to.
        joint: The joint that moves it; 0: it is fixed to the base.
        shape: Its form.
        placement: Pose in the joint's frame, (4, 4).
        rgba: Colour, 0..1.
    """

    link: str
    joint: int
    shape: Shape
    placement: Array
    rgba: tuple[float, ...]

    @property
    def facets(self) -> bool:
        """Whether it is a mesh, shaded face by face."""
        return self.shape.geometry["type"] == "BufferGeometry"

    @property
    def corners(self) -> Array:
        """Corners of the box around it in the joint's frame, m, (8, 3)."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        points = self.shape.centre + signs * self.shape.half
        return points @ self.placement[:3, :3].T + self.placement[:3, 3]

    def refine(self, error: float) -> Solid:
        """Return it with a cylinder or sphere in segments whose chords are within `error`, m, of its circle.

        A chord lies r (1 - cos π/n) inside. Software renderers spend their time on triangles.
        """
        geometry = self.shape.geometry
        radius = geometry.get("radiusTop", geometry.get("radius", 0.0))
        if not radius:
            return self
        count = int(np.ceil(np.pi / np.arccos(max(1 - error / radius, 0.5))))
        cylinder = {"radialSegments": count}
        sphere = {"widthSegments": count, "heightSegments": count // 2 + 1}
        return replace(
            self,
            shape=replace(
                self.shape, geometry=geometry | (cylinder if "radiusTop" in geometry else sphere)
            ),
        )


def find_frame(rig: Rig, link: str) -> pin.Frame:
    """Return a link's frame: `parentJoint` moves it, `placement` is its pose in that joint's frame."""
    return rig.model.frames[rig.model.getFrameId(link, pin.FrameType.BODY)]


def attach(rig: Rig, link: str, shape: Shape, pose: Array, rgba: tuple[float, ...]) -> Solid:
    """Return a shape fixed to a link at a pose in its frame, (4, 4)."""
    at = find_frame(rig, link)
    turn = Y_TO_Z if "radiusTop" in shape.geometry else three.IDENTITY
    return Solid(link, at.parentJoint, shape, at.placement.homogeneous @ pose @ turn, rgba)


def shape_box(size: Array) -> Shape:
    """Return a box of the given edges, m."""
    width, height, depth = map(float, size)
    return Shape(
        {"type": "BoxGeometry", "width": width, "height": height, "depth": depth},
        np.asarray(size) / 2,
    )


def shape_cylinder(radius: float, length: float) -> Shape:
    """Return a cylinder about z, m."""
    geometry = {
        "type": "CylinderGeometry",
        "radiusTop": radius,
        "radiusBottom": radius,
        "height": length,
    }
    return Shape(geometry, np.array([radius, length / 2, radius]))


def shape_sphere(radius: float) -> Shape:
    """Return a sphere, m."""
    return Shape({"type": "SphereGeometry", "radius": radius}, np.full(3, radius))


# -- from the URDF -----------------------------------------------------------------------------------------------------


def visuals(rig: Rig) -> tuple[tuple[Solid, ...], tuple[str, ...], frozenset[str]]:
    """Return the rig's solids, a sentence for each that could not be drawn as its URDF says, and the links of these."""
    robot = urdf.load_checked(rig.urdf, str(rig.path))
    every = [
        (k, link.name, visual) for k, link in enumerate(robot.links) for visual in link.visuals
    ]
    inside = (visual.material for _, _, visual in every if visual.material is not None)
    colours = {  # that materials define by name, at the robot's level or inside a visual
        one.name: tuple(map(float, one.color.rgba))
        for one in (*inside, *robot.materials)
        if one.color is not None and one.name is not None
    }
    named = {v.geometry.mesh.filename or "" for _, _, v in every if v.geometry and v.geometry.mesh}
    meshes = find_meshes(named, rig.path.parent)
    drawn = list[Solid]()
    events = list[str]()
    missing = set[str]()
    for k, link, visual in every:
        shape = read_shape(visual.geometry, meshes)
        material = visual.material
        rgba: tuple[float, ...] = TONES[k % len(TONES)]
        if isinstance(shape, str):
            events.append(f"link {link}: {shape}")
            missing.add(link)
            continue
        if material is not None:
            own = material.color
            rgba = colours.get(material.name, rgba) if own is None else tuple(map(float, own.rgba))
        pose = three.IDENTITY if visual.origin is None else np.asarray(visual.origin, dtype=float)
        drawn.append(attach(rig, link, shape, pose, rgba))
    return tuple(drawn), tuple(events), frozenset(missing)


def read_shape(shape: yourdfpy.Geometry | None, meshes: Mapping[str, Mesh | str]) -> Shape | str:
    """Return the form of a ``<visual>``, or why it is not drawn; `meshes`: file → triangles, or why there are none."""
    if shape is None:
        return "a visual without geometry is not drawn"
    if shape.box is not None:
        return shape_box(np.asarray(shape.box.size, dtype=float))
    if shape.cylinder is not None:
        return shape_cylinder(float(shape.cylinder.radius), float(shape.cylinder.length))
    if shape.sphere is not None:
        return shape_sphere(float(shape.sphere.radius))
    if shape.mesh is None:
        return "a visual that is no box, cylinder, sphere or mesh is not drawn"
    name = shape.mesh.filename or ""
    read = meshes[name]
    if isinstance(read, str):
        return f"mesh '{name if len(name) <= 100 else f'{name[:99]}…'}' {read}: not drawn"
    vertices = read.vertices * (
        1.0 if shape.mesh.scale is None else np.asarray(shape.mesh.scale, dtype=float)
    )
    low = vertices.min(axis=0)
    high = vertices.max(axis=0)
    return Shape(three.buffer(vertices, read.faces), (high - low) / 2, (high + low) / 2)


# -- stand-ins ---------------------------------------------------------------------------------------------------------


def stand_ins(rig: Rig) -> tuple[Solid, ...]:
    """Return solids that show the rig's joints and reach: a cylinder on each joint's axis, bars from joint to joint.

    Lengths come from the joints' placements, and from the bodies' centres of mass and radii of gyration where the axes
    meet in one point.
    """
    model = rig.model
    links = (rig.base, *rig.links)
    axes = {joint.name: joint.axis for joint in urdf.load_checked(rig.urdf, str(rig.path)).joints}
    chain = sum(float(np.linalg.norm(place.translation)) for place in model.jointPlacements)
    bodies = [
        np.linalg.norm(x.lever) + np.sqrt(max(np.trace(x.inertia), 0.0) / x.mass)
        for x in model.inertias[1:]
    ]
    radius = 0.06 * max(chain, *map(float, bodies), 0.02)
    drawn = list[Solid]()
    for i, link in enumerate(links):
        children = [k for k in range(1, model.njoints) if model.parents[k] == i]
        ends = [np.array(model.jointPlacements[k].translation) for k in children]
        if i:
            axis = axes[rig.joints[i - 1]]
            along = pose_along(
                np.array([1.0, 0, 0]) if axis is None else np.asarray(axis, dtype=float),
                np.zeros(3),
            )
            colour = STAND_IN_COLOURS[(i - 1) % len(STAND_IN_COLOURS)]
            drawn.append(attach(rig, link, shape_cylinder(radius, 2.6 * radius), along, colour))
            ends.append(np.array(model.inertias[i].lever))
        for end in ends:
            if (length := float(np.linalg.norm(end))) > radius:
                bar = shape_box(np.array([0.5 * radius, 0.5 * radius, length]))
                drawn.append(attach(rig, link, bar, pose_along(end, end / 2), BONE))
        if i:
            drawn.append(attach(rig, link, shape_sphere(0.7 * radius), three.pose(ends[-1]), BONE))
    return tuple(drawn)


def pose_along(direction: Array, origin: Array) -> Array:
    """Return the pose, (4, 4), at `origin` whose z points along `direction`."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return three.pose(origin, np.column_stack([x, np.cross(z, x), z]))
