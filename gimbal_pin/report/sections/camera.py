"""Holding the camera still while the platform moves: what it sees, how still it stands, what it costs."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.controller_names import BASELINE, COMPILED, OURS
from gimbal_pin.log.limited import LEAST_SHARE_TOLD, PUSHED, describe_limits
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Pointing, Verified, split
from gimbal_pin.report import plots, tables
from gimbal_pin.report.elements import Card, Section, bullets, cards, embed, folded, heading, notice, paragraph
from gimbal_pin.report.format import angle, controller_name, figures, listed, to_sentence
from gimbal_pin.report.view import gaze

MOTIONS = {"S": "profile S (hand or airframe, engine and propellers)", "log": "the recorded motion"}
EVENTS = 12
"""Most events that are listed."""
COLOURS = {BASELINE: plots.PLAIN, OURS: "#1a75f2", COMPILED: "#d98200"}
CURVE_POINTS = 400
"""Points of a curve."""


def show_camera(found: Verified) -> Section:
    """Return what the camera sees on a platform that moves, the error, torque and margins."""
    shown = gaze.render_gaze(gaze.outlook(found, WANTED), WANTED)
    seen = embed(shown, "What the cameras see", "gaze", name_clock(found))
    runs, weak = found.rows[0].runs, any(describe_limits(row.at_limit) for row in found.rows)
    times = "once" if len(runs) == 1 else f"{len(runs)} times, each with its own motion and noise"
    margins = ", torque limits and margins" if found.is_equal else " and torque limits"
    circumstances = (
        f"Simulated {times} for {figures(float(runs[0].t[-1]), 2)} s on {MOTIONS[runs[0].platform]}, every controller "
        f"with the same motion, sensors, delay{margins}. Jitter is the line of sight above 0.2 Hz; what is slower is "
        f"drift, which integrated gyros have whoever controls. {found.note}"
    )
    events = [f"{controller_name(row.controller)}: {event}" for row in found.rows for event in row.happened]
    rest = [f"and {len(events) - EVENTS} more, in the JSON"] * (len(events) > EVENTS)
    parts: list[object] = [
        paragraph(headline(found), f"headline {'good' if found.gain > 1 else 'fair'}"),
        paragraph(circumstances.strip()),
        cards(numbers(found)),
        Markup('<div class="animation">{}{}</div>').format(heading("What the camera sees").html, seen),
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
    (ours, best), (pid, other) = ((controller_name(name), angle(found.jitter[name])) for name in (OURS, BASELINE))
    said = f"{ours} leaves {best} rms of jitter, {pid} {other}"
    times = f": {figures(found.gain, 2)} times as much" if found.gain > 1 else ""
    margins = "" if found.is_equal else ", each with margins of its own"
    failed = " Sensors were failed on purpose while it ran." if found.failed else ""
    return to_sentence(f"{said}{times}{margins}") + failed


def numbers(found: Verified) -> list[Card]:
    """Return the headline numbers, of computed torque."""
    (ours,) = [row for row in found.rows if row.controller == OURS]
    shares = np.max([np.abs(run.tau[run.counted]).max(axis=0) / run.tau_max for run in ours.runs], axis=0)
    joint, share = found.joints[int(np.argmax(shares))], float(shares.max())
    long, least = ours.at_limit[joint], min(own.delay_margin for own in found.loops[OURS])
    touched = f", and at it {figures(100 * long, 2)} % of the time" if long > 0 else ""
    tone = "poor" if long >= LEAST_SHARE_TOLD else "fair" if share >= 1 else ""
    return [
        Card("Jitter", f"{angle(ours.jitter_rms)} rms", f"at most {angle(ours.jitter_max)}; above 0.2 Hz"),
        Card("Drift", angle(ours.drift), "below 0.2 Hz, from where it began"),
        Card("Torque", f"{figures(100 * share, 2)} %", f"of the limit at most: {joint}{touched}", tone),
        Card("Delay margin", f"{figures(1e3 * least, 2)} ms", "of the loop that has least"),
    ]


def picture_camera(found: Verified) -> plots.Drawing:
    """Return line of sight, cumulative spectrum and torque as a picture."""
    run, names = found.rows[0].runs[0], listed(controller_name(row.controller) for row in found.rows)
    alt = f"Line of sight over time, its cumulative spectrum, and torque as a share of its limit, for {names}"
    stretch = figures(1e3 * len(run.sight) * run.dt / min(CURVE_POINTS, len(run.sight)), 2)
    caption = (
        f"Line of sight of the first run: the largest distance from its slow part in each {stretch} ms; its "
        "cumulative rms over frequency; torque, rms as a bar and the largest as a line, and its limit."
    )
    return plots.Drawing(partial(draw_camera_chart, found), alt, caption)


def draw_camera_chart(found: Verified) -> plots.Figure:
    """Return diagrams of the first run of every controller."""
    figure, panels = plots.panels(2, 2, 4.6, gaps=(0.85, 0.75))
    over_time, spectrum = panels[0]
    grid = over_time.get_gridspec()
    for axes in panels[1]:
        axes.remove()
    runs = [row.runs[0] for row in found.rows]
    for run in runs:
        colour = COLOURS[run.controller]
        fast, _ = split(run.sight, run.dt)
        size, t = np.degrees(np.hypot(*fast.T)), run.t[run.counted]
        edges = np.linspace(0, len(t), min(CURVE_POINTS, len(t)) + 1).astype(int)
        pairs = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
        over_time.plot([t[a:b].mean() for a, b in pairs], [size[a:b].max() for a, b in pairs], lw=1.0, color=colour)
        # The rms of both axes up to each frequency, by Parseval's theorem.
        power = np.sum(np.abs(np.fft.rfft(fast, axis=0)) ** 2, axis=1)
        power[1:] *= 2
        power[-1] /= 2 if len(fast) % 2 == 0 else 1
        f, jitter = np.fft.rfftfreq(len(fast), run.dt), np.degrees(np.sqrt(np.cumsum(power)) / len(fast))
        some = np.unique(np.geomspace(1, len(f) - 1, CURVE_POINTS).astype(int))
        spectrum.loglog(f[some], jitter[some], color=colour)
    over_time.set(xlabel="time, s", ylabel="line of sight off by, °", xlim=(t[0], t[-1]), ylim=(0, None))
    spectrum.set(xlabel="frequency, Hz", ylabel="cumulative jitter, °", xlim=(max(f[1], 0.1), f[-1]))
    # What is below a thousandth of the largest is the high-pass's own flank, not jitter.
    spectrum.set_ylim(bottom=max(spectrum.get_ylim()[0], 1e-3 * spectrum.get_ylim()[1]))
    draw_torques(figure.add_subplot(grid[1, :]), runs)
    plots.put_legend(over_time, [(controller_name(run.controller), COLOURS[run.controller]) for run in runs])
    plots.plain_powers(figure)
    return figure


def draw_torques(axes: plots.Axes, runs: list[Pointing]) -> None:
    """Draw each joint's torque as a share of its limit: rms as a bar, the largest as a whisker."""
    high = 0.8 / len(runs)
    for k, run in enumerate(runs):
        at = np.arange(len(run.joints)) + (k - (len(runs) - 1) / 2) * high
        share = 100 / run.tau_max * np.abs(run.tau[run.counted])
        axes.barh(at, np.sqrt(np.mean(share**2, axis=0)), 0.85 * high, color=COLOURS[run.controller])
        axes.hlines(at, 0, share.max(axis=0), color=COLOURS[run.controller], lw=1.4)
    axes.axvline(100, color="#b3261e", lw=1.2, ls=(0, (4, 3)))
    axes.set(xlabel="% of the limit", xlim=(0, 108))
    axes.set_yticks(range(len(runs[0].joints)), runs[0].joints)
    axes.invert_yaxis()
