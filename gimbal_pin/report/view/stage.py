"""What the rig stands on and is lit and looked at by; all sized by the rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report import VIEWS
from gimbal_pin.report.view import three

FOV = 32.0
"""Vertical angle of view, degrees: narrow enough not to distort."""

STAGE_ASPECT = 16 / 9
USUAL, AIMING = "three-quarter", "over-the-shoulder"

GRID_COLOUR = (0.36, 0.42, 0.50)
SKY = ("#f4f6fa", "#b3bfcf")
"""Background at the top and at the bottom: the page draws it, which costs nothing, where WebGL would shade each pixel.
"""
KEY = (0.6, 0.75, 2.4)
"""Where the light that casts the shadows shines from: toward the viewer, to the viewer's left, up."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A view.

    Attributes:
        target: What it looks at, m in the world, shape (3,).
        offset: From there to the camera, m, shape (3,).
    """

    target: Array
    offset: Array


def camera(points: Array, heading: float, view: str, room: float = 1.0) -> Camera:
    """Return the closest view of that name that holds all the points, m, (K, 3), `room` times as far away.

    `heading`: where the line of sight points, rad.
    """
    around, elevation, aside = VIEWS[view]
    azimuth = heading + np.deg2rad(around)
    level, high = np.cos(np.deg2rad(elevation)), np.sin(np.deg2rad(elevation))
    back = np.array([level * np.cos(azimuth), level * np.sin(azimuth), high])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    axes = np.array([right, np.cross(back, right), back])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    half = np.tan(np.deg2rad(FOV) / 2) * 0.86 * np.array([STAGE_ASPECT * (1 - aside), 1.0])
    distance = float(np.max(np.abs(seen[:, :2] - middle[:2]) / half + (seen[:, 2:] - middle[2])))
    middle[0] += aside * STAGE_ASPECT * np.tan(np.deg2rad(FOV) / 2) * distance
    return Camera(target=middle @ axes, offset=room * distance * back)


def to_the_right(points: Array, heading: float, view: str) -> Array:
    """Return the shift, m, (3,), that puts the same points to the viewer's right of themselves, with a gap."""
    azimuth = heading + np.deg2rad(VIEWS[view][0])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.asarray(1.1 * float(np.ptp(points @ right)) * right)


def commands(view: Camera, points: Array, size: float) -> list[three.Json]:
    """Return the commands for background, light, ground and camera of a rig of radius `size`, m, around `points`."""
    floor = float(points[:, 2].min()) - 0.06 * size
    centre = points.mean(axis=0)
    return [
        *(three.let(path, "visible", False) for path in ("/Background", "/Grid", "/Axes", "/Lights")),
        *lights(view, size, float(np.linalg.norm(points - view.target, axis=1).max())),
        three.draw_object("/meshcat/ground", ground(centre[:2], floor, size, shaded(points, floor, key_light(view)))),
        *look(view),
    ]


def look(view: Camera) -> list[three.Json]:
    """Return the commands that place the viewer's camera, which orbits the origin in a frame whose y is up."""
    x, y, z = map(float, view.offset)
    distance = float(np.linalg.norm(view.offset))
    path = "/Cameras/default/rotated/<object>"
    return [
        three.command_pose("/meshcat", three.pose(-view.target)),
        three.let(path, "position", [x, z, -y]),
        three.let(path, "fov", FOV),
        three.let(path, "near", distance / 100),
        three.let(path, "far", distance * 50),
    ]


def lights(view: Camera, size: float, reach: float) -> list[three.Json]:
    """Return a sky, a key light that casts the shadows, a fill light from the viewer, a rim light from behind.

    On a level face they add up to 0.97, so that white keeps its tone. `reach`: how far from the view's target there
    are things that cast shadows, m.
    """
    toward, left = sides(view)
    rim = np.append(-toward - 0.6 * left, 0.8)
    sky = {"type": "HemisphereLight", "color": 0xFFFFFF, "groundColor": 0xA8ADB5, "intensity": 0.40}
    return [
        three.draw_object("/Studio/sky", light("sky", sky, np.array([0.0, 0.0, 1.0]))),
        three.draw_object(
            "/Studio/key",
            light("key", {**directional(0.40), "shadow": shadow(size, reach)}, 5 * size * key_light(view)),
        ),
        three.draw_object("/Studio/fill", light("fill", directional(0.30), view.offset)),
        three.draw_object("/Studio/rim", light("rim", directional(0.20), 5 * size * rim)),
        *(three.let(f"/Studio/{name}/<object>", "castShadow", False) for name in ("fill", "rim")),
    ]


def sides(view: Camera) -> tuple[Array, Array]:
    """Return the level directions toward the viewer and to the left of that, (2,) each."""
    toward = view.offset[:2] / np.linalg.norm(view.offset[:2])
    return toward, np.array([toward[1], -toward[0]])


def key_light(view: Camera) -> Array:
    """Return where the light that casts the shadows comes from, (3,)."""
    toward, left = sides(view)
    return np.append(KEY[0] * toward + KEY[1] * left, KEY[2])


def shaded(points: Array, floor: float, light: Array) -> Array:
    """Return the corners of the part of the floor that the points throw shadows on, m, (2, 2)."""
    thrown = points[:, :2] - (points[:, 2:] - floor) * light[:2] / light[2]
    return np.array([thrown.min(axis=0), thrown.max(axis=0)])


def light(name: str, look_of_it: three.Json, position: Array) -> three.Json:
    """Return a light as an object of its own, shining from `position` at the origin."""
    metadata = {"version": 4.5, "type": "Object"}
    return {"metadata": metadata, "object": {"uuid": name, "matrix": three.matrix(three.pose(position)), **look_of_it}}


def directional(intensity: float) -> three.Json:
    """Return a light of parallel rays."""
    return {"type": "DirectionalLight", "color": 0xFFFFFF, "intensity": intensity}


def shadow(size: float, reach: float) -> three.Json:
    """Return the part of space whose shadows are drawn."""
    box = {
        "left": -reach,
        "right": reach,
        "top": reach,
        "bottom": -reach,
        "near": 0.1 * size,
        "far": 13 * size + 3 * reach,
    }
    return {
        "camera": {"uuid": "shadow", "type": "OrthographicCamera", "zoom": 1, **box},
        "mapSize": [1024, 1024],
        "bias": -0.001,
        "normalBias": 0.02 * size,
        "radius": 2,
    }


def ground(centre: Array, height: float, size: float, dark: Array) -> three.Json:
    """Return a plane between the corners `dark`, (2, 2), that shows shadows alone, and a grid that fades away."""
    pose = three.pose(np.append(dark.mean(axis=0), height))
    radius = 5.0 * size
    width, depth = map(float, 1.05 * np.ptp(dark, axis=0) + 0.02 * size)
    catcher = {"type": "ShadowMaterial", "color": 0x10161F, "opacity": 0.2, "transparent": True, "depthWrite": False}
    plane = three.Drawable({"type": "PlaneGeometry", "width": width, "height": depth}, pose, catcher, receives=True)
    points, alpha = build_grid(centre, radius, spacing(size))
    points = np.column_stack([points, np.full(len(points), height)])
    colours = np.column_stack([np.ones((len(points), 3)), alpha])
    look_of_it = three.flat(GRID_COLOUR, kind="LineBasicMaterial", vertexColors=2, transparent=True, depthWrite=False)
    lines = three.Drawable(three.buffer(points, colours=colours), three.IDENTITY, look_of_it, kind="LineSegments")
    return three.group([plane, lines], "ground")


def spacing(size: float) -> float:
    """Return 1, 2 or 5 times a power of ten, m, close under half the rig's radius."""
    decade = 10.0 ** np.floor(np.log10(size / 2))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= size / 2 * (1 + 1e-9)))


def build_grid(centre: Array, radius: float, step: float) -> tuple[Array, Array]:
    """Return the ends of the grid's segments, m, (K, 2), and their opacity, (K,).

    Lines lie on the world's round coordinates and fade out towards the rim of the disc; they are cut into short pieces,
    because renderers drop long ones that reach behind the camera.
    """
    pieces = np.linspace(-1, 1, 17)
    ends = []
    for axis in (0, 1):
        first, last = np.ceil((centre[axis] - radius) / step), np.floor((centre[axis] + radius) / step)
        for across in step * np.arange(first, last + 1):
            chord = np.sqrt(max(radius**2 - (across - centre[axis]) ** 2, 0.0))
            line = np.column_stack([np.full(len(pieces), across), centre[1 - axis] + chord * pieces])
            ends.append(np.repeat(line if axis == 0 else line[:, ::-1], 2, axis=0)[1:-1])
    points = np.concatenate(ends)
    away = np.sum((points - centre) ** 2, axis=1) / radius**2
    return points, 0.55 * np.clip(1 - away, 0, 1) ** 2
