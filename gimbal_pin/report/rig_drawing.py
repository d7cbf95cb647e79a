"""The rig as a drawing, with the joints in question and how far to slide the payload, beside what was decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from gimbal_pin.effects.rig_effect import describe_way, find_camera_axes, get_payload
from gimbal_pin.log.log import Array
from gimbal_pin.report import VIEWS, plots
from gimbal_pin.report.elements import join
from gimbal_pin.report.format import list_shown_joints, listed
from gimbal_pin.report.view.motion import poses
from gimbal_pin.report.view.solids import Solid, stand_ins, visuals
from gimbal_pin.rig.rig import Rig

if TYPE_CHECKING:
    from gimbal_pin.identification import Balance


@dataclass(frozen=True, eq=False)
class RigDrawing:
    """A rig at its home pose, drawn when a page shows it; a terminal shows what stands beside it alone.

    Attributes:
        rig: The rig.
        joints: Those in question, whose axes are drawn.
        balance: How to balance the payload, an arrow; None where nothing is known of it.
        beside: What stands to the left of the drawing, as a section's parts.
    """

    rig: Rig
    joints: Sequence[str]
    balance: Balance | None
    beside: Sequence[object]

    @property
    def way(self) -> Array:
        """Displacement that balances the payload, forward, left and up, m, (3,); zero where it is not known."""
        if self.balance is None:
            return np.zeros(3)
        return np.where(np.abs(self.balance.way) > 2 * self.balance.std, self.balance.way, 0.0)

    def __html__(self) -> str:
        """Return it as an element of a page."""
        said = [f"in question: {listed(self.joints)}"] if self.joints else []
        said += (
            [f"to balance: {describe_way(1e-5 * np.round(1e5 * self.way))}"]
            if self.way.any()
            else []
        )
        svg = plots.drawn(
            partial(draw_rig, self.rig, self.joints, self.way),
            ": ".join([f"Drawing of {self.rig.title}", *said]),
        )
        html = Markup(
            '<div class="first"><div>{}</div><figure class="rig"><div class="plot">{}</div><figcaption>{}</figcaption>'
            "</figure></div>"
        )
        return html.format(join(self.beside), svg, "; ".join(said))

    def __str__(self) -> str:
        """Return the lines of what stands beside it."""
        return "\n".join(str(one) for one in self.beside if not isinstance(one, Markup))


def draw_rig(rig: Rig, joints: Sequence[str], way: Array) -> plots.Figure:
    """Draw outlines of the rig's solids, the axes of joints in their colours, and an arrow along `way`, (3,)."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    world = poses(rig.model, np.zeros((1, rig.n))).world[0]
    around, elevation, _ = (np.deg2rad(x) for x in VIEWS["three-quarter"])
    back = np.array(
        [np.cos(elevation) * np.cos(around), np.cos(elevation) * np.sin(around), np.sin(elevation)]
    )
    right = np.array([-np.sin(around), np.cos(around), 0.0])
    eye = np.array([right, np.cross(back, right), back])
    shown = [
        (
            solid,
            (trace_solid(solid) @ world[solid.joint, :3, :3].T + world[solid.joint, :3, 3]) @ eye.T,
        )
        for solid in visuals(rig)[0] or stand_ins(rig)
    ]
    every = np.vstack([points for _, points in shown])
    size = float(np.ptp(every[:, :2], axis=0).max())
    figure = Figure(figsize=(3.4, 2.9))
    axes = figure.add_axes((0, 0, 1, 1))
    for solid, points in sorted(shown, key=lambda one: float(one[1][:, 2].mean())):
        flat = points[:, :2] + 1e-9 * size * np.random.default_rng(0).standard_normal(
            (len(points), 2)
        )
        outline = flat[ConvexHull(flat).vertices]
        axes.add_patch(
            Polygon(outline, facecolor=solid.rgba[:3], alpha=0.55, edgecolor=plots.MUTED, lw=0.7)
        )
    for k, joint in enumerate(list_shown_joints(rig), start=1):
        if joint.name in joints:
            axis = world[k, :3, :3] @ np.ravel(rig.model.joints[k].createData().S).reshape(
                2, 3
            ).sum(axis=0)
            ends = (world[k, :3, 3] + np.outer((-0.3, 0.3), size * axis)) @ eye.T
            axes.plot(*ends[:, :2].T, color=joint.colour, lw=2.2, ls=(0, (5, 2)), zorder=3)
            far = max(
                ends, key=lambda end: float(np.linalg.norm(end[:2] - every[:, :2].mean(axis=0)))
            )
            looks: Any = {"color": joint.colour, "weight": "bold", "fontsize": 12, "zorder": 4}
            axes.annotate(joint.name, far[:2], (4, 2), textcoords="offset points", **looks)
    if way.any():
        body, inertia, _ = get_payload(rig)
        start = world[body + 1, :3, :3] @ inertia.lever + world[body + 1, :3, 3]
        toward = world[body + 1, :3, :3] @ find_camera_axes(rig) @ way
        ends = np.array([start, start + 0.45 * size * toward / np.linalg.norm(toward)]) @ eye.T
        axes.plot(*ends[0, :2], "o", color=plots.INK, ms=5, zorder=5)
        arrow = {"arrowstyle": "-|>", "lw": 2.4, "color": plots.INK, "mutation_scale": 18}
        axes.annotate("", ends[1, :2], ends[0, :2], arrowprops=arrow, zorder=5)
        axes.plot(*ends[1, :2], alpha=0)
    axes.set(aspect="equal")
    axes.margins(0.1)
    axes.axis("off")
    return figure


def trace_solid(solid: Solid) -> Array:
    """Return points of a solid's surface whose hull is the solid's, in the frame of its joint, m, (K, 3)."""
    geometry = solid.shape.geometry
    if geometry["type"] not in ("CylinderGeometry", "SphereGeometry"):
        return solid.corners
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.zeros(24), np.sin(angle)])
    if geometry["type"] == "CylinderGeometry":
        points = np.vstack(
            [geometry["radiusTop"] * ring + [0, y * geometry["height"] / 2, 0] for y in (-1, 1)]
        )
    else:
        points = geometry["radius"] * np.vstack([ring, ring[:, [1, 0, 2]], ring[:, [0, 2, 1]]])
    return points @ solid.placement[:3, :3].T + solid.placement[:3, 3]
