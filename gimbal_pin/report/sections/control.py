"""Controllers: gains and margins, and how steps are followed, all axes together and one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np

from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.laws.reasons import ReasonKind
from gimbal_pin.control.tracking import Experiment, Tracking
from gimbal_pin.control.tuning import RIVAL, Tuning
from gimbal_pin.errors import digits
from gimbal_pin.export import Exported
from gimbal_pin.log.limited import describe_limits
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace
from gimbal_pin.report.elements import (
    Section,
    Table,
    bullets,
    folded,
    list_warnings,
    notice,
    paragraph,
)
from gimbal_pin.report.format import controller_name, joint_colours, list_shown_joints, listed
from gimbal_pin.report.loop_chart import LoopPicture
from gimbal_pin.report.tables import TOGETHER
from gimbal_pin.rig.rig import Rig

RIVAL_COLOURS = (plots.PLAIN, plots.MUTED, "#8a4fd0", "#0b96a8")
"""Colours of the controllers that stand beside the one in the joint's colour."""


def show_controller(tuning: Tuning) -> Section:
    """Return the gains and margins of a tuning, why they are not what was asked for, and its loops."""
    wish = tuning.wish
    rig = tuning.model.rig
    timing = f"Sampled every {1e3 * wish.dt:g} ms, {digits(1e3 * wish.delay, 3)} ms from measurement to torque"
    usual, other = (
        [one.sentence for one in tuning.reasons if (one.kind is ReasonKind.USUAL) == is_usual]
        for is_usual in (True, False)
    )
    own = zip(rig.joints, tuning.drive_gains)
    fast = [joint for joint, gains in own if gains.current is not None and gains.odrive is None]
    no_cascade = "no gains of ODrive's cascade integrate so fast; ask for a smaller --integral"
    colours = dict(zip(rig.joints, joint_colours(rig.joints)))
    parts: list[object] = [
        *list_warnings((*tuning.warnings, *tuning.doubts)),
        paragraph(f"{timing}; damping {wish.damping:g}, disk margin of at least {wish.disk:g}."),
        tables.loops(tuning),
        *([bullets(other)] if other else []),
        folded("Why these gains", bullets(usual)),
        folded("Gains for drives", tables.drive_gains(tuning), is_detail=False),
        *([paragraph(f"{listed(fast)}: {no_cascade}", "side")] if fast else []),
        folded("The loops", LoopPicture(tuning.loop_curves, colours, controller_name(wish.kind))),
    ]
    lead = (
        "How fast the loops are, and how far from instability: with the delay, at the worst pose."
    )
    return Section("Controller", parts, lead)


def show_judgement(judged: Judgement) -> Section:
    """Return how closely controllers follow a step on perturbed plants."""
    figures = (
        f"Steps simulated on {judged.plants} plants that are off as the model may be, with the drives' noise and a "
        "delay up to a third more or less, from settled starts: error rms, median (worst), no less than the encoders "
        "resolve; ratio: the error of a PID of the same disk margin, with gravity and friction fed forward, over the "
        "controller's."
    )
    parts = [paragraph(figures, "side"), tables.judgement(judged, list_shown_joints(judged.rig))]
    return Section(
        "Perturbed plants", parts, "Every controller meets the same plants and the same noise."
    )


def show_tracking(result: Tracking) -> Section:
    """Return the steps of controllers: how large, who is at the torque limit, a picture."""
    rig = result.rig
    joints = list_shown_joints(result.rig)
    steps = listed(f"{joint.text(result.steps[joint.name])} of {joint.name}" for joint in joints)
    note = (
        f" The plant is {result.plant}, with the rig's sensors, delay and torque limits."
        if result.plant
        else ""
    )
    said = f"Minimum-jerk steps of {steps}.{note} All of it is simulated, not run on the gimbal."
    shares = [
        (one, {name: own.saturated for name, own in one.joints.items()})
        for one in result.experiments
    ]
    limits = [
        f"{one.name}, {controller_name(one.controller)}: {text}"
        for one, share in shares
        if (text := describe_limits(share))
    ]
    # The baseline is drawn in grey, behind the others.
    drawn = sorted(
        (x for x in result.experiments if x.name == TOGETHER), key=lambda x: x.controller != RIVAL
    )
    names = listed(controller_name(one.controller) for one in drawn)
    alt = f"Step responses of {', '.join(rig.joints)}: angle, error and torque, for {names}"
    caption = "Reference (dashed) and angle, the error, which should stay near zero, and the torque of its limit."
    charts = partial(chart_steps, rig, drawn)
    picture = plots.Drawing(partial(draw_steps, rig, drawn), alt, caption, charts=charts)
    limited = [notice("At the torque limit, of the time", bullets(limits))] if limits else []
    lead = "Every controller meets the same steps and the same noise."
    return Section("Tracking", [paragraph(said), *limited, picture], lead)


def draw_steps(rig: Rig, experiments: Sequence[Experiment]) -> plots.Figure:
    """Draw angle, error and torque of every joint, one column each; the last controller has the joint's colour."""
    joints = list_shown_joints(rig)
    count = len(experiments)
    alike = len({joint.unit for joint in joints}) == len({*np.isfinite(rig.tau_max).tolist()}) == 1
    gaps = (0.35 if alike else 0.85, 0.33)
    ratios = [1.5, 1.2, 1]
    figure, panels = plots.panels(
        3, rig.n, 5.4, ratios=ratios, gaps=gaps, share=(True, "row" if alike else False)
    )
    names = [controller_name(one.controller) for one in experiments]
    for j, (joint, (above, middle, below)) in enumerate(zip(joints, panels.T)):
        limit = float(rig.tau_max[j])
        t = experiments[0].log.t
        wanted = np.asarray(experiments[0].log.q_ref)[:, j]
        shades = [*(RIVAL_COLOURS[k % len(RIVAL_COLOURS)] for k in range(count - 1)), joint.colour]
        for one, colour in zip(experiments, shades):
            width = 1.6 if colour == joint.colour else 2.2
            tau = np.asarray(one.log.tau)[:, j]
            plots.curve(above, t, joint.scale * one.q[:, j], color=colour, lw=width)
            plots.curve(middle, t, joint.scale * (wanted - one.q[:, j]), color=colour, lw=width)
            plots.curve(
                below,
                t,
                100 * tau / limit if isfinite(limit) else tau,
                color=colour,
                lw=0.8 * width,
            )
        plots.curve(above, t, joint.scale * wanted, color=plots.INK, lw=1.0, ls=(0, (4, 3)))
        for axes in (middle, below):
            plots.zero_line(axes)
        above.set_title(joint.name, color=joint.colour)
        if j == 0 or not alike:
            above.set_ylabel(f"position, {joint.unit}")
            middle.set_ylabel(f"error, {joint.unit}")
            below.set_ylabel("torque, % of limit" if isfinite(limit) else f"torque, {joint.force}")
        below.set(xlabel="time, s", xlim=(t[0], t[-1]))
        if j == 0:  # one legend for all columns: each has its own colour for the last
            plots.put_legend(middle, list(zip([*names[:-1], f"in colour: {names[-1]}"], shades)))
    figure.align_ylabels()
    return figure


def chart_steps(rig: Rig, experiments: Sequence[Experiment]) -> Charts:
    """Return the same as charts: a row each of angles, errors and torques."""
    names = [controller_name(one.controller) for one in experiments]
    rows = list[list[Chart]]([[], [], []])
    for j, joint in enumerate(list_shown_joints(rig)):
        first = experiments[0].log
        limit = float(rig.tau_max[j])
        wanted = joint.scale * np.asarray(first.q_ref)[:, j]
        angles = [joint.scale * one.q[:, j] for one in experiments]
        torques = [
            np.asarray(one.log.tau)[:, j] * (100 / limit if isfinite(limit) else 1.0)
            for one in experiments
        ]
        shades = [
            *(RIVAL_COLOURS[k % len(RIVAL_COLOURS)] for k in range(len(names) - 1)),
            joint.colour,
        ]
        shown = {
            f"position, {joint.unit}": angles,
            f"error, {joint.unit}": [wanted - angle for angle in angles],
            "torque, % of limit" if isfinite(limit) else f"torque, {joint.force}": torques,
        }
        for row, (label, several) in zip(rows, shown.items()):
            curves = [Trace(*one) for one in zip(names, several, shades)]
            curves += (
                [Trace("reference", wanted, plots.INK, dashes=(5, 4))] if several is angles else []
            )
            row.append(Chart(joint.name, joint.colour, label, first.t, curves, {}))
    return Charts("steps", rows)


def show_export(found: Exported, folder: Path) -> Section:
    """Return the cost of a step, how the equations agree with Pinocchio, and how to build it."""
    rows = [[name, str(count)] for name, count in found.operations.items()]
    lines = [
        f"memory: {found.memory} bytes",
        f"equations agree with Pinocchio to {found.difference:.1g} in double precision",
        f"build: cmake -S {folder} -B {folder / 'build'} && cmake --build {folder / 'build'}",
    ]
    head = paragraph(f"begin with {folder / 'README.md'}")
    return Section("Export", [head, Table(("Of a step", "Operations"), rows), bullets(lines)])
