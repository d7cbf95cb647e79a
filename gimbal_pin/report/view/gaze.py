"""What a camera sees: horizon, ground and a target far away, so that nothing but the camera's turning shows.

A direction p in the camera's frame (x ahead, y left, z up) lies at (-y/x, z/x) of the picture. The camera that is
turned by ``E = exp(e)`` from the wanted attitude sees as ``Eᵀ p`` what the wanted one sees as p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from math import degrees, floor, log10, radians, tan
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.log.log import Array
from gimbal_pin.report.format import controller_name
from gimbal_pin.report.html import template

if TYPE_CHECKING:
    from gimbal_pin.report.view.three import Json
from gimbal_pin.report.view.outlook import Outlook, Shot

WIDE_TANGENT = tan(radians(45.0))
"""Tangent of half the angle that a wide picture holds across."""
RINGS = (radians(2.0), radians(4.0))
"""Rings of the target in a wide picture, rad."""
NEAREST_DRAWN = 0.02
"""What is no further ahead than this is not drawn."""
GRID_AHEAD, GRID_ASIDE = 14.0, 9.0
"""How far the grid on the ground reaches, in heights of the camera over it."""
SKYLINE = np.array([(1.1, 9.0, 0.4), (0.8, 23.0, 1.9), (0.5, 41.0, 4.0)])
"""Hills: size, °, waves per turn, phase."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """What there is to see, in the frame of the camera that looks as wanted.

    Attributes:
        up: Away from the earth, (3,).
        lines: Pieces of the grid on the ground, from point to point, (K, 2, 3).
        hills: The skyline, from left to right, (H, 3).
    """

    up: Array
    lines: Array
    hills: Array


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of the page.

    Attributes:
        title: What it shows.
        note: A figure below it.
        half: Tangent of half the angle across.
        turned: The camera's turn from the wanted attitude at every frame, rad, (F, 3).
        rings: Radii of the target's rings, rad.
        long: Whether it is a long lens's: no scenery, the target's trail, and a scale.
    """

    title: str
    note: str
    half: float
    turned: Array
    rings: tuple[float, ...]
    long: bool


def scenery(wanted: Array) -> Scenery:
    """Return what there is to see around a camera of attitude R_d in the world, (3, 3)."""
    heading = float(np.arctan2(wanted[1, 0], wanted[0, 0]))
    level = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
    own = wanted.T @ level
    azimuth = np.deg2rad(np.arange(-90.0, 91.0, 2.0))[::-1]
    size, waves, phase = SKYLINE.T
    elevation = np.deg2rad(1.6 + np.sin(np.outer(azimuth, waves) + phase) @ size)
    hills = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.tan(np.maximum(elevation, 0.0))])
    return Scenery(own[:, 2], build_ground_grid() @ own.T, hills @ own.T)


def build_ground_grid() -> Array:
    """Return a grid on the ground, one camera's height under it, ahead and to both sides, (K, 2, 3)."""
    along = [[(-2.0, y, -1.0), (GRID_AHEAD, y, -1.0)] for y in np.arange(-GRID_ASIDE, GRID_ASIDE + 0.1)]
    across = [[(x, -GRID_ASIDE, -1.0), (x, GRID_ASIDE, -1.0)] for x in np.arange(-2.0, GRID_AHEAD + 0.1)]
    return np.array([*along, *across])


def build_pictures(seen: Outlook) -> tuple[Picture, ...]:
    """Return the bolted camera and ours through a wide lens, then all that were held through one long lens."""
    ours, step = seen.held[-1], scale(seen)
    wide = [wide_picture("Bolted to the platform", seen.bolted), wide_picture(f"Held by {called(ours)}", ours)]
    half = 2.6 * step
    long = [
        Picture(
            f"{called(one)[:1].upper()}{called(one)[1:]}, long lens",
            f"jitter {degrees(one.jitter):.4f}° rms",
            half,
            np.column_stack([np.zeros(len(seen.t)), one.shaken]),
            (step, 2 * step),
            True,
        )
        for one in seen.held
    ]
    return (*wide, *long)


def called(one: Shot) -> str:
    """Return what a shot's controller is called."""
    return controller_name(str(one.controller))


def wide_picture(title: str, one: Shot) -> Picture:
    """Return a wide picture; below it, how far the line of sight strays, drift and roll included."""
    away = float(np.degrees(np.hypot(*one.turned[:, 1:].T).max()))
    note = f"the line of sight strays up to {away:.{1 if away > 1 else 3}f}°"
    return Picture(
        title, note if one.controller is None else f"{note}, drift included", WIDE_TANGENT, one.turned, RINGS, False
    )


def scale(seen: Outlook) -> float:
    """Return a round angle, rad, of which the largest jitter of what was held is about two."""
    largest = max(degrees(float(np.hypot(*one.shaken.T).max())) for one in seen.held) or 1e-6
    decade = 10.0 ** floor(log10(largest / 2))
    return radians(min((k * decade for k in (1, 2, 5, 10)), key=lambda step: abs(np.log(2 * step / largest))))


def list_page_data(seen: Outlook, wanted: Array, several: Sequence[Picture]) -> Json:
    """Return what the page's script draws from."""
    world = scenery(wanted)
    return {
        "t": np.round(seen.t, 4).tolist(),
        "up": world.up.tolist(),
        "lines": np.round(world.lines, 4).reshape(-1, 6).tolist(),
        "hills": np.round(world.hills, 4).tolist(),
        "near": NEAREST_DRAWN,
        "pictures": [
            {
                "half": one.half,
                "long": one.long,
                "rings": one.rings,
                "scale": f"{degrees(one.rings[0]):.6g}°",
                "turned": np.round(one.turned, 8 if one.long else 5).tolist(),
            }
            for one in several
        ],
    }


def script() -> str:
    """Return the function that draws pictures from `data`."""
    return files("gimbal_pin.report.view").joinpath("gaze.js").read_text(encoding="utf-8")


def render_gaze(seen: Outlook, wanted: Array) -> str:
    """Return a page that plays what the cameras saw, with a control, and needs nothing but a browser.

    `wanted`: R_d, (3, 3).
    """
    several = build_pictures(seen)
    drawn = list_page_data(seen, wanted, several)
    return template("gimbal_pin.report.view", "gaze.html.j2", pictures=several, script=script(), data=drawn)
