"""The solids that a rig's URDF draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.view import three
from gimbal_pin.report.view.solid import Solid, box, cylinder, sphere
from gimbal_pin.rig import urdf
from gimbal_pin.rig.meshes import Mesh, find_meshes
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    import yourdfpy

TONES = ((0.55, 0.59, 0.65, 1.0), (0.42, 0.52, 0.64, 1.0), (0.66, 0.56, 0.44, 1.0), (0.44, 0.56, 0.50, 1.0))
"""Colours of visuals without one, link by link in turns, so that neighbours differ."""


def visuals(rig: Rig) -> tuple[tuple[Solid, ...], tuple[str, ...], frozenset[str]]:
    """Return the rig's solids, a sentence for each that could not be drawn as its URDF says, and the links of these."""
    robot = urdf.load_checked(rig.urdf, str(rig.path))
    colours = named_colours(robot)
    named = {
        v.geometry.mesh.filename or "" for link in robot.links for v in link.visuals if v.geometry and v.geometry.mesh
    }
    meshes = find_meshes(named, rig.path.parent)
    drawn: list[Solid] = []
    events: list[str] = []
    missing: set[str] = set()
    for k, link in enumerate(robot.links):
        for visual in link.visuals:
            solid, event = from_visual(link.name, visual, colours, meshes, TONES[k % len(TONES)])
            drawn += [] if solid is None else [solid]
            missing |= {link.name} if solid is None else set()
            events += [] if event is None else [event]
    return tuple(drawn), tuple(events), frozenset(missing)


def named_colours(robot: yourdfpy.Robot) -> dict[str, tuple[float, ...]]:
    """Return the colours that materials define by name, at the robot's level or inside a visual."""
    inside = (visual.material for link in robot.links for visual in link.visuals if visual.material is not None)
    materials = (*inside, *robot.materials)
    return {m.name: tuple(map(float, m.color.rgba)) for m in materials if m.color is not None and m.name is not None}


def from_visual(
    link: str,
    visual: yourdfpy.Visual,
    colours: dict[str, tuple[float, ...]],
    meshes: Mapping[str, Mesh | str],
    plain: tuple[float, ...],
) -> tuple[Solid | None, str | None]:
    """Return the solid of one ``<visual>`` and what went wrong with it, each None where there is nothing to say.

    `plain`: its colour if it has none.
    """
    shape = visual.geometry
    material = visual.material
    rgba = plain if material is None else colours.get(material.name, plain)
    if material is not None and material.color is not None:
        rgba = tuple(map(float, material.color.rgba))
    pose = np.eye(4) if visual.origin is None else np.asarray(visual.origin, dtype=float)
    if shape is None:
        return None, f"link {link}: a visual without geometry is not drawn"
    if shape.box is not None:
        return box(link, pose, np.asarray(shape.box.size, dtype=float), rgba), None
    if shape.cylinder is not None:
        return cylinder(link, pose, float(shape.cylinder.radius), float(shape.cylinder.length), rgba), None
    if shape.sphere is not None:
        return sphere(link, pose, float(shape.sphere.radius), rgba), None
    if shape.mesh is not None:
        return from_mesh(link, pose, shape.mesh, rgba, meshes[shape.mesh.filename or ""])
    return None, f"link {link}: a visual that is no box, cylinder, sphere or mesh is not drawn"


def from_mesh(
    link: str, pose: Array, mesh: yourdfpy.Mesh, rgba: tuple[float, ...], read: Mesh | str
) -> tuple[Solid | None, str | None]:
    """Return a mesh file's triangles, or None and a sentence that says why there are none."""
    if isinstance(read, str):
        name = mesh.filename or ""
        name = name if len(name) <= 100 else f"{name[:99]}…"
        return None, f"link {link}: mesh '{name}' {read}: not drawn"
    vertices = read.vertices * (1.0 if mesh.scale is None else np.asarray(mesh.scale, dtype=float))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    geometry = three.buffer(vertices, read.faces)
    return Solid(link, geometry, pose, rgba, (high - low) / 2, (high + low) / 2, facets=True), None
