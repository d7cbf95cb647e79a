"""What moving one axis does to the others."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.tracking import Experiment, Tracking
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.html import table
from gimbal_pin.report.pages.joints import Joint, joints_of, units
from gimbal_pin.report.pages.numbers import DASH
from gimbal_pin.report.pages.sections.experiments import chosen, controller_looks, marked
from gimbal_pin.report.view.names import controller_name
from gimbal_pin.rig.rig import Rig


def cross_table(rig: Rig, result: Tracking, singles: Sequence[str]) -> Markup:
    """Return the largest error of the axes that should stay, per axis that moves and controller."""
    looks = {joint.name: joint for joint in joints_of(rig)}
    controllers = list(dict.fromkeys(experiment.controller for experiment in result.experiments))
    rows = []
    for name in singles:
        peaks = {e.controller: e.cross_axis_peak for e in chosen(result, name)}
        texts = [
            marked(looks[name].text(peaks[c]), peaks[c], list(peaks.values())) if c in peaks else DASH
            for c in controllers
        ]
        rows.append([looks[name].label, *texts])
    head = ["Axis that moves", *map(controller_name, controllers)]
    return table(head, rows, caption="Largest error of the axes that should stay")


def cross_picture(rig: Rig, result: Tracking, singles: Sequence[str]) -> Markup:
    """Return the picture of what a moving axis does to the others."""
    alt = f"Errors of the axes that should stay while one of {', '.join(singles)} moves, per controller"
    caption = "Error of the axes that should stay, each in its colour, while the axis in the title moves; one scale."
    return plots.picture(partial(cross_figure, rig, result, singles), alt, caption)


def cross_figure(rig: Rig, result: Tracking, singles: Sequence[str]) -> plots.Figure:
    """Draw the errors of the axes that should stay: a row per controller, a column per axis that moves."""
    joints = joints_of(rig)
    controllers = controller_looks(result.experiments)
    height = 0.9 + 1.4 * len(controllers)
    figure, panels = plots.panels(len(controllers), len(singles), height, gaps=(0.2, 0.2), share=(True, True), left=1.1)
    for column, name in enumerate(singles):
        for line, controller in enumerate(controllers):
            still_errors(panels[line, column], joints, result.of(name, controller))
            plots.zero_line(panels[line, column])
        panels[0, column].set_title(f"{name} moves", color=next(x.colour for x in joints if x.name == name))
        panels[-1, column].set_xlabel("time, s")
    for line, controller in enumerate(controllers):
        panels[line, 0].set_ylabel(f"{controller_name(controller)}\nerror, {units(joints)}")
    return figure


def still_errors(axes: plots.Axes, joints: Sequence[Joint], experiment: Experiment) -> None:
    """Draw the errors of the joints that should stay."""
    for j, joint in enumerate(joints):
        if joint.name != experiment.name:
            error = np.asarray(experiment.log.q_ref)[:, j] - experiment.q[:, j]
            plots.curve(axes, experiment.log.t, joint.scale * error, color=joint.colour)
