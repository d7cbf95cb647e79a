"""Figures of a state as the page's charts read them (ECharts' options): dictionaries and arrays, no page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gimbal_pin.control.laws.chart import compute_disk
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.log.log import Array, Log
from gimbal_pin.pointing.result import split
from gimbal_pin.report import tables
from gimbal_pin.report.elements import Content, Table
from gimbal_pin.report.format import figures, list_shown_joints, torque_unit
from gimbal_pin.report.plots import PLAIN, nest_dashes, thinned
from gimbal_pin.report.tables import state_torque_rms
from gimbal_pin.rig.rig import Rig
from gimbal_pin.studio.figures import PointingFigure, ResidualFigure
from gimbal_pin.studio.state import StudioState
from gimbal_pin.studio.subject import StudioSource, find_marked_log, list_ends

Options = dict[str, Any]
"""What ECharts is given."""


def build_chart(x: Options, y: Options, series: Sequence[Options], **more: Any) -> Options:
    """Return a chart; lines and labels have a grey that is seen on light and on dark ground."""
    grey = {"color": PLAIN}
    faint = {"lineStyle": {"color": PLAIN, "opacity": 0.25}}
    plain: Options = {
        "type": "value",
        "nameLocation": "middle",
        "nameTextStyle": grey,
        "axisLabel": {**grey, "hideOverlap": True},
        "axisLine": {"lineStyle": grey},
        "splitLine": faint,
    }
    return {
        "animation": False,
        "backgroundColor": "transparent",
        "grid": {"left": 56, "right": 16, "top": 30, "bottom": 42},
        "legend": {
            "textStyle": grey,
            "type": "scroll",
            "icon": "roundRect",
            "itemHeight": 4,
            "top": 0,
            "data": list(dict.fromkeys(s["name"] for s in series if s.get("name"))),
        },
        "tooltip": {"trigger": "axis", "confine": True},
        "xAxis": {
            **plain,
            "nameGap": 26,
            "axisLabel": {**plain["axisLabel"], "showMaxLabel": False},
            **x,
        },
        "yAxis": {**plain, "nameGap": 40, **y},
        "series": list(series),
        **more,
    }


def build_line(
    name: str, x: Array, y: Array, colour: str, points: int = 600, **more: Any
) -> Options:
    """Return a curve of a chart, thinned to what can be seen where x increases."""
    if np.all(np.diff(x) > 0):
        x, y = thinned(x, y, points)
    look = {
        "color": colour,
        "width": more.pop("width", 1.6),
        "type": more.pop("dashes", ()) or "solid",
    }
    return {
        "type": "line",
        "name": name,
        "data": np.column_stack([x, y]).astype(np.float32),
        "showSymbol": False,
        "lineStyle": look,
        "color": colour,
        **more,
    }


def list_colours(rig: Rig) -> dict[str, str]:
    """Return joint → its colour, as in every report."""
    return {joint.name: joint.colour for joint in list_shown_joints(rig)}


def build_nyquist_options(tuning: Tuning) -> Options:
    """Return Nyquist's diagram of every loop, with the disk that all keep clear of."""
    colours = list_colours(tuning.model.rig)
    lines = []
    for curve, dashes in zip(tuning.loop_curves, nest_dashes(len(tuning.loop_curves))):
        near = np.abs(curve.response) < 30
        name = ", ".join(curve.joints)
        colour = colours[curve.joints[0]]
        for ratio in sorted({*curve.ratios}):
            real = ratio * curve.response.real[near]
            imaginary = ratio * curve.response.imag[near]
            thin = ratio != 1.0
            look: Options = {"width": 0.6} if thin else {"dashes": dashes}
            lines.append(build_line("" if thin else name, real, imaginary, colour, **look))
    disk = compute_disk(min(curve.margins.disk_margin for curve in tuning.loop_curves))
    look = {"areaStyle": {"color": PLAIN, "opacity": 0.0}, "width": 1.2, "silent": True}
    lines.append(build_line("disk kept clear", disk[:, 0], disk[:, 1], PLAIN, **look))
    lines.append(
        {"type": "scatter", "data": [[-1, 0]], "symbolSize": 7, "color": "#e23b2f", "silent": True}
    )
    square: Options = {"tooltip": {"show": False}}
    return build_chart(
        {"min": -3, "max": 1, "name": "real"},
        {"min": -2, "max": 2, "name": "imaginary"},
        lines,
        **square,
    )


def build_step_options(tuning: Tuning) -> Options:
    """Return the angle of every loop after a step of 1 rad/s² of disturbing acceleration."""
    colours = list_colours(tuning.model.rig)
    lines = [
        build_line(
            ", ".join(one.joints), 1e3 * one.t, one.answer, colours[one.joints[0]], dashes=dashes
        )
        for one, dashes in zip(tuning.loop_curves, nest_dashes(len(tuning.loop_curves)))
    ]
    return build_chart(
        {"name": "time, ms", "min": 0, "max": "dataMax"}, {"name": "error, mrad"}, lines
    )


def build_pointing_options(found: PointingFigure) -> Options:
    """Return the line of sight's error along the run on the platform, its slow part taken off."""
    fast, _ = split(found.run.sight, found.run.dt)
    t = 1e3 * found.run.t[found.run.counted]
    lines = [
        build_line(name, t, 1e3 * column, colour)
        for name, column, colour in zip(
            ("up and down", "left and right"), fast.T, ("#1a75f2", "#d98200")
        )
    ]
    return build_chart(
        {"name": "time, ms", "min": "dataMin", "max": "dataMax"}, {"name": "error, mrad"}, lines
    )


def build_residual_options(found: ResidualFigure, rig: Rig) -> Options:
    """Return the residual of every joint over time; between stretches of the log the curves are broken."""
    t = found.t
    gaps = np.flatnonzero(np.diff(t) > 5 * np.median(np.diff(t))) + 1
    broken = np.insert(found.error, gaps, np.nan, axis=0)
    times = np.insert(t, gaps, (t[gaps - 1] + t[gaps]) / 2)
    lines = [
        build_line(joint, times - t[0], column, colour)
        for (joint, colour), column in zip(list_colours(rig).items(), broken.T)
    ]
    return build_chart(
        {"name": "time, s", "min": 0, "max": "dataMax"}, {"name": f"residual, {rig.force}"}, lines
    )


def build_log_options(logs: Sequence[Log], rig: Rig, judged: tuple[float, float] | None) -> Options:
    """Return the angles of logs over time, s, one after another; what judges stands on a darker ground."""
    joints = list_shown_joints(rig)
    lines = []
    for log, start in zip(logs, list_ends(logs)):
        t = log.t - log.t[0] + start
        points = max(600 // len(logs), 100)
        for joint, column in zip(joints, log.q[:, log.columns(rig)].T):
            lines.append(build_line(joint.name, t, joint.scale * column, joint.colour, points))
    ends = [] if judged is None else [[{"xAxis": judged[0]}, {"xAxis": judged[1]}]]
    lines[0]["markArea"] = {
        "silent": True,
        "itemStyle": {"color": PLAIN, "opacity": 0.3},
        "data": ends,
    }
    brush = {"xAxisIndex": 0, "throttleType": "debounce", "throttleDelay": 100, "toolbox": [""]}
    unit = " or ".join(dict.fromkeys(joint.unit for joint in joints))
    x: Options = {"name": "time, s", "min": 0, "max": "dataMax"}
    return build_chart(x, {"name": unit}, lines, brush=brush, tooltip={"show": False})


def build_table(tuning: Tuning, residual: ResidualFigure | None) -> Table:
    """Return the bandwidth and margins of every joint, and its residual where there is a log."""
    rig = tuning.model.rig
    shown = [name for name in tables.MARGINS if name not in ("Crossover", "Gain margin")]
    head = ["Joint", "Bandwidth", *shown]
    rows = list[list[Content]]()
    for joint, bandwidth, least in zip(rig.joints, tables.bandwidths(tuning), tuning.worst):
        margins = dict(zip(tables.MARGINS, tables.margins(least, tuning.wish.disk)))
        rows.append([joint, bandwidth, *(margins[name] for name in shown)])
    if residual is not None:
        head.append("Residual")
        for joint, row, rms in zip(rig.joints, rows, residual.rms.tolist()):
            factor, unit = torque_unit(rms, rig.in_units(joint, "N m"))
            row.append(f"{figures(factor * rms)} {unit}")
    of = (
        f"the worst of {tuning.draws} models drawn from the covariance"
        if tuning.draws
        else "the believed model"
    )
    return Table(head, rows, caption=f"Margins are those of {of}.")


def describe_jitter(found: PointingFigure) -> str:
    """State how still the camera stands, and the torque that this costs."""
    torque = np.sqrt(np.mean(found.run.tau[found.run.counted] ** 2, axis=0)).tolist()
    return f"{figures(1e3 * found.jitter)} mrad rms, {state_torque_rms(dict(zip(found.run.joints, torque)))}"


def find_judged(source: StudioSource, state: StudioState) -> tuple[float, float] | None:
    """Return the part of the logs that judges, on the axis of `list_ends`; None: there is no log, or all judge."""
    ends = list_ends(source.logs).tolist()
    if state.judged is not None and source.logs:
        k = find_marked_log(source.logs, *state.judged)
        return max(state.judged[0], ends[k]), min(state.judged[1], ends[k + 1])
    if source.model is not None or not source.logs:
        return None
    return (ends[-2] if len(source.logs) > 1 else 2 / 3 * ends[1]), ends[-1]


def describe_judged(source: StudioSource, state: StudioState) -> str:
    """Say what judges the model: the marked part, or what `identify` holds out."""
    marked = find_judged(source, state)
    if marked is None:
        return "all logs judge the given model"
    of = f" of {source.logs[find_marked_log(source.logs, *marked)].name}" * (len(source.logs) > 1)
    what = "the residual is of it" if source.model is not None else "the rest trains"
    return f"{marked[0]:.1f} to {marked[1]:.1f} s{of} judge, {what}"
