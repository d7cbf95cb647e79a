"""Coloured solids fixed to a link."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three

Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Turns a three.js cylinder, which stands on y, onto the z of a URDF cylinder."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A coloured solid fixed to a link.

    Attributes:
        link: The link it belongs to.
        geometry: three.js geometry without its uuid.
        placement: Pose in the link's frame, (4, 4).
        rgba: Colour, 0..1.
        half: Half the edges of the box around it, in its own frame, m, shape (3,).
        centre: Centre of that box in its own frame, m, shape (3,).
        facets: Whether it is a mesh, shaded face by face.
    """

    link: str
    geometry: three.Json
    placement: Array
    rgba: tuple[float, ...]
    half: Array
    centre: Array
    facets: bool = False

    @property
    def corners(self) -> Array:
        """Corners of the box around it in the link's frame, m, (8, 3)."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        points = self.centre + signs * self.half
        return points @ self.placement[:3, :3].T + self.placement[:3, 3]


def refine_solid(solid: Solid, error: float) -> Solid:
    """Return a cylinder or sphere in as many segments as keep its chords within `error`, m, of its circle.

    A chord lies r (1 - cos π/n) inside. Software renderers spend their time on triangles.
    """
    radius = solid.geometry.get("radiusTop", solid.geometry.get("radius", 0.0))
    if not radius:
        return solid
    count = int(np.ceil(np.pi / np.arccos(max(1 - error / radius, 0.5))))
    names = (
        {"radialSegments": count}
        if "radiusTop" in solid.geometry
        else {"widthSegments": count, "heightSegments": count // 2 + 1}
    )
    return replace(solid, geometry={**solid.geometry, **names})


def box(link: str, pose: Array, size: Array, rgba: tuple[float, ...]) -> Solid:
    """Return a box of the given edges, m."""
    width, height, depth = map(float, size)
    geometry = {"type": "BoxGeometry", "width": width, "height": height, "depth": depth}
    return Solid(link, geometry, pose, rgba, np.asarray(size) / 2, np.zeros(3))


def cylinder(link: str, pose: Array, radius: float, length: float, rgba: tuple[float, ...]) -> Solid:
    """Return a cylinder about the z of its pose, m."""
    geometry = {"type": "CylinderGeometry", "radiusTop": radius, "radiusBottom": radius, "height": length}
    half = np.array([radius, length / 2, radius])
    return Solid(link, geometry, pose @ Y_TO_Z, rgba, half, np.zeros(3))


def sphere(link: str, pose: Array, radius: float, rgba: tuple[float, ...]) -> Solid:
    """Return a sphere, m."""
    geometry = {"type": "SphereGeometry", "radius": radius}
    return Solid(link, geometry, pose, rgba, np.full(3, radius), np.zeros(3))
