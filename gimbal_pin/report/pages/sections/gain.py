"""What knowing the causes gains: torque, rollout and tracking, before and after, as bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite
from typing import NamedTuple

from markupsafe import Markup

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.diagnosis.followed import HOW, no_closer
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.joints import Joint, units
from gimbal_pin.report.pages.numbers import figures, torque_unit

THICK = 0.34
"""Thickness of a bar, in rows."""


class Measure(NamedTuple):
    """One of the three measures.

    Attributes:
        title: What it is.
        before: Joint → figure, in the unit of the axis.
        after: The same with all findings.
    """

    title: str
    before: Mapping[str, float]
    after: Mapping[str, float]


def gain(found: Diagnosis, joints: Sequence[Joint]) -> Markup:
    """Return the three measures of the gain as bars."""
    several = measures(found, joints)
    text = "; ".join(
        f"{joint.name} {figures(m.before[joint.name])} to {figures(m.after[joint.name])}"
        for m in several
        for joint in joints
    )
    alt = f"Errors before and after, {', '.join(m.title for m in several)}: {text}"
    caption = (
        "Before (grey) and after (colour), each joint to its own scale: torque predicted on the held-out part; angle "
        "after 0.2 s of simulation from the held-out torque; and a simulated controller's tracking error without and "
        f"with the causes compensated ({HOW})."
    )
    caption += "".join(f" {line}." for line in no_closer(found.tracking))
    return plots.picture(partial(bars, several, tuple(joints)), alt, caption)


def measures(found: Diagnosis, joints: Sequence[Joint]) -> list[Measure]:
    """Return the measures in the units in which they are drawn."""
    scale, unit = torque_unit(max(found.baseline["torque_rmse"].values()))
    torque = [{name: scale * x for name, x in part["torque_rmse"].items()} for part in (found.baseline, found.extended)]
    turn = {joint.name: joint.scale for joint in joints}
    rolled, followed = (
        [{name: turn[name] * x for name, x in part.items()} for part in pair]
        for pair in (
            (found.baseline["rollout_rmse"], found.extended["rollout_rmse"]),
            [{name: row[key] for name, row in found.tracking.items()} for key in ("rms_before", "rms_after")],
        )
    )
    angle = units(joints)
    out = [Measure(f"torque error, {unit} rms", *torque), Measure(f"rollout error, {angle} rms", *rolled)]
    return [*out, Measure(f"tracking error, {angle} rms", *followed)] if found.tracking else out


def bars(several: Sequence[Measure], joints: Sequence[Joint]) -> plots.Figure:
    """Draw the measures side by side."""
    height = 0.6 * len(joints) + 0.9
    figure, panels = plots.panels(1, len(several), height, gaps=(0.55, 0.35))
    for k, (axes, measure) in enumerate(zip(panels[0], several)):
        pairs(axes, measure, joints)
        axes.set_title(measure.title, fontsize=9.5)
        axes.set_yticks(range(len(joints)), [joint.name for joint in joints] if k == 0 else [""] * len(joints))
    return figure


def pairs(axes: plots.Axes, measure: Measure, joints: Sequence[Joint]) -> None:
    """Draw a pair of bars per joint, as shares of the joint's own larger figure, each with its figure."""
    for i, joint in enumerate(joints):
        both = measure.before[joint.name], measure.after[joint.name]
        top = max((x for x in both if isfinite(x)), default=0.0) or 1.0
        for value, colour, side in zip(both, (plots.PLAIN, joint.colour), (-0.5, 0.5)):
            share, at = value / top if isfinite(value) else 0.0, i + side * THICK
            axes.barh(at, share, 0.9 * THICK, color=colour)
            label = figures(value, 2) if isfinite(value) else "not stable"
            axes.text(share + 0.02, at, label, va="center", fontsize=8.5)
    axes.set(xlim=(0, 1.25), ylim=(len(joints) - 0.4, -0.6), xticks=[])
    axes.grid(False)
    axes.tick_params(axis="y", length=0)
    axes.spines["bottom"].set_visible(False)
