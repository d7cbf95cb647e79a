"""Torque measured against predicted, and what is left."""

from __future__ import annotations

from functools import partial
from math import nan

import numpy as np

from gimbal_pin.estimation.identification import Identified
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.evaluation import Evaluated
from gimbal_pin.report.pages.html import Content, heading, join, paragraph, table, toned
from gimbal_pin.report.pages.joints import Joint, joints_of
from gimbal_pin.report.pages.numbers import figures, file_name, percent, rows_named, torque_unit
from gimbal_pin.report.pages.sections.overlay import overlays, worst
from gimbal_pin.report.pages.sections.residual import leftovers

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
        "Shaded: so slow that dry friction may have any direction; not judged. "
        f"{file_name(window.log)}, {window.t[0]:.4g} to {window.t[-1]:.4g} s: {shown}."
    )
    parts = [
        paragraph(
            f"Everything below is filtered at {found.filtering.cutoff:g} Hz, measured and predicted alike. A joint is "
            "judged where it moves: near standstill dry friction bears any torque, and motion does not tell which."
        ),
        table(
            head(held, unit), [row(found, evaluated, j, joint) for j, joint in enumerate(joints)], label="Torque error"
        ),
        plots.picture(partial(overlays, joints, window), alt, caption),
        heading("What is left"),
        leftovers(joints, evaluated),
    ]
    return Section("Torque", join(parts), f"Measured against predicted, {where}.")


def error_unit(found: Identified) -> tuple[float, str]:
    """Return scale and unit of the errors."""
    return torque_unit(max((found.held_out or found.train).torque_rmse.values()))


def head(held: bool, unit: str) -> list[Content]:
    """Return the headings of the table of errors."""
    names: list[Content] = ["Joint", "Torque, N m rms", f"Error, {unit} rms", "Share of torque", "Fit", "Judged"]
    return [*names, f"Largest error, {unit}", *([f"Training error, {unit} rms", "Training fit"] if held else [])]


def row(found: Identified, evaluated: Evaluated, j: int, joint: Joint) -> list[Content]:
    """Return a joint's row of the table of errors."""
    accuracy = found.held_out or found.train
    rmse, fit = accuracy.torque_rmse[joint.name], accuracy.fit_percent[joint.name]
    torque, scale = float(evaluated.torque_rms[j]), error_unit(found)[0]
    share = rmse / torque if torque else nan  # nothing drove this joint
    cells: list[Content] = [
        joint.label,
        figures(torque),
        figures(scale * rmse),
        f"{figures(100 * share, 2)} %",
        toned(f"{percent(fit)} %", grade(fit)),
        f"{100 * accuracy.used[joint.name]:.0f} %",
        figures(scale * float(np.abs(evaluated.stacked("error")[:, j]).max())),
    ]
    if found.held_out is not None:
        train = found.train
        cells += [figures(scale * train.torque_rmse[joint.name]), f"{percent(train.fit_percent[joint.name])} %"]
    return cells


def grade(fit: float) -> str:
    """Return the tone of a fit percentage."""
    return "good" if fit >= GOOD else "fair" if fit >= FAIR else "poor"
