"""Controllers: gains and margins, and how steps are followed, all axes together and one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import isfinite

import numpy as np

from gimbal_pin.control.judging import Judgement
from gimbal_pin.control.tracking import Experiment, Tracking
from gimbal_pin.control.tuning import RIVAL, Tuning
from gimbal_pin.report import plots, tables
from gimbal_pin.report.format import controller_name, joints_of, listed
from gimbal_pin.report.html import Section, bullets, folded, paragraph
from gimbal_pin.report.table import join
from gimbal_pin.report.tables import TOGETHER
from gimbal_pin.rig.rig import Rig

BESIDE = (plots.PLAIN, plots.MUTED, "#8a4fd0", "#0b96a8")
"""Colours of the controllers that stand beside the one in the joint's colour."""
CROWDED = 3
"""Controllers from which their names do not fit above one column."""


def margins(tuning: Tuning) -> Section:
    """Return the gains and margins of a tuning, and its loops."""
    wish, rig = tuning.wish, tuning.model.rig
    timing = f"Sampled every {1e3 * wish.dt:g} ms, {1e3 * wish.delay:g} ms from measurement to torque"
    parts: list[object] = [paragraph(f"{timing}; damping {wish.damping:g}, disk margin of at least {wish.disk:g}.")]
    parts += [tables.loops(tuning), folded("Why these gains", bullets(tuning.reasons))]
    parts.append(folded("Gains for drives", join([tables.drive_gains(tuning)])))
    alt = f"Bode and Nyquist diagrams and disturbance answers of {', '.join(rig.joints)}"
    caption = (
        f"The loops of {controller_name(wish.kind)}, sampled and delayed as they will run: the further the "
        "Nyquist curves stay from −1, the safer."
    )
    parts.append(plots.Drawing(tuning.plot, alt, caption, [joint.colour for joint in joints_of(rig)]))
    lead = "How fast the loops are, and how far from instability: with the delay, at the worst pose."
    return Section("Controller", parts, lead)


def tracking(result: Tracking, rig: Rig, plant: str = "", judged: Judgement | None = None) -> Section:
    """Return how controllers are judged on perturbed plants, and their steps.

    `plant`: what the steps are simulated on, within a sentence.
    """
    # The baseline is drawn in grey, behind the others.
    result = replace(result, experiments=tuple(sorted(result.experiments, key=lambda e: e.controller != RIVAL)))
    joints = joints_of(rig)
    steps = listed(f"{joint.text(result.steps[joint.name])} of {joint.name}" for joint in joints)
    note = f" The plant is {plant}, with the rig's sensors, delay and torque limits." if plant else ""
    note = f"{note} All of it is simulated, not run on the gimbal."
    parts: list[object] = [] if judged is None else [tables.judgement(judged, joints)]
    parts.append(paragraph(f"Minimum-jerk steps of {steps}.{note}"))
    parts += [tables.followed(result)] if judged is None else []
    together = [one for one in result.experiments if one.name == TOGETHER]
    names = listed(controller_name(one.controller) for one in together)
    alt = f"Step responses of {', '.join(rig.joints)}: angle, error and torque, for {names}"
    caption = "Reference (dashed) and angle, the error, which should stay near zero, and the torque of its limit."
    parts.append(plots.Drawing(partial(steps_figure, rig, together), alt, caption))
    lead = "Every controller meets the same steps and the same noise."
    return Section("Tracking", parts, lead)


def steps_figure(rig: Rig, experiments: Sequence[Experiment]) -> plots.Figure:
    """Draw angle, error and torque of every joint, one column each; the last controller has the joint's colour."""
    joints, count = joints_of(rig), len(experiments)
    alike = len({joint.unit for joint in joints}) == len({*np.isfinite(rig.tau_max).tolist()}) == 1
    gaps, ratios = (0.35 if alike else 0.85, 0.33), [1.5, 1.2, 1]
    figure, panels = plots.panels(3, rig.n, 6.6, ratios=ratios, gaps=gaps, share=(True, "row" if alike else False))
    names = [controller_name(one.controller) for one in experiments]
    for j, (joint, (above, middle, below)) in enumerate(zip(joints, panels.T)):
        limit, t = float(rig.tau_max[j]), experiments[0].log.t
        wanted = np.asarray(experiments[0].log.q_ref)[:, j]
        shades = [*(BESIDE[k % len(BESIDE)] for k in range(count - 1)), joint.colour]
        for one, colour in zip(experiments, shades):
            width, tau = 1.6 if colour == joint.colour else 2.2, np.asarray(one.log.tau)[:, j]
            plots.curve(above, t, joint.scale * one.q[:, j], color=colour, lw=width)
            plots.curve(middle, t, joint.scale * (wanted - one.q[:, j]), color=colour, lw=width)
            plots.curve(below, t, 100 * tau / limit if isfinite(limit) else tau, color=colour, lw=0.8 * width)
        plots.curve(above, t, joint.scale * wanted, color=plots.INK, lw=1.0, ls=(0, (4, 3)))
        for axes in (middle, below):
            plots.zero_line(axes)
        above.set_title(joint.name, color=joint.colour)
        if j == 0 or not alike:
            above.set_ylabel(f"position, {joint.unit}")
            middle.set_ylabel(f"error, {joint.unit}")
            below.set_ylabel("torque, % of limit" if isfinite(limit) else f"torque, {joint.force}")
        below.set(xlabel="time, s", xlim=(t[0], t[-1]))
        if count < CROWDED:
            plots.named(middle, list(zip(names, shades)))
        elif j == 0:  # one legend for all columns: each has its own colour for the last
            plots.named(middle, list(zip([*names[:-1], f"in colour: {names[-1]}"], shades)))
    figure.align_ylabels()
    return figure
