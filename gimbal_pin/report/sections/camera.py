"""Holding the camera still while the platform moves: what it sees, how still it stands, what it costs."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.controllers import BASELINE, OURS
from gimbal_pin.log.limited import LEAST_SHARE_TOLD, PUSHED, describe_limits
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Row, Verified
from gimbal_pin.report import camera_chart as chart
from gimbal_pin.report import plots, tables
from gimbal_pin.report.format import angle, controller_name, figures, listed, to_sentence
from gimbal_pin.report.html import Card, Section, bullets, cards, embed, folded, heading, notice, paragraph
from gimbal_pin.report.view import gaze

MOTIONS = {"S": "profile S (hand or airframe, engine and propellers)", "log": "the recorded motion"}
EVENTS = 12
"""Most events that are listed."""


def show_camera(found: Verified, note: str = "") -> Section:
    """Return what the camera sees on a platform that moves, the error, torque and margins.

    `note`: what the plant and the model were, as sentences.
    """
    seen = gaze.render_gaze(gaze.outlook(found, WANTED), WANTED)
    weak = any(describe_limits(row.at_limit) for row in found.rows)
    parts: list[object] = [
        paragraph(headline(found), f"headline {'good' if found.gain > 1 else 'fair'}"),
        paragraph(f"{circumstances(found)} {note}".strip()),
        cards(numbers(found)),
        heading("What the camera sees").html,
        Markup('<div class="animation">{}</div>').format(embed(seen, "What the cameras see", "gaze")),
        heading("The line of sight, and its price").html,
        curves(found),
        heading("The controllers").html,
        tables.contest(found),
        *([paragraph(f"At the torque limit for long: {PUSHED}.", "side")] if weak else []),
        folded("Margins", tables.held_margins(found)),
        *happened(found),
    ]
    return Section("Camera", parts, "The platform moves; the camera should not.")


def headline(found: Verified) -> str:
    """Say how still the camera stands with computed torque, and with the PID."""
    (ours, best), (pid, other) = ((controller_name(name), angle(found.jitter[name])) for name in (OURS, BASELINE))
    said = f"{ours} leaves {best} rms of jitter, {pid} {other}"
    times = f": {figures(found.gain, 2)} times as much" if found.gain > 1 else ""
    margins = "" if found.is_equal else ", each with margins of its own"
    failed = " Sensors were failed on purpose while it ran." if found.failed else ""
    return to_sentence(f"{said}{times}{margins}") + failed


def circumstances(found: Verified) -> str:
    """Say what was simulated."""
    runs = found.rows[0].runs
    times = "once" if len(runs) == 1 else f"{len(runs)} times, each with its own motion and noise"
    margins = ", torque limits and margins" if found.is_equal else " and torque limits"
    return (
        f"Simulated {times} for {figures(float(runs[0].t[-1]), 2)} s on {MOTIONS[runs[0].platform]}, every controller "
        f"with the same motion, sensors, delay{margins}. Jitter is the line of sight above 0.2 Hz; what is slower is "
        "drift, which integrated gyros have whoever controls."
    )


def numbers(found: Verified) -> list[Card]:
    """Return the headline numbers, of computed torque."""
    (ours,) = [row for row in found.rows if row.controller == OURS]
    joint, share = find_hardest_joint(ours)
    long, least = ours.at_limit[joint], min(own.delay_margin for own in found.loops[OURS])
    touched = f", and at it {figures(100 * long, 2)} % of the time" if long > 0 else ""
    tone = "poor" if long >= LEAST_SHARE_TOLD else "fair" if share >= 1 else ""
    return [
        Card("Jitter", f"{angle(ours.jitter_rms)} rms", f"at most {angle(ours.jitter_max)}; above 0.2 Hz"),
        Card("Drift", angle(ours.drift), "below 0.2 Hz, from where it began"),
        Card("Torque", f"{figures(100 * share, 2)} %", f"of the limit at most: {joint}{touched}", tone),
        Card("Delay margin", f"{figures(1e3 * least, 2)} ms", "of the loop that has least"),
    ]


def find_hardest_joint(row: Row) -> tuple[str, float]:
    """Return the joint whose torque comes closest to its limit, and the share of it."""
    shares = np.max([np.abs(run.tau[run.counted]).max(axis=0) / run.tau_max for run in row.runs], axis=0)
    return row.runs[0].joints[int(np.argmax(shares))], float(shares.max())


def happened(found: Verified) -> list[object]:
    """Return what happened."""
    events = [f"{controller_name(row.controller)}: {event}" for row in found.rows for event in row.happened]
    rest = [f"and {len(events) - EVENTS} more, in the JSON"] * (len(events) > EVENTS)
    return [notice("What happened", bullets([*events[:EVENTS], *rest]))] if events else []


def curves(found: Verified) -> plots.Drawing:
    """Return line of sight, cumulative spectrum and torque as a picture."""
    run, names = found.rows[0].runs[0], listed(controller_name(row.controller) for row in found.rows)
    alt = f"Line of sight over time, its cumulative spectrum, and torque as a share of its limit, for {names}"
    stretch = figures(1e3 * len(run.sight) * run.dt / min(chart.CURVE_POINTS, len(run.sight)), 2)
    caption = (
        f"Line of sight of the first run: the largest distance from its slow part in each {stretch} ms; the jitter "
        "that all frequencies up to one add up to; torque, rms as a bar and the largest as a line, and its limit."
    )
    return plots.Drawing(partial(chart.draw_camera_chart, found), alt, caption)
