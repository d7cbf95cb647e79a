"""How far a rig's parts stay from each other: its URDF's collision geometry through Pinocchio and coal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree

from gimbal_pin.errors import RigError
from gimbal_pin.excitation.limits import Envelope
from gimbal_pin.log.log import Array
from gimbal_pin.rig import urdf
from gimbal_pin.rig.meshes import encode_stl, find_meshes
from gimbal_pin.rig.rig import Rig


class Gap(NamedTuple):
    """The smallest distance, m, and the links between which it is."""

    distance: float
    between: tuple[str, str]


@dataclass(frozen=True, eq=False)
class Clearance:
    """``distance >= required`` between all parts that can hit each other.

    Parts that one joint moves together, and links that a joint connects, are left out, and pairs that are nearer than
    required in every pose: they are built that way.

    Attributes:
        rig: The rig.
        geometry: Its collision geometry with the pairs.
        required: Distance to be kept, m.
        watched: Indices of the pairs to be kept apart while optimising.
        unchecked: Links with a mesh that is not there.
    """

    rig: Rig
    geometry: pin.GeometryModel
    required: float
    watched: tuple[int, ...] = ()
    unchecked: tuple[str, ...] = ()

    @staticmethod
    def of(rig: Rig, required: float, envelope: Envelope) -> Clearance:
        """The rig's parts, those pairs watched that come within 8 mm of too near on a hundred states of the envelope.

        All pairs are checked on the finished motion.

        Raises:
            RigError: A mesh cannot be read.
        """
        geometry, unchecked = build_collision_geometry(rig)
        every = Clearance(rig, geometry, required, (), unchecked)
        found = every.compute_distances(
            envelope.spread().q[:100], range(len(geometry.collisionPairs))
        )
        built = set(np.flatnonzero(found.max(axis=0) < required).tolist()) if found.size else set()
        pairs = list(geometry.collisionPairs)
        geometry.removeAllCollisionPairs()
        for k, pair in enumerate(pairs):
            if k not in built:
                geometry.addCollisionPair(pair)
        near = np.delete(found, list(built), axis=1).min(axis=0, initial=np.inf) < required + 0.008
        return replace(every, watched=tuple(np.flatnonzero(near).tolist()))

    def compute_distances(self, q: Array, pairs: range | tuple[int, ...]) -> Array:
        """Distance of each pair at angles q (N, n), m, (N, pairs); less than zero where they are inside each other."""
        model = self.rig.model
        geometry = self.geometry
        measure = pin.computeDistance
        data = model.createData()
        at = geometry.createData()
        out = np.empty((len(q), len(pairs)))
        for row, angles in zip(out, q):
            pin.updateGeometryPlacements(model, data, geometry, at, angles)
            row[...] = [measure(geometry, at, k).min_distance for k in pairs]
        return out

    def compute_room(self, q: Array) -> Array:
        """What the watched pairs have left, dm, which weighs about as a share of a limit does, (N, pairs)."""
        return (self.compute_distances(q, self.watched) - self.required) / 0.1

    def differentiate_room(self, q: Array) -> Array:
        """Derivative of `compute_room` to the angles, (N, pairs, n).

        ``n' (J_2(p_2) - J_1(p_1))``: nearest points p_1, p_2, normal n from first to second, J(p) the motion of p.
        """
        model = self.rig.model
        geometry = self.geometry
        data = model.createData()
        at = geometry.createData()
        axes = np.empty((len(q), 6, self.rig.n))
        near = np.empty((len(q), len(self.watched), 3, 3))
        for screw, rows, angles in zip(axes, near, q):
            screw[...] = pin.computeJointJacobians(model, data, angles).reshape(
                6, -1
            )  # n = 1: (6,)
            pin.updateGeometryPlacements(model, data, geometry, at)
            for row, k in zip(rows, self.watched):
                found = pin.computeDistance(geometry, at, k)
                row[...] = found.normal, found.getNearestPoint1(), found.getNearestPoint2()
        normal = near[:, :, :1]
        points = near[:, :, 1:]
        along = (
            np.concatenate(
                [np.broadcast_to(normal, points.shape), np.cross(points, normal)], axis=3
            )
            @ axes[:, None]
        )
        moved = along * self.is_moved[list(self.watched)]
        return (moved[:, :, 1] - moved[:, :, 0]) / 0.1

    @cached_property
    def is_moved(self) -> Array:
        """1 where a joint moves a pair's first and second part, (pairs, 2, n)."""
        model = self.rig.model
        objects = self.geometry.geometryObjects
        out = np.zeros((len(self.geometry.collisionPairs), 2, self.rig.n))
        for row, pair in zip(out, self.geometry.collisionPairs):
            for side, part in zip(row, (pair.first, pair.second)):
                side[
                    [joint - 1 for joint in model.supports[objects[part].parentJoint] if joint]
                ] = 1.0
        return out

    def find_smallest_gap(self, q: Array) -> Gap | None:
        """The smallest distance of any pair at any of the consecutive angles q (N, n); None where there is no pair.

        All pairs are measured at every eighth sample, and at those between only where a pair can have come nearer than
        the nearest so far: by no more than ``sum_j reach_j |dq_j|``.
        """
        stride = 8
        pairs = range(len(self.geometry.collisionPairs))
        if not pairs:
            return None
        measured = np.minimum(stride // 2 + stride * np.arange(-(-len(q) // stride)), len(q) - 1)
        rough = self.compute_distances(q[measured], pairs)
        place = np.unravel_index(np.argmin(rough), rough.shape)
        best = float(rough[place])
        pair = int(place[1])
        own = np.minimum(np.arange(len(q)) // stride, len(measured) - 1)
        slack = np.abs(q - q[measured[own]]) @ self.bound_reach(q)
        for k in np.flatnonzero(rough.min(axis=0) - slack.max() < best).tolist():
            open_samples = np.flatnonzero(rough[own, k] - slack < best)
            nearer = float(self.compute_distances(q[open_samples], (k,)).min(initial=np.inf))
            best, pair = (nearer, k) if nearer < best else (best, pair)
        return Gap(best, self.get_links(pair))

    def bound_reach(self, q: Array) -> Array:
        """Most that any part's points move per unit of each joint, (n,), m/rad: the tree's lengths added up."""
        model = self.rig.model
        slides = np.array(
            [joint.shortname().startswith("JointModelP") for joint in list(model.joints)[1:]]
        )
        out = np.where(slides, 1.0, 0.0)
        for part in self.geometry.geometryObjects:
            part.geometry.computeLocalAABB()
            size = (
                np.linalg.norm(part.placement.act(part.geometry.aabb_center))
                + part.geometry.aabb_radius
            )
            for joint in reversed([j for j in model.supports[part.parentJoint] if j]):
                travel = np.abs(q[:, joint - 1]).max() if slides[joint - 1] else 0.0
                out[joint - 1] = max(out[joint - 1], size)
                size += float(np.linalg.norm(model.jointPlacements[joint].translation)) + travel
        return out

    def get_links(self, pair: int) -> tuple[str, str]:
        """The links of a pair."""
        both = self.geometry.collisionPairs[pair]
        objects = self.geometry.geometryObjects
        frames = self.rig.model.frames
        first, second = (
            frames[objects[part].parentFrame].name for part in (both.first, both.second)
        )
        return first, second

    def watch_close_pairs(self, q: Array) -> Clearance:
        """The same, every pair watched that is too near at one of the angles q (N, n)."""
        near = (
            self.compute_distances(q, range(len(self.geometry.collisionPairs))).min(
                axis=0, initial=np.inf
            )
            < self.required
        )
        return replace(self, watched=tuple(sorted({*self.watched, *np.flatnonzero(near).tolist()})))


def build_collision_geometry(rig: Rig) -> tuple[pin.GeometryModel, tuple[str, ...]]:
    """Return the collision geometry with all pairs that can hit each other, and the links whose mesh is not there."""
    robot = urdf.parse_robot(rig.urdf, str(rig.path))
    with TemporaryDirectory() as folder:
        unchecked = _resolve_meshes(robot, rig, Path(folder))
        try:
            geometry = pin.buildGeomFromUrdfString(
                rig.model, urdf.strip_to_skeleton(robot, "collision"), pin.GeometryType.COLLISION
            )
        except ValueError as error:
            raise RigError(
                str(rig.path), "has a collision shape that cannot be built", "mend the shape"
            ) from error
    joined = {
        frozenset(joint.find(end).get("link") for end in ("parent", "child"))
        for joint in robot.xpath("joint[@type!='fixed']")
    }
    objects = list(geometry.geometryObjects)
    links = [rig.model.frames[part.parentFrame].name for part in objects]
    for i, part in enumerate(objects):
        for k, other in enumerate(objects[:i]):
            if (
                part.parentJoint != other.parentJoint
                and frozenset((links[i], links[k])) not in joined
            ):
                geometry.addCollisionPair(pin.CollisionPair(k, i))
    return geometry, unchecked


def _resolve_meshes(robot: etree._Element, rig: Rig, folder: Path) -> tuple[str, ...]:
    """Name every collision mesh by a file of its triangles in `folder`, in place; drop those that are not there.

    Returns:
        The links of those that are not there.

    Raises:
        RigError: A mesh cannot be read.
    """
    missing = []
    shapes = robot.xpath("link/collision[geometry/mesh]")
    meshes = find_meshes(
        {shape.find("geometry/mesh").get("filename", "") for shape in shapes}, rig.path.parent
    )
    for k, shape in enumerate(shapes):
        mesh = shape.find("geometry/mesh")
        link = shape.getparent()
        read = meshes[mesh.get("filename", "")]
        if read == "is not there":
            missing.append(link.get("name"))
            link.remove(shape)
        elif isinstance(read, str):
            raise RigError(
                str(rig.path),
                f"link {link.get('name')} has a collision mesh that {read}",
                "mend the mesh",
            )
        else:
            file = folder / f"{k}.stl"
            file.write_bytes(encode_stl(read))
            mesh.set("filename", str(file))
    return tuple(dict.fromkeys(missing))
