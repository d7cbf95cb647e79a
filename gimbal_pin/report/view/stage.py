"""What the rig stands on, is lit and looked at by, sized by the rig; and what stands still while a platform moves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report import VIEWS
from gimbal_pin.report.view import three
from gimbal_pin.report.view.figure import list_scene_paths, moved_by, rays
from gimbal_pin.report.view.motion import Poses
from gimbal_pin.report.view.solids import Y_TO_Z, Solid
from gimbal_pin.rig.rig import Rig

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

RED = (0.85, 0.20, 0.12)
PALE = (1.0, 0.99, 0.96)
LEVEL = (0.09, 0.13, 0.18)
DECK = (0.36, 0.41, 0.48)
DISTANCE, REACH = 0.95, 0.93
"""From the camera to the target, and to where the line of sight ends just before it, in radii of the rig."""
BOARD = (0.15, 0.105, 0.06, 0.022)
"""Radii of the target's rings, red and pale by turns, in radii of the rig."""
DECK_SIZE, DECK_HIGH = 0.52, 0.02
"""Radius and thickness of the platform's deck, in radii of the rig."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A view.

    Attributes:
        target: What it looks at, m in the world, shape (3,).
        offset: From there to the camera, m, shape (3,).
    """

    target: Array
    offset: Array

    @property
    def sides(self) -> Array:
        """The level directions toward the viewer and to the left of that, (2, 3)."""
        x, y = self.offset[:2] / np.linalg.norm(self.offset[:2])
        return np.array([[x, y, 0.0], [y, -x, 0.0]])

    def find_free_corner(self, points: Array, aspect: float) -> str:
        """Return the first corner of a picture in which the fewest of the points, m, (K, 3), are seen."""
        back = self.offset / np.linalg.norm(self.offset)
        away = points - self.target
        right = np.array([-back[1], back[0], 0.0]) / np.hypot(back[0], back[1])
        reach = (np.linalg.norm(self.offset) - away @ back) * np.tan(np.deg2rad(FOV) / 2)
        across = away @ right / reach / aspect
        up = away @ np.cross(back, right) / reach
        sides = [
            (f"{high} {wide}", y, x)
            for high, y in (("upper", 1), ("lower", -1))
            for wide, x in (("left", -1), ("right", 1))
        ]
        return min(
            sides, key=lambda side: np.sum((side[1] * up > 0.55) & (side[2] * across > 0.5))
        )[0]

    @property
    def key_light(self) -> Array:
        """Where the light that casts the shadows comes from, (3,)."""
        return np.asarray(np.array(KEY[:2]) @ self.sides + [0.0, 0.0, KEY[2]])


def camera(
    points: Array,
    heading: float,
    view: str,
    room: float = 1.0,
    aspect: float = STAGE_ASPECT,
    aside: bool = False,
) -> Camera:
    """Return the closest view of that name that holds all the points, m, (K, 3), `room` times as far away.

    Of a camera at (c, d), a point at (x, z), z toward the viewer, is seen between the slopes l and r where
    l (d - z) ≤ x - c ≤ r (d - z): so d ≥ (max(x + r z) - min(x + l z)) / (r - l), both across and up.

    `heading`: where the line of sight points, rad; `aspect`: the picture's width over its height; `aside`: whether some
    views leave room for pictures at the right.
    """
    axes = find_axes(heading, view)
    free = VIEWS[view][2]
    across, depth = np.split(points @ axes.T, [2], axis=1)
    half = np.tan(np.deg2rad(FOV) / 2) * np.array([aspect, 1.0])
    left = free * aside
    middle = -half * [left, 0.0]
    reach = 0.88 * half * [1 - left, 1.0]
    least = (across + (middle + reach) * depth).max(axis=0)
    most = (across + (middle - reach) * depth).min(axis=0)
    distance = float(np.max((least - most) / (2 * reach)))
    centre = float(np.mean([depth.min(), depth.max()]))
    target = np.append((least + most) / 2 - middle * distance, centre)
    return Camera(target=target @ axes, offset=room * (distance - centre) * axes[2])


def find_axes(heading: float, view: str) -> Array:
    """Return the directions to the viewer's right, up in the picture, and toward the viewer, (3, 3)."""
    azimuth = heading + np.deg2rad(VIEWS[view][0])
    elevation = np.deg2rad(VIEWS[view][1])
    level = np.cos(elevation)
    high = np.sin(elevation)
    back = np.array([level * np.cos(azimuth), level * np.sin(azimuth), high])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(back, right), back])


def place_second(points: Array, heading: float, view: str, aspect: float) -> Array:
    """Return the shift, m, (3,), that puts the same points to the right of themselves or below, with a gap.

    What is w wide and h high is seen the smaller, the larger ``max(2 w / aspect, h)`` is side by side, and
    ``max(w / aspect, 2 h)`` one above the other: so below where ``w > aspect h``.
    """
    right, up, _ = find_axes(heading, view)
    wide = float(np.ptp(points @ right))
    high = float(np.ptp(points @ up))
    return 1.1 * wide * right if wide <= aspect * high else -1.1 * high * up


def commands(view: Camera, views: Iterable[Camera], points: Array, size: float) -> list[three.Json]:
    """Return the commands for background, light, ground and camera of a rig of radius `size`, m, around `points`.

    `views`: all that may be shown. The lamps stand about what is looked at, so that the rig moves in their light.
    """
    return [
        *(
            three.let(path, "visible", False)
            for path in ("/Background", "/Grid", "/Axes", "/Lights")
        ),
        *lights(view, np.vstack([points - one.target for one in views]), size),
        ground(view, points, size),
        *look(view),
    ]


def look(view: Camera) -> list[three.Json]:
    """Return the commands that place the viewer's camera, which orbits the origin in a frame whose y is up."""
    x, y, z = map(float, view.offset)
    distance = float(np.linalg.norm(view.offset))
    lens = {"position": [x, z, -y], "fov": FOV, "near": distance / 100, "far": distance * 50}
    placed = (
        three.let("/Cameras/default/rotated/<object>", name, value) for name, value in lens.items()
    )
    return [three.command_pose("/meshcat", three.pose(-view.target)), *placed]


def lights(view: Camera, points: Array, size: float) -> list[three.Json]:
    """Return a sky, a key light that casts the shadows, a fill light from the viewer, a rim light from behind.

    Seen from the side they add up to 0.97 on a level face, so that white keeps its tone. From above the fill light
    falls on it, too, and it mirrors the key light: then all are dimmed to 0.97.
    The shadows' map, with level sides, holds the points, (K, 3), m from what is looked at, and the ground behind them.
    """
    toward, left = view.sides
    up = np.array([0.0, 0.0, 1.0])
    back = view.key_light / np.linalg.norm(view.key_light)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    held = points @ np.array([right, np.cross(back, right), back]).T
    low = held.min(axis=0) - 0.1 * size
    high = held.max(axis=0) + 0.1 * size
    distance = 5 * size * float(np.linalg.norm(view.key_light))
    box = dict(zip(("left", "bottom"), low[:2].tolist())) | dict(
        zip(("right", "top"), high[:2].tolist())
    )
    depth = {"near": distance - float(high[2]), "far": distance - float(low[2]) + 2 * size}
    eye = {"uuid": "shadow", "type": "OrthographicCamera", "zoom": 1, **box, **depth}
    # 512 along the shorter side: software renderers pay for them one by one
    texels = np.round(512 * (high - low)[:2] / (high - low)[:2].min()).clip(max=1024).tolist()
    shadow = {
        "camera": eye,
        "mapSize": texels,
        "bias": -0.001,
        "normalBias": 0.02 * size,
        "radius": 2,
    }

    ahead = view.offset / np.linalg.norm(view.offset)
    rim = 5 * size * (0.8 * up - toward - 0.6 * left)
    middle = (back + ahead) / np.linalg.norm(back + ahead)
    lit = (
        0.40 + 0.40 * back[2] * (1 + middle[2] ** 30) + 0.30 * ahead[2]
    )  # `glossy` mirrors as much as it scatters
    dimmed = min(0.97 / float(lit + 0.20 * rim[2] / np.linalg.norm(rim)), 1.0)

    def shine(name: str, position: Array, intensity: float, **more: object) -> three.Json:
        kind = "HemisphereLight" if name == "sky" else "DirectionalLight"
        matrix = three.matrix(three.pose(position))
        look_of_it = {
            "uuid": name,
            "type": kind,
            "color": 0xFFFFFF,
            "intensity": dimmed * intensity,
            **more,
        }
        return three.draw_object(f"/Studio/{name}", look_of_it | {"matrix": matrix})

    return [
        shine("sky", up, 0.40, groundColor=0xA8ADB5),
        shine("key", 5 * size * view.key_light, 0.40, shadow=shadow),
        shine("fill", view.offset, 0.30),
        shine("rim", rim, 0.20),
        *(three.let(f"/Studio/{name}/<object>", "castShadow", False) for name in ("fill", "rim")),
    ]


def ground(view: Camera, points: Array, size: float) -> three.Json:
    """Return the command that draws a floor that shows the points' shadows alone, and a grid that fades away."""
    height = float(points[:, 2].min()) - 0.06 * size
    thrown = points[:, :2] - (points[:, 2:] - height) * view.key_light[:2] / view.key_light[2]
    dark = np.array([thrown.min(axis=0), thrown.max(axis=0)])
    pose = three.pose(np.append(dark.mean(axis=0), height))
    width, depth = map(float, 1.05 * np.ptp(dark, axis=0) + 0.02 * size)
    catcher = {
        "type": "ShadowMaterial",
        "color": 0x10161F,
        "opacity": 0.2,
        "transparent": True,
        "depthWrite": False,
    }
    plane = three.Drawable(
        {"type": "PlaneGeometry", "width": width, "height": depth}, pose, catcher, receives=True
    )
    ends, alpha = build_grid(points.mean(axis=0)[:2], 5.0 * size, spacing(size))
    ends = np.column_stack([ends, np.full(len(ends), height)])
    colours = np.column_stack([np.ones((len(ends), 3)), alpha])
    look_of_it = three.flat(
        GRID_COLOUR, kind="LineBasicMaterial", vertexColors=2, transparent=True, depthWrite=False
    )
    lines = three.Drawable(
        three.buffer(ends, colours=colours), three.IDENTITY, look_of_it, kind="LineSegments"
    )
    return three.draw_group("/meshcat/ground", [plane, lines], "ground")


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
        first = np.ceil((centre[axis] - radius) / step)
        last = np.floor((centre[axis] + radius) / step)
        for across in step * np.arange(first, last + 1):
            chord = np.sqrt(max(radius**2 - (across - centre[axis]) ** 2, 0.0))
            line = np.column_stack(
                [np.full(len(pieces), across), centre[1 - axis] + chord * pieces]
            )
            ends.append(np.repeat(line if axis == 0 else line[:, ::-1], 2, axis=0)[1:-1])
    points = np.concatenate(ends)
    away = np.sum((points - centre) ** 2, axis=1) / radius**2
    return points, 0.55 * np.clip(1 - away, 0, 1) ** 2


# -- a platform that moves ---------------------------------------------------------------------------------------------


def marks(
    rig: Rig, solids: Sequence[Solid], poses: Poses, wanted: Array, size: float
) -> tuple[list[three.Json], Array]:
    """Return the commands that draw target, horizon and platform, and the points that the view must hold, (K, 3).

    The target is a board of rings that faces the camera, the horizon a level ring at its height, the platform a disc.
    `wanted`: the camera's attitude that should be kept, (3, 3); `size`: radius of the rig, m.
    """
    eye = rays(rig, poses)[0].mean(axis=0)
    ahead = wanted[:, 0]
    place = eye + DISTANCE * size * ahead
    facing = np.column_stack([wanted[:, 1], wanted[:, 2], ahead])
    rings = [
        three.Drawable(
            {"type": "CircleGeometry", "radius": radius * size, "segments": 64},
            three.pose(place - 0.002 * k * size * ahead, facing),
            three.flat(PALE if k % 2 else RED, side=2),
        )
        for k, radius in enumerate(BOARD)
    ]
    ring = {
        "type": "TorusGeometry",
        "radius": size,
        "tube": 0.005 * size,
        "radialSegments": 8,
        "tubularSegments": 128,
    }
    level = three.Drawable(ring, three.pose(eye), three.flat(LEVEL, 0.75), order=2)
    disc = {
        "type": "CylinderGeometry",
        "radiusTop": DECK_SIZE * size,
        "radiusBottom": DECK_SIZE * size,
    }
    disc |= {"height": DECK_HIGH * size, "radialSegments": 72}
    # The deck is on the far side of the base from what the joints move.
    heights = np.concatenate([np.zeros(0), *(solid.corners[:, 2] for solid in moved_by(solids, 0))])
    low, high = (float(heights.min()), float(heights.max())) if len(heights) else (0.0, 0.0)
    is_above = float(rig.model.jointPlacements[1].translation[2]) >= (low + high) / 2
    middle = low - DECK_HIGH / 2 * size if is_above else high + DECK_HIGH / 2 * size
    at = np.array([0.0, 0.0, middle])
    deck = three.Drawable(
        disc, three.pose(at) @ Y_TO_Z, three.glossy((*DECK, 0.55)), receives=True, order=1
    )
    drawn = [
        three.draw_group("/meshcat/target", rings, "target"),
        three.draw_group("/meshcat/horizon", [level], "horizon"),
        three.draw_group(
            f"{list_scene_paths(rig, '/meshcat/rig')[0]}/platform", [deck], "platform"
        ),
    ]
    corners = place + BOARD[0] * size * np.array(
        [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    )
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    rim = at + DECK_SIZE * size * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    some = poses.world[:: max(1, len(poses.world) // 40), 0]
    return drawn, np.vstack([corners, *(rim @ one[:3, :3].T + one[:3, 3] for one in some)])
