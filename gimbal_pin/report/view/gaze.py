"""What cameras saw of one platform's motion: one bolted to it, and one per controller that held it.

Horizon, ground and target are far away, so that nothing but the camera's turning shows. A direction p in the camera's
frame (x ahead, y left, z up) lies at (-y/x, z/x) of the picture. The camera that is turned by ``E = exp(e)`` from the
wanted attitude sees as ``Eᵀ p`` what the wanted one sees as p.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from math import degrees, floor, log10, radians, tan
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.result import Pointing, Verified, split
from gimbal_pin.report.elements import template
from gimbal_pin.report.format import controller_name

if TYPE_CHECKING:
    from gimbal_pin.report.view.three import Json

SHOWN_SECONDS, RATE = 6.0, 60.0
"""Length of the stretch that is shown, s, and its frames per second: a few hundred of them."""
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
class Shot:
    """What one camera saw.

    Attributes:
        controller: Who held it; None: it was bolted to the platform.
        turned: ``log(R_dᵀ R)`` at each frame, in the camera's frame, rad, (F, 3).
        shaken: The line of sight's part above 0.2 Hz about the camera's y and z, which is what jitter counts, rad,
            (F, 2).
        jitter: Of the whole run, rad rms.
    """

    controller: str | None
    turned: Array
    shaken: Array
    jitter: float

    @property
    def called(self) -> str:
        """What its controller is called."""
        return controller_name(str(self.controller))


@dataclass(frozen=True, eq=False)
class Outlook:
    """Several cameras on the same stretch of the same motion.

    Attributes:
        t: Time of each frame, s, (F,).
        bolted: The camera that the platform carries along.
        held: Those that a gimbal holds, the PID before computed torque.
    """

    t: Array
    bolted: Shot
    held: tuple[Shot, ...]


def outlook(
    found: Verified, wanted: Array, seconds: float = SHOWN_SECONDS, rate: float = RATE
) -> Outlook:
    """Return what the cameras of the first seed saw, where the platform swings most.

    Args:
        found: The runs.
        wanted: R_d, the attitude that the cameras should keep, (3, 3).
        seconds: Length of the stretch, s; a run may be shorter.
        rate: Frames per second, at most those of the run.
    """
    runs = [row.runs[0] for row in found.rows if row.controller in (BASELINE, OURS)]
    # log(R_dᵀ R_p R_d) of a camera that looks as wanted from level ground
    base = Rotation.from_quat(runs[0].base[runs[0].counted], scalar_first=True).as_matrix()
    swing = np.array([pin.log3(turn) for turn in wanted.T @ base @ wanted])
    first, last = liveliest(swing, round(seconds / runs[0].dt))
    places = np.arange(first, last, max(1, round(1 / rate / runs[0].dt)))

    def shoot(run: Pointing, controller: str | None, turned: Array) -> Shot:
        fast, _ = split(turned[:, 1:], run.dt)
        jitter = float(np.sqrt(np.mean(np.sum(fast**2, axis=1))))
        return Shot(controller, turned[places], fast[places], jitter)

    held = tuple(shoot(run, run.controller, run.error[run.counted]) for run in runs)
    return Outlook(runs[0].t[runs[0].counted][places], shoot(runs[0], None, swing), held)


def liveliest(swing: Array, length: int) -> tuple[int, int]:
    """Return first and end of the `length` samples, or of all, in which the swing is largest, rms."""
    power = np.concatenate([[0.0], np.cumsum(np.sum(swing**2, axis=1))])
    length = min(length, len(swing))
    first = int(np.argmax(power[length:] - power[: len(power) - length]))
    return first, first + length


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

    def to_dict(self) -> Json:
        """Return what the page shows and its script draws from."""
        turned = np.round(self.turned, 8 if self.long else 5).tolist()
        return {**vars(self), "scale": f"{degrees(self.rings[0]):.6g}°", "turned": turned}


def build_pictures(seen: Outlook) -> tuple[Picture, ...]:
    """Return the bolted camera and ours through a wide lens, then all that were held through one long lens.

    Below a wide picture stands how far the line of sight strays, drift and roll included. The long lens's scale is a
    round angle of which the largest jitter of what was held is about two.
    """
    wide = []
    for one in (seen.bolted, seen.held[-1]):
        title = "Bolted to the platform" if one.controller is None else f"Held by {one.called}"
        away = float(np.degrees(np.hypot(*one.turned[:, 1:].T).max()))
        note = f"the line of sight strays up to {away:.{1 if away > 1 else 3}f}°"
        note += "" if one.controller is None else ", drift included"
        wide.append(Picture(title, note, WIDE_TANGENT, one.turned, RINGS, False))
    largest = max(degrees(float(np.hypot(*one.shaken.T).max())) for one in seen.held) or 1e-6
    decade = 10.0 ** floor(log10(largest / 2))
    step = radians(
        min((k * decade for k in (1, 2, 5, 10)), key=lambda step: abs(np.log(2 * step / largest)))
    )
    long = []
    for one in seen.held:
        title = f"{one.called[:1].upper()}{one.called[1:]}, long lens"
        note = f"jitter {degrees(one.jitter):.4f}° rms"
        shaken = np.column_stack([np.zeros(len(seen.t)), one.shaken])
        long.append(Picture(title, note, 2.6 * step, shaken, (step, 2 * step), True))
    return (*wide, *long)


def scenery(wanted: Array) -> tuple[Array, Array, Array]:
    """Return what there is to see around a camera of attitude R_d in the world, (3, 3), in that camera's frame.

    Away from the earth, (3,); pieces of a grid on the ground, one camera's height under it, from point to point,
    (K, 2, 3); the skyline from left to right, (H, 3).
    """
    heading = float(np.arctan2(wanted[1, 0], wanted[0, 0]))
    level = np.array(
        [[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]]
    )
    own = wanted.T @ level
    along = [
        [(-2.0, y, -1.0), (GRID_AHEAD, y, -1.0)] for y in np.arange(-GRID_ASIDE, GRID_ASIDE + 0.1)
    ]
    across = [
        [(x, -GRID_ASIDE, -1.0), (x, GRID_ASIDE, -1.0)] for x in np.arange(-2.0, GRID_AHEAD + 0.1)
    ]
    azimuth = np.deg2rad(np.arange(-90.0, 91.0, 2.0))[::-1]
    size, waves, phase = SKYLINE.T
    elevation = np.deg2rad(1.6 + np.sin(np.outer(azimuth, waves) + phase) @ size)
    hills = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.tan(np.maximum(elevation, 0.0))])
    return own[:, 2], np.array([*along, *across]) @ own.T, hills @ own.T


def draw_pictures(seen: Outlook, wanted: Array, count: int | None = None) -> Json:
    """Return what the page's script draws: the first `count` pictures, or all, and what there is to see in them."""
    up, lines, hills = scenery(wanted)
    return {
        "t": np.round(seen.t, 4).tolist(),
        "up": up.tolist(),
        "lines": np.round(lines, 4).reshape(-1, 6).tolist(),
        "hills": np.round(hills, 4).tolist(),
        "near": NEAREST_DRAWN,
        "pictures": [one.to_dict() for one in build_pictures(seen)[:count]],
    }


def script() -> str:
    """Return the function that draws pictures from what `draw_pictures` returns."""
    return files("gimbal_pin.report.view").joinpath("gaze.js").read_text(encoding="utf-8")


def render_gaze(seen: Outlook, wanted: Array) -> str:
    """Return a page that plays what the cameras saw, with a control, and needs nothing but a browser.

    `wanted`: R_d, (3, 3).
    """
    drawn = draw_pictures(seen, wanted)
    return template("gimbal_pin.report.view", "gaze.html.j2", script=script(), data=drawn)
