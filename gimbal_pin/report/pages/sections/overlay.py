"""Torque measured and predicted over time, where the model does worst."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gimbal_pin.log import signals
from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.evaluation import Evaluated, Part
from gimbal_pin.report.pages.joints import Joint
from gimbal_pin.report.pages.numbers import torque_unit
from gimbal_pin.report.pages.sections.residual import JUDGED

Flags = NDArray[np.bool_]

WINDOW = 15.0
"""Longest stretch drawn in full, s."""
BETWEEN = 4
"""Pieces that a curve is drawn in from row to row."""


def worst(evaluated: Evaluated) -> tuple[Part, bool]:
    """Return the stretch of at most `WINDOW` s whose error, as a share of torque, is largest, and if there is more."""
    best: tuple[float, Part] | None = None
    for part in evaluated.parts:
        power = np.concatenate([[0.0], np.cumsum(np.sum((part.error / evaluated.scale) ** 2, axis=1))])
        ends = np.searchsorted(part.t, part.t + WINDOW)
        score = (power[ends] - power[:-1]) / np.maximum(ends - np.arange(len(ends)), 1)
        full = part.t <= max(part.t[-1] - WINDOW, part.t[0])
        first = int(np.argmax(np.where(full, score, -np.inf)))
        if best is None or score[first] > best[0]:
            cut = slice(first, int(ends[first]))
            best = score[first], part.cut(cut)
    assert best is not None  # an evaluation has at least one part
    return best[1], len(evaluated.parts) > 1 or len(best[1].t) < len(evaluated.parts[0].t)


def broken(t: Array, values: Array) -> Array:
    """Return the values with nan at the first sample after each gap, so that no line is drawn across it."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > 2.5 * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    out = values.copy()
    out[gaps] = np.nan
    return out


def rounded(t: Array, values: Array) -> tuple[Array, Array]:
    """Return a curve through the rows, which are as far apart as the filter allows, without corners; broken at gaps."""
    fine = np.interp(np.arange((len(t) - 1) * BETWEEN + 1) / BETWEEN, np.arange(len(t)), t)
    smooth = signals.resample(t, values[:, None], fine)[:, 0] if len(t) > 2 else values
    holes = np.repeat(np.isnan(broken(t, values))[1:], BETWEEN)
    smooth[1:][holes] = np.nan
    return fine, smooth


def overlays(joints: tuple[Joint, ...], part: Part) -> plots.Figure:
    """Draw each joint's torques, and its residual below."""
    count, ratios = len(joints), [0.35, 3, 1.2] * len(joints)
    looks: Any = dict(ratios=ratios, gaps=(0, 0.1), share=(True, False), left=1.05)
    figure, grid = plots.panels(3 * count, 1, 0.6 + 2.2 * count, **looks)
    panels = grid[:, 0]
    for j, joint in enumerate(joints):
        room, above, below = panels[3 * j : 3 * j + 3]
        room.remove()  # the legend's place
        scale, unit = torque_unit(float(np.abs(part.error[:, j]).max()))
        drawn = ((above, part.measured, plots.PLAIN, 4.0), (above, part.predicted, joint.colour, 1.3))
        left = np.where(part.share < JUDGED, np.nan, scale * part.error)
        for axes, values, colour, width in (*drawn, (below, left, joint.colour, 1.0)):
            plots.curve(axes, *rounded(part.t, values[:, j]), color=colour, lw=width, alpha=0.6 if width > 2 else 1.0)
        for axes in (above, below):
            shade(axes, part.t, part.share[:, j] < JUDGED)
        plots.zero_line(below)
        plots.named(above, [(f"{joint.name}: measured", plots.PLAIN), ("predicted", joint.colour)])
        above.set(ylabel="torque, N m")
        below.set(ylabel=f"residual,\n{unit}")
    panels[-1].set(xlabel="time, s", xlim=(part.t[0], part.t[-1]))
    figure.align_ylabels()
    return figure


def shade(axes: plots.Axes, t: Array, still: Flags) -> None:
    """Shade the stretches of time in which a joint is near standstill."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    for first, last in edges.reshape(-1, 2).tolist():
        axes.axvspan(t[max(first - 1, 0)], t[min(last, len(t) - 1)], color=plots.MUTED, alpha=0.13, zorder=0)
