"""What the cameras see on a platform that moves: played, and as one long exposure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array
from gimbal_pin.pointing.outlook import Outlook
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.html import join
from gimbal_pin.report.pages.numbers import figures, listed
from gimbal_pin.report.view import gaze
from gimbal_pin.report.view.gaze import ASPECT, Picture, Scenery
from gimbal_pin.report.view.names import controller_name

EXPOSURES = 14
"""Moments that a wide picture shows on top of each other."""
MARGIN = 1.08
"""Picture over what is in it."""
RED = "#d8321f"


def gazes(seen: Outlook, wanted: Array) -> Markup:
    """Return the cameras' pictures as an animation, and on top of each other as a still that can be printed."""
    several = gaze.pictures(seen)
    page = gaze.page(seen, wanted)
    played = Markup('<div class="animation"><iframe class="gaze" title="{}" srcdoc="{}"></iframe></div>').format(
        "What the cameras see", page
    )
    alt = "Pictures of the cameras on top of each other. " + "; ".join(f"{one.title}: {one.note}" for one in several)
    held = listed(controller_name(str(one.controller)) for one in seen.held)
    caption = (
        f"The same {figures(float(np.ptp(seen.t)), 2)} s as one long exposure. Above, {EXPOSURES} moments of a camera "
        "that the platform carries along and of the one that is held: horizon, hills and target. Below, the way of the "
        f"line of sight through a long lens for {held}, to one scale; what is slower than 0.2 Hz, the gyros' drift, is "
        "left out there. All that is seen is far away, so that only the camera's turning shows."
    )
    return join([played, plots.picture(partial(exposed, several, gaze.scenery(wanted)), alt, caption)])


def exposed(several: Sequence[Picture], world: Scenery) -> plots.Figure:
    """Draw the pictures on top of each other, the wide ones above, those through a long lens below."""
    columns = max(2, len(several) - 2)
    figure, panels = plots.panels(2, columns, 7.2, gaps=(0.75, 0.55), left=0.75)
    for axes in panels.flat[len(several) :]:
        axes.set_axis_off()
    across = max((reach(one) for one in several if one.long), default=0.0)
    for axes, one in zip([*panels[0, :2], *panels[1]], several):
        long_exposure(axes, one, across) if one.long else wide_exposure(axes, one, world)
        axes.set_title(one.title)
    return figure


def wide_exposure(axes: plots.Axes, one: Picture, world: Scenery) -> None:
    """Draw some moments of a wide picture: skyline, horizon, target."""
    across, moments = one.half, np.linspace(0, len(one.turned) - 1, EXPOSURES).astype(int)
    axes.set(xlim=(-across, across), ylim=(-across / ASPECT, across / ASPECT), xticks=[], yticks=[], aspect="equal")
    for turned in one.turned[moments]:
        hills, edge = gaze.placed(world.hills, turned), gaze.placed(horizon(world), turned)
        axes.plot(*hills.T, color=plots.MUTED, lw=0.9, alpha=0.4)
        axes.plot(*edge.T, color=plots.INK, lw=0.9, alpha=0.55)
        (centre,) = gaze.placed(np.array([[1.0, 0.0, 0.0]]), turned)
        for ring in one.rings:
            axes.plot(*circle(centre, np.tan(ring)).T, color=RED, lw=0.9, alpha=0.6)
    axes.plot(0, 0, "+", color=plots.INK, ms=14, mew=1.2)
    axes.grid(False)
    axes.spines[:].set_visible(True)


def way(one: Picture) -> Array:
    """Return the way of the line of sight over the target, degrees, (N, 2)."""
    return np.degrees(np.arctan([gaze.placed(np.array([[1.0, 0.0, 0.0]]), turned)[0] for turned in one.turned]))


def reach(one: Picture) -> float:
    """Half of what a picture has to hold across, degrees: what the lens does, or more where the sight leaves that."""
    return max(float(np.degrees(np.arctan(one.half))), MARGIN * float(np.abs(way(one) * [1.0, ASPECT]).max()))


def long_exposure(axes: plots.Axes, one: Picture, across: float) -> None:
    """Draw the way of the line of sight over the target, `across` degrees to either side."""
    for ring in one.rings:
        axes.plot(*circle(np.zeros(2), np.degrees(ring)).T, color=RED, lw=0.9, alpha=0.6)
    axes.plot(*way(one).T, color=plots.INK, lw=0.8)
    axes.set(xlim=(-across, across), ylim=(-across / ASPECT, across / ASPECT), aspect="equal")
    axes.set(xlabel="degrees", ylabel="degrees")


def circle(centre: Array, radius: float) -> Array:
    """Return points on a circle, (K, 2)."""
    angle = np.linspace(0, 2 * np.pi, 49)
    return np.asarray(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def horizon(world: Scenery) -> Array:
    """Return directions on the horizon from left to right, (K, 3): the skyline without its height."""
    return np.asarray(world.hills - np.outer(world.hills @ world.up, world.up))
