"""Torque measured against predicted, and what is left."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gimbal_pin import signals
from gimbal_pin.identify import Identified
from gimbal_pin.log import Array
from gimbal_pin.report import plots
from gimbal_pin.report.base import Section
from gimbal_pin.report.evaluation import Evaluated, Part
from gimbal_pin.report.html import Content, heading, join, paragraph, picture, table, toned
from gimbal_pin.report.joints import Joint, joints_of
from gimbal_pin.report.numbers import figures, file_name, percent, rows_named, torque_unit
from gimbal_pin.report.sections.residual import leftovers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOW = 15.0
"""Longest stretch drawn in full, s."""
GOOD, FAIR = 95.0, 80.0
"""Fit, per cent, from which on a model is called good, or fair."""


def torque(found: Identified, evaluated: Evaluated) -> Section:
    """Return the fit's figures, the torques over time, and the residual over time, over rate and as a histogram."""
    joints = joints_of(found.model.rig)
    held = found.held_out is not None
    unit = error_unit(found)[1]
    where = f"on {rows_named(evaluated.how)}, which the fit did not see" if held else "on the rows that were fitted"
    window, whole = worst(evaluated)
    shown = "the stretch with the largest error" if whole else "all of it"
    alt = f"Measured and predicted torque and residual of {', '.join(evaluated.joints)} over time"
    caption = (
        f"Filtered torque {where}: measured (grey) and predicted (colour), the residual below. "
        f"{file_name(window.log)}, {window.t[0]:.4g} to {window.t[-1]:.4g} s: {shown}."
    )
    parts = [
        paragraph(f"Everything below is filtered at {found.filtering.cutoff:g} Hz, measured and predicted alike."),
        table(
            head(held, unit), [row(found, evaluated, j, joint) for j, joint in enumerate(joints)], label="Torque error"
        ),
        picture(plots.drawn(partial(overlays, joints, window), alt), caption),
        heading("What is left"),
        picture(*leftovers(joints, evaluated)),
    ]
    return Section("Torque", join(parts), f"Measured against predicted, {where}.")


def error_unit(found: Identified) -> tuple[float, str]:
    """Return scale and unit of the errors."""
    return torque_unit(max((found.held_out or found.train).torque_rmse.values()))


def head(held: bool, unit: str) -> list[Content]:
    """Return the headings of the table of errors."""
    names: list[Content] = ["Joint", "Torque, N m rms", f"Error, {unit} rms", "Error, share of torque", "Fit"]
    return [*names, f"Largest error, {unit}", *([f"Training error, {unit} rms", "Training fit"] if held else [])]


def row(found: Identified, evaluated: Evaluated, j: int, joint: Joint) -> list[Content]:
    """Return a joint's row of the table of errors."""
    accuracy = found.held_out or found.train
    rmse, fit = accuracy.torque_rmse[joint.name], accuracy.fit_percent[joint.name]
    share, scale = rmse / max(float(evaluated.torque_rms[j]), 1e-300), error_unit(found)[0]
    cells: list[Content] = [
        joint.label,
        figures(float(evaluated.torque_rms[j])),
        figures(scale * rmse),
        f"{figures(100 * share, 2)} %",
        toned(f"{percent(fit)} %", grade(fit)),
        figures(scale * float(np.abs(evaluated.stacked("error")[:, j]).max())),
    ]
    if found.held_out is not None:
        train = found.train
        cells += [figures(scale * train.torque_rmse[joint.name]), f"{percent(train.fit_percent[joint.name])} %"]
    return cells


def grade(fit: float) -> str:
    """Return the tone of a fit percentage."""
    return "good" if fit >= GOOD else "fair" if fit >= FAIR else "poor"


def worst(evaluated: Evaluated) -> tuple[Part, bool]:
    """Return the stretch of at most `WINDOW` s whose error, as a share of torque, is largest, and if there is more."""
    scale = np.maximum(evaluated.torque_rms, 1e-300)
    best: tuple[float, Part] | None = None
    for part in evaluated.parts:
        power = np.concatenate([[0.0], np.cumsum(np.sum((part.error / scale) ** 2, axis=1))])
        ends = np.searchsorted(part.t, part.t + WINDOW)
        score = (power[ends] - power[:-1]) / np.maximum(ends - np.arange(len(ends)), 1)
        full = part.t <= max(part.t[-1] - WINDOW, part.t[0])
        first = int(np.argmax(np.where(full, score, -np.inf)))
        if best is None or score[first] > best[0]:
            cut = slice(first, int(ends[first]))
            best = score[first], Part(part.log, *(x[cut] for x in (part.t, part.v, part.measured, part.predicted)))
    assert best is not None  # an evaluation has at least one part
    return best[1], len(evaluated.parts) > 1 or len(best[1].t) < len(evaluated.parts[0].t)


def broken(t: Array, values: Array) -> Array:
    """Return the values with nan at the first sample after each gap, so that no line is drawn across it."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > 2.5 * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    out = values.copy()
    out[gaps] = np.nan
    return out


def rounded(t: Array, values: Array, between: int = 4) -> tuple[Array, Array]:
    """Return a curve through the rows, which are as far apart as the filter allows, without corners; broken at gaps."""
    fine = np.interp(np.arange((len(t) - 1) * between + 1) / between, np.arange(len(t)), t)
    smooth = signals.resample(t, values[:, None], fine)[:, 0] if len(t) > 2 else values
    holes = np.repeat(np.isnan(broken(t, values))[1:], between)
    smooth[1:][holes] = np.nan
    return fine, smooth


def overlays(joints: tuple[Joint, ...], part: Part) -> Figure:
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
        for axes, values, colour, width in (*drawn, (below, scale * part.error, joint.colour, 1.0)):
            plots.curve(axes, *rounded(part.t, values[:, j]), color=colour, lw=width, alpha=0.6 if width > 2 else 1.0)
        plots.zero_line(below)
        plots.named(above, [(f"{joint.name}: measured", plots.PLAIN), ("predicted", joint.colour)])
        above.set(ylabel="torque, N m")
        below.set(ylabel=f"residual,\n{unit}")
    panels[-1].set(xlabel="time, s", xlim=(part.t[0], part.t[-1]))
    figure.align_ylabels()
    return figure
