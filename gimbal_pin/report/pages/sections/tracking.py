"""Step tracking: every controller on the same steps, all axes together and one at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite, isnan
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.tracking import Experiment, StepMetrics, Tracking
from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, heading, join, paragraph, table
from gimbal_pin.report.pages.joints import Joint, joints_of
from gimbal_pin.report.pages.numbers import DASH, DEGREE, figures, listed
from gimbal_pin.report.pages.sections.crosstalk import cross_picture, cross_table
from gimbal_pin.report.pages.sections.experiments import BASELINE, TOGETHER, chosen, controller_looks, marked, names
from gimbal_pin.report.view.names import controller_name
from gimbal_pin.rig.rig import Rig

LEAST = 1e-3 / DEGREE
"""Smallest difference of a steady-state error that is called one, rad: a sensor's noise makes as much."""

BESIDE = (plots.PLAIN, plots.MUTED, "#8a4fd0", "#0b96a8")
"""Colours of the controllers that stand beside the one in the joint's colour."""
CROWDED = 3
"""Controllers from which their names do not fit above one column."""


class Column(NamedTuple):
    """A figure of the table; the smaller is the better, if it differs by more than `least` and a twentieth."""

    title: str
    value: Callable[[StepMetrics], float]
    text: Callable[[Joint, float], str]
    least: float


COLUMNS = (
    Column("RMS error", lambda m: m.rms_error, lambda joint, x: joint.text(x), 0.0),
    Column("Peak error", lambda m: m.peak_error, lambda joint, x: joint.text(x), 0.0),
    Column("Overshoot", lambda m: m.overshoot_percent, lambda _, x: f"{figures(x, 2)} %", 0.05),
    Column("Settling, s", lambda m: m.settling_time, lambda _, x: figures(x), 0.02),
    Column("Steady state", lambda m: abs(m.steady_state_error), lambda joint, x: joint.text(x, digits=2), LEAST),
    Column("At torque limit", lambda m: 100 * m.saturated, lambda _, x: f"{figures(x, 2)} %", 0.5),
)


def tracking(result: Tracking, rig: Rig, plant: str = "") -> Section:
    """Return the step responses, their figures with the better ones marked, and what moving one axis does to others.

    `plant`: what was simulated, within a sentence.
    """
    # The baseline is drawn in grey, behind the others.
    result = replace(result, experiments=tuple(sorted(result.experiments, key=lambda e: e.controller != BASELINE)))
    joints = joints_of(rig)
    steps = listed(f"{joint.text(result.steps[joint.name])} of {joint.name}" for joint in joints)
    note = f" The plant is {plant}, with the rig's sensors, delay and torque limits." if plant else ""
    parts = [paragraph(f"Minimum-jerk steps of {steps}.{note}")]
    together = chosen(result, TOGETHER)
    if together:
        parts += [heading("All axes together"), metrics_table(joints, together), responses(rig, together)]
    singles = [name for name in names(result) if name != TOGETHER]
    if singles:
        alone = [experiment for name in singles for experiment in chosen(result, name)]
        parts += [heading("One axis at a time"), metrics_table(joints, alone), cross_table(rig, result, singles)]
        parts.append(cross_picture(rig, result, singles))
    lead = "Every controller meets the same steps and the same sensor noise; what is clearly better is marked."
    return Section("Tracking", join(parts), lead)


def metrics_table(joints: Sequence[Joint], experiments: Sequence[Experiment]) -> Markup:
    """Return the metrics of the joints that move, controllers below each other, the better of them marked."""
    head: list[Content] = ["Joint", "Controller", *(column.title for column in COLUMNS)]
    rows = [
        row(joint, experiment, [rival for rival in experiments if rival.name == experiment.name])
        for joint in joints
        for experiment in experiments
        if not isnan(experiment.joints[joint.name].overshoot_percent)
    ]
    return table(head, rows, texts=2, label="Step tracking")


def row(joint: Joint, experiment: Experiment, rivals: Sequence[Experiment]) -> list[Content]:
    """Return one joint's row under one controller."""
    cells: list[Content] = [joint.label, controller_name(experiment.controller)]
    for column in COLUMNS:
        own = column.value(experiment.joints[joint.name])
        every = [column.value(rival.joints[joint.name]) for rival in rivals]
        cells.append(marked(DASH if isnan(own) else column.text(joint, own), own, every, column.least))
    return cells


def responses(rig: Rig, experiments: Sequence[Experiment]) -> Markup:
    """Return the picture of the steps."""
    controllers = listed(map(controller_name, controller_looks(experiments)))
    alt = f"Step responses of {', '.join(rig.joints)}: angle, error and torque, for {controllers}"
    caption = "Reference (dashed) and angle, the error, and the torque as a share of its limit."
    return plots.picture(partial(steps_figure, rig, experiments), alt, caption)


def shade(k: int, count: int, joint: Joint) -> tuple[str, float]:
    """Return colour and width of the k-th of several controllers: the last has the joint's colour."""
    return (joint.colour, 1.6) if k == count - 1 else (BESIDE[k % len(BESIDE)], 2.2)


def steps_figure(rig: Rig, experiments: Sequence[Experiment]) -> plots.Figure:
    """Draw angle, error and torque of every joint, one column each."""
    joints = joints_of(rig)
    figure, panels = plots.panels(3, len(joints), 6.6, ratios=[1.5, 1.2, 1], gaps=(0.85, 0.33), share=(True, False))
    for j, joint in enumerate(joints):
        for k, experiment in enumerate(experiments):
            colour, width = shade(k, len(experiments), joint)
            step_column(panels[:, j], rig, j, joint, experiment, colour, width)
        column_labels(panels[:, j], rig, j, joint, experiments)
    figure.align_ylabels()
    return figure


def step_column(
    panels: Array, rig: Rig, j: int, joint: Joint, experiment: Experiment, colour: str, width: float
) -> None:
    """Draw one controller's curves of one joint."""
    log = experiment.log
    t, wanted, tau = log.t, np.asarray(log.q_ref)[:, j], np.asarray(log.tau)[:, j]
    limit = float(rig.tau_max[j])
    plots.curve(panels[0], t, joint.scale * experiment.q[:, j], color=colour, lw=width)
    plots.curve(panels[1], t, joint.scale * (wanted - experiment.q[:, j]), color=colour, lw=width)
    plots.curve(panels[2], t, 100 * tau / limit if isfinite(limit) else tau, color=colour, lw=0.8 * width)


def column_labels(panels: Array, rig: Rig, j: int, joint: Joint, experiments: Sequence[Experiment]) -> None:
    """Draw the reference and label one joint's panels."""
    log, count = experiments[0].log, len(experiments)
    plots.curve(panels[0], log.t, joint.scale * np.asarray(log.q_ref)[:, j], color=plots.INK, lw=1.0, ls=(0, (4, 3)))
    for axes in panels[1:]:
        plots.zero_line(axes)
    limited = isfinite(rig.tau_max[j])
    panels[0].set_title(joint.name, color=joint.colour)
    panels[0].set_ylabel(f"position, {joint.unit}")
    panels[1].set_ylabel(f"error, {joint.unit}")
    panels[2].set_ylabel("torque, % of limit" if limited else "torque, N m")
    panels[2].set(xlabel="time, s", xlim=(log.t[0], log.t[-1]))
    shades = [shade(k, count, joint)[0] for k in range(count)]
    names = [controller_name(experiment.controller) for experiment in experiments]
    if count < CROWDED:
        plots.named(panels[1], list(zip(names, shades)))
    elif panels[0].get_subplotspec().is_first_col():  # one legend for all columns: each has its own colour for the last
        plots.named(panels[1], list(zip([*names[:-1], f"in colour: {names[-1]}"], shades)))
