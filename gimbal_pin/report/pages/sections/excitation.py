"""The motion that the rig was, or is to be, excited with."""

from __future__ import annotations

from functools import partial

from markupsafe import Markup

from gimbal_pin.excitation import Excitation
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, bar, join, paragraph, table
from gimbal_pin.report.pages.joints import Joint, joints_of, units
from gimbal_pin.report.pages.numbers import figures
from gimbal_pin.rig.rig import Rig

LIMITS = (("q", "Angle"), ("dq", "Rate"), ("ddq", "Acceleration"), ("tau", "Torque"))
"""Keys of `limits_used`, and what they are shares of."""


def excitation(design: Excitation, rig: Rig) -> Section:
    """Return an excitation's motion, its condition number, and how much of each limit it uses."""
    joints = joints_of(rig)
    text = (
        f"{design.length}, criterion {design.criterion}; condition number "
        f"{figures(design.condition_number, 2)} (columns in unit torque: comparable within a rig, not between rigs)."
    )
    if not design.finished:
        text += " The search was interrupted: this is the best it had found."
    rows = [[joint.label, *(used(design, joint, key) for key, _ in LIMITS)] for joint in joints]
    parts = [
        paragraph(text),
        table(["Joint", *(name for _, name in LIMITS)], rows, caption="Share of each limit that is used"),
        drawing(design, joints),
    ]
    return Section("Excitation", join(parts), "The motion that shows the parameters best within the rig's limits.")


def used(design: Excitation, joint: Joint, key: str) -> Content:
    """Return the share of one limit that a joint uses, as a bar; a word where there is no limit."""
    share = design.limits_used[joint.name][key]
    return bar(share, f"{100 * share:.0f} %") if share else "no limit"


def drawing(design: Excitation, joints: tuple[Joint, ...]) -> Markup:
    """Return the motion as a picture."""
    alt = f"Angles and rates of {', '.join(design.joints)} over {design.seconds:g} s"
    caption = "The motion: position above, rate below."
    return plots.picture(partial(motion_figure, design, joints), alt, caption)


def motion_figure(design: Excitation, joints: tuple[Joint, ...]) -> plots.Figure:
    """Draw positions above rates."""
    figure, panels = plots.panels(2, 1, 3.7, gaps=(0, 0.2), share=(True, False))
    position, rate = panels[:, 0]
    motion = design.motion
    for j, joint in enumerate(joints):
        plots.curve(position, motion.t, joint.scale * motion.q[:, j], color=joint.colour)
        plots.curve(rate, motion.t, joint.scale * motion.v[:, j], color=joint.colour)
    plots.named(position, [(joint.name, joint.colour) for joint in joints])
    plots.zero_line(rate)
    position.set(ylabel=f"position, {units(joints)}", xlim=(motion.t[0], motion.t[-1]))
    rate.set(ylabel=f"rate, {units(joints)}/s", xlabel="time, s")
    figure.align_ylabels()
    return figure
