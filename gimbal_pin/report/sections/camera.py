"""Holding the camera still while the platform moves: what it sees, how still it stands, what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.controller_names import BASELINE, OURS
from gimbal_pin.log.limited import LEAST_SHARE_TOLD, PUSHED, describe_limits
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Pointing, Verified, split
from gimbal_pin.report import plots, tables
from gimbal_pin.report.charts import Chart, Charts, Trace
from gimbal_pin.report.elements import (
    Card,
    Section,
    bullets,
    cards,
    embed,
    folded,
    heading,
    notice,
    paragraph,
)
from gimbal_pin.report.format import (
    ShownJoint,
    angle,
    controller_name,
    figures,
    list_shown_joints,
    listed,
    to_sentence,
)
from gimbal_pin.report.view import gaze

MOTIONS = {"S": "profile S (hand or airframe, engine and propellers)", "log": "the recorded motion"}
EVENTS = 12
"""Most events that are listed."""
COLOURS = {BASELINE: plots.PLAIN, OURS: "#1a75f2"}
CURVE_POINTS = 400
"""Points of a curve."""


def show_camera(found: Verified) -> Section:
    """Return what the camera sees on a platform that moves, the error, torque and margins."""
    shown = gaze.render_gaze(gaze.outlook(found, WANTED), WANTED)
    seen = embed(shown, "What the cameras see", "gaze", name_clock(found))
    runs = found.rows[0].runs
    weak = any(describe_limits(row.at_limit) for row in found.rows)
    times = "once" if len(runs) == 1 else f"{len(runs)} times, each with its own motion and noise"
    margins = ", torque limits and margins" if found.is_equal else " and torque limits"
    circumstances = (
        f"Simulated {times} for {figures(float(runs[0].t[-1]), 2)} s on {MOTIONS[runs[0].platform]}, every controller "
        f"with the same motion, sensors, delay{margins}. Jitter is the line of sight above 0.2 Hz; what is slower is "
        f"drift. {found.note}"
    )
    events = [
        f"{controller_name(row.controller)}: {event}"
        for row in found.rows
        for event in row.happened
    ]
    rest = [f"and {len(events) - EVENTS} more, in the JSON"] * (len(events) > EVENTS)
    parts: list[object] = [
        paragraph(headline(found), f"headline {'good' if found.gain > 1 else 'fair'}"),
        paragraph(circumstances.strip()),
        cards(numbers(found)),
        Markup('<div class="animation">{}{}</div>').format(
            heading("What the camera sees").html, seen
        ),
        heading("Line of sight and torque").html,
        picture_camera(found),
        heading("The controllers").html,
        tables.contest(found),
        *([paragraph(f"At the torque limit for long: {PUSHED}.", "side")] if weak else []),
        folded("Margins", tables.held_margins(found)),
        *([notice("What happened", bullets([*events[:EVENTS], *rest]))] if events else []),
    ]
    return Section("Camera", parts, "The platform moves; the camera should not.")


def name_clock(found: Verified) -> str:
    """Return the name of the first run's clock, by which pictures, scene and charts of it move."""
    return f"platform {found.rows[0].runs[0].platform}"


def headline(found: Verified) -> str:
    """Say how still the camera stands with computed torque, and with the PID."""
    ours, pid = (
        f"{controller_name(name)} {tables.state_jitter(found, name)}" for name in (OURS, BASELINE)
    )
    said = f"{ours}, {pid}"
    times = f": {figures(found.gain, 2)} times as much" if found.gain > 1 else ""
    margins = "" if found.is_equal else ", each with margins of its own"
    return to_sentence(f"{said}{times}{margins}")


def numbers(found: Verified) -> list[Card]:
    """Return the headline numbers, of computed torque."""
    (ours,) = [row for row in found.rows if row.controller == OURS]
    shares = np.max(
        [np.abs(run.tau[run.counted]).max(axis=0) / run.tau_max for run in ours.runs], axis=0
    )
    joint = found.joints[int(np.argmax(shares))]
    share = float(shares.max())
    long = ours.at_limit[joint]
    least = min(own.delay_margin for own in found.loops[OURS])
    touched = f", and at it {figures(100 * long, 2)} % of the time" if long > 0 else ""
    cost = f"with {tables.state_torque_rms(ours.torque_rms)}"
    tone = "poor" if long >= LEAST_SHARE_TOLD else "fair" if share >= 1 else ""
    return [
        Card(
            "Jitter",
            f"{angle(ours.jitter_rms)} rms",
            f"at most {angle(ours.jitter_max)}; above 0.2 Hz, {cost}",
        ),
        Card("Drift", angle(ours.drift), "below 0.2 Hz, from where it began"),
        Card(
            "Torque",
            f"{figures(100 * share, 2)} %",
            f"of the limit at most: {joint}{touched}",
            tone,
        ),
        Card("Delay margin", f"{figures(1e3 * least, 2)} ms", "of the loop that has least"),
    ]


def picture_camera(found: Verified) -> plots.Drawing:
    """Return line of sight, its cumulative spectrum, and torque as a share of its limit as a picture."""
    runs = [row.runs[0] for row in found.rows]
    names = listed(controller_name(run.controller) for run in runs)
    alt = f"Line of sight over time, its cumulative spectrum, and torque as a share of its limit, for {names}"
    stretch = figures(
        1e3 * len(runs[0].sight) * runs[0].dt / min(CURVE_POINTS, len(runs[0].sight)), 2
    )
    caption = (
        "Line of sight and torque of the first run: the largest distance from its slow part, and the largest torque, "
        f"in each {stretch} ms (on paper, of torque: rms as a bar, the largest as a line); the cumulative rms of the "
        "line of sight over frequency."
    )
    above = (chart_sight(runs), chart_spectrum(runs))
    torques = chart_torques_held(list_shown_joints(found.rig), runs)
    charts = partial(
        Charts, name_clock(found), [above, *(torques[k : k + 2] for k in range(0, len(torques), 2))]
    )
    return plots.Drawing(partial(draw_camera_chart, above, runs), alt, caption, charts=charts)


def draw_camera_chart(above: Sequence[Chart], runs: Sequence[Pointing]) -> plots.Figure:
    """Return the same as diagrams, of torque each joint's rms and largest."""
    figure, panels = plots.panels(2, 2, 4.6, left=1.05, gaps=(1.1, 0.75))
    grid = panels[0, 0].get_gridspec()
    for axes in panels[1]:
        axes.remove()
    for axes, chart in zip(panels[0], above):
        chart.draw(axes)
    draw_torques(figure.add_subplot(grid[1, :]), runs)
    return figure


def trace_largest(runs: Sequence[Pointing], sizes: Sequence[Array]) -> tuple[Array, list[Trace]]:
    """Return the middle of each stretch of time, s, and the largest of a size there, a curve for each controller."""
    t = runs[0].t[runs[0].counted]
    edges = np.linspace(0, len(t), min(CURVE_POINTS, len(t)) + 1).astype(int)
    looks = ((controller_name(run.controller), COLOURS[run.controller]) for run in runs)
    most = [
        Trace(name, np.maximum.reduceat(size, edges[:-1]), colour)
        for (name, colour), size in zip(looks, sizes)
    ]
    return np.add.reduceat(t, edges[:-1]) / np.diff(edges), most


def chart_sight(runs: Sequence[Pointing]) -> Chart:
    """Return how far the line of sight is off."""
    t, curves = trace_largest(
        runs, [np.degrees(np.hypot(*split(run.sight, run.dt)[0].T)) for run in runs]
    )
    return Chart("", plots.INK, "line of sight off by, °", t, curves, {})


def chart_torques_held(joints: Sequence[ShownJoint], runs: Sequence[Pointing]) -> list[Chart]:
    """Return each joint's torque as a share of its limit."""
    found = list[Chart]()
    for j, joint in enumerate(joints):
        t, curves = trace_largest(
            runs, [100 / run.tau_max[j] * np.abs(run.tau[run.counted, j]) for run in runs]
        )
        found.append(Chart(joint.name, joint.colour, "torque, % of limit", t, curves, {}))
    return found


def chart_spectrum(runs: Sequence[Pointing]) -> Chart:
    """Return the rms of both axes of the line of sight up to each frequency, by Parseval's theorem."""
    curves = list[Trace]()
    dt = runs[0].dt
    count = len(runs[0].sight)
    f = np.fft.rfftfreq(count, dt)
    some = np.unique(
        np.geomspace(max(1, int(np.searchsorted(f, 0.1))), len(f) - 1, CURVE_POINTS).astype(int)
    )
    for run in runs:
        power = np.sum(np.abs(np.fft.rfft(split(run.sight, dt)[0], axis=0)) ** 2, axis=1)
        power[1:] *= 2
        power[-1] /= 2 if count % 2 == 0 else 1
        jitter = np.degrees(np.sqrt(np.cumsum(power)) / count)
        # What is below a thousandth of the largest is the high-pass's own flank, not jitter.
        shown = np.where(jitter > 1e-3 * jitter[-1], jitter, np.nan)[some]
        curves.append(Trace(controller_name(run.controller), shown, COLOURS[run.controller]))
    return Chart("", plots.INK, "cumulative jitter, °", f[some], curves, {}, "frequency, Hz", "xy")


def draw_torques(axes: plots.Axes, runs: Sequence[Pointing]) -> None:
    """Draw each joint's torque as a share of its limit: rms as a bar, the largest as a whisker."""
    high = 0.8 / len(runs)
    for k, run in enumerate(runs):
        at = np.arange(len(run.joints)) + (k - (len(runs) - 1) / 2) * high
        share = 100 / run.tau_max * np.abs(run.tau[run.counted])
        axes.barh(
            at, np.sqrt(np.mean(share**2, axis=0)), 0.85 * high, color=COLOURS[run.controller]
        )
        axes.hlines(at, 0, share.max(axis=0), color=COLOURS[run.controller], lw=1.4)
    axes.axvline(100, color="#b3261e", lw=1.2, ls=(0, (4, 3)))
    axes.set(xlabel="% of the limit", xlim=(0, 108))
    axes.set_yticks(range(len(runs[0].joints)), runs[0].joints)
    axes.invert_yaxis()
