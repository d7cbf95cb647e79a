"""The logs: what was recorded, and how the joints moved in it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array, Log
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Content, bullets, join, table
from gimbal_pin.report.pages.joints import Joint, joint_colours, joints_of, units
from gimbal_pin.report.pages.numbers import DASH, figures, file_name
from gimbal_pin.rig.rig import Rig

DRAWN = 3
"""Most logs that are drawn."""


def data(rig: Rig, logs: Sequence[Log]) -> Section:
    """Return the logs' size, the range they cover, and their angles and torques over time."""
    head = ["Log", "Payload", "Length, s", "Rate, Hz", "Samples", "Joint rates"]
    cover = ["Joint", "Travel", "Largest rate", "Torque rms, N m", "Largest torque, N m", "of the limit"]
    rows = [covered(rig, logs, j, joint) for j, joint in enumerate(joints_of(rig))]
    parts = [table(head, [about(log) for log in logs], texts=2, caption="Logs"), table(cover, rows, caption="Covered")]
    parts += [shown(rig, log) for log in logs[:DRAWN]]
    events = [f"{log.name}: {event}" for log in logs for event in log.events]
    if events:
        parts.append(bullets(events))
    return Section("Data", join(parts), "What the model was learnt from and judged by.")


def about(log: Log) -> list[Content]:
    """Return a log's row."""
    return [
        log.name,
        log.payload or DASH,
        figures(float(log.t[-1] - log.t[0]), 4),
        figures(1 / log.dt, 4),
        f"{len(log):,}".replace(",", " "),
        "measured" if log.v is not None else "from angles",
    ]


def covered(rig: Rig, logs: Sequence[Log], j: int, joint: Joint) -> list[Content]:
    """Return a joint's row: what range of its limits the logs cover."""
    low, high = min(log.q[:, j].min() for log in logs), max(log.q[:, j].max() for log in logs)
    rate = max(float(np.max(np.abs(speed(log)[:, j]))) for log in logs)
    tau = np.concatenate([log.tau[:, j] for log in logs if log.tau is not None] or [np.zeros(1)])
    top, limit = float(np.abs(tau).max()), float(rig.tau_max[j])
    return [
        joint.label,
        f"{joint.text(float(low))} … {joint.text(float(high))}",
        joint.text(rate, "/s"),
        figures(float(np.sqrt(np.mean(tau**2)))),
        figures(top),
        f"{100 * top / limit:.0f} %" if isfinite(limit) else DASH,
    ]


def speed(log: Log) -> Array:
    """Return the log's rates, or what its angles say of them."""
    return log.v if log.v is not None else np.asarray(np.gradient(log.q, log.t, axis=0))


def shown(rig: Rig, log: Log) -> Markup:
    """Return the log's angles and torques over time."""
    alt = f"Angle and torque of {', '.join(log.joints)} over time in {file_name(log.name)}"
    caption = f"{file_name(log.name)}: every joint as recorded."
    return plots.picture(partial(overview, rig, log), alt, caption, joint_colours(rig.joints))


def overview(rig: Rig, log: Log) -> plots.Figure:
    """Draw angles above torques."""
    figure, panels = plots.panels(2, 1, 3.7, gaps=(0, 0.2), share=(True, False))
    angle, torque = panels[:, 0]
    looks = joints_of(rig)
    for j, joint in enumerate(looks):
        plots.curve(angle, log.t, joint.scale * log.q[:, j], lw=1.2)
        if log.tau is not None:
            plots.curve(torque, log.t, log.tau[:, j], lw=0.8)
    plots.named(angle, [(joint.name, joint.colour) for joint in looks])
    angle.set(ylabel=f"position, {units(looks)}", xlim=(log.t[0], log.t[-1]))
    torque.set(ylabel="torque, N m", xlabel="time, s")
    figure.align_ylabels()
    return figure
