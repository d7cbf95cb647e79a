"""Holding the camera still while the platform moves: what it sees, where the error goes, what it costs."""

from __future__ import annotations

from math import degrees, isnan

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.controllers import BASELINE, ORACLE, OURS, TUNED
from gimbal_pin.control.laws import Margins
from gimbal_pin.log.limited import PUSHED, SPOKEN, limited
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.contest import Contest, Row
from gimbal_pin.pointing.loops import distinct
from gimbal_pin.pointing.outlook import outlook, shown
from gimbal_pin.pointing.verify import Verified
from gimbal_pin.report.pages.base import Section
from gimbal_pin.report.pages.html import Card, Content, bullets, cards, heading, join, notice, paragraph, table, toned
from gimbal_pin.report.pages.numbers import DASH, figures, listed
from gimbal_pin.report.pages.sections.experiments import marked
from gimbal_pin.report.pages.sections.gaze import gazes
from gimbal_pin.report.pages.sections.jitter import angle, diagrams, wrong_models
from gimbal_pin.report.pages.sections.margins import GAIN_DB, PHASE_DEG, tone
from gimbal_pin.report.view.names import controller_name

MOTIONS = {"S": "profile S (hand or airframe, engine and propellers)", "log": "the recorded motion"}
SWITCH = (
    f"The {OURS} is model-based control with all that the others know; joints whose model is worth less than its "
    "uncertainty it leaves to a PID."
)
FAILED = "Sensors were failed on purpose while it ran."
EVENTS = 12
"""Most events that are told."""
VERDICTS = {"aim": "good", "must": "good", "missed": "poor"}


def pointing(found: Verified, note: str = "", title: str = "Camera") -> Section:
    """Return what the camera sees on a platform that moves, the error and its parts, torque and margins.

    `note`: what the plant and the model were, as sentences.
    """
    contest = found.contest
    said = filter(None, [headline(contest), FAILED * found.failed, missing(found)])
    parts = [
        paragraph(" ".join(said), f"headline {praise(found)}"),
        paragraph(" ".join(filter(None, [circumstances(contest), note, asked_for(found)]))),
        cards(numbers(found)),
        heading("What the camera sees"),
        gazes(outlook(contest, WANTED), WANTED),
        *diagrams(contest),
        *([] if found.sweep is None else wrong_models(found.sweep)),
        heading("Every controller"),
        controllers(contest),
        *([targets(found)] if found.targets else []),
        *margins(found),
        *told(found),
    ]
    return Section(title, join(parts), "The platform moves; the camera should not.")


def missing(found: Verified) -> str:
    """Say which bounds are missed, if any."""
    names = [target.name for target in found.targets if target.verdict == "missed"]
    missed = "A must is" if len(names) == 1 else "Musts are"
    return f"{missed} missed: {listed(names)}." if names else ""


def praise(found: Verified) -> str:
    """Return the headline's tone: nothing is praised that misses a bound."""
    return "poor" if missing(found) else "good" if (found.contest.gain or 0.0) > 1 else "fair"


def headline(contest: Contest) -> str:
    """Say how still the camera stands: at equal margins where that ran, and beside it with the gains asked for."""
    rows = compared(contest)
    ours = f"{controller_name(rows[-1].controller)} leaves {angle(rows[-1].jitter_rms)} rms of jitter"
    if len(rows) < 2:
        return f"{ours[:1].upper()}{ours[1:]}."
    theirs, times = rows[0].jitter_rms, rows[0].jitter_rms / rows[-1].jitter_rms
    said = f"{ours[:1].upper()}{ours[1:]}, {controller_name(rows[0].controller)} {angle(theirs)}"
    said = f"{said}: {figures(times, 2)} times as much" if times > 1 else said
    if rows[-1].controller == TUNED:
        return f"{said}, each with margins of its own."
    tuned = contest.jitter.get(TUNED)
    own = "" if tuned is None else f" {controller_name(TUNED).capitalize()}: {angle(tuned)}, with margins of its own."
    return f"{said}{' at equal margins' if own else ''}.{own}"


def compared(contest: Contest) -> tuple[Row, ...]:
    """Return the baseline's row and ours at equal margins; the one with the gains asked for where that alone ran."""
    return shown(contest, (OURS, TUNED))


def circumstances(contest: Contest) -> str:
    """Say what was simulated."""
    runs = contest.rows[0].runs
    own = " (but for the gains asked for, which have their own)" if TUNED in contest.jitter else ""
    times = "once" if len(runs) == 1 else f"{len(runs)} times, each with its own motion and noise"
    platform = MOTIONS.get(runs[0].platform, runs[0].platform)
    what = f" {SWITCH}" if OURS in contest.jitter else ""
    return (
        f"Simulated {times} for {figures(float(runs[0].t[-1]), 2)} s on {platform}, every controller with the same "
        f"motion, sensors, delay, torque limits and margins{own}. Jitter is the line of sight above 0.2 Hz; what is "
        f"slower is drift, which integrated gyros have whoever controls.{what}"
    )


def asked_for(found: Verified) -> str:
    """Say which motors are too weak for a recorded motion, whoever controls them."""
    demand = found.demand
    if demand is None or found.contest.rows[0].runs[0].platform != "log":
        return ""
    limits = dict(zip(demand.joints, demand.tau_max.tolist()))
    weak = listed(f"{figures(demand.peak[j])} N m of {j}, which has {figures(limits[j])}" for j in demand.weak)
    said = f"At its worst the motion asks for {weak}: there no controller holds the camera."
    blind, seeing = demand.least["unforeseen"], demand.least["foreseen"]
    if isnan(blind):
        return said
    bound = f"These limits alone leave any of them {angle(blind)} rms, or {angle(seeing)} if it foresees the motion"
    return f"{said} {bound}, unless it rolls the camera instead."


def numbers(found: Verified) -> list[Card]:
    """Return the headline numbers."""
    best, margin = compared(found.contest)[-1], found.margins
    joint, share = hardest(best)
    long = best.at_limit[joint]
    touched = f", and at it {figures(100 * long, 2)} % of the time" if long > 0 else ""
    disk = f"every loop's disk margin at least {figures(margin.disk_margin)}"
    distance, who = found.contest.distance, controller_name(best.controller)
    beside = "of the line of sight, above 0.2 Hz" if distance is None else f"{figures(distance)} times the oracle's"
    return [
        Card("Jitter", f"{angle(best.jitter_rms)} rms", f"{who}; at most {angle(best.jitter_max)}; {beside}"),
        Card("Drift", angle(best.drift), "below 0.2 Hz, from where it began"),
        Card("Torque", f"{figures(100 * share, 2)} %", f"of the limit at most: {joint}{touched}", strain(share, long)),
        Card("Delay margin", f"{figures(1e3 * margin.delay_margin, 2)} ms", f"of the PID; {disk}"),
    ]


def strain(share: float, long: float) -> str:
    """Return the tone of a largest share of the torque limit, reached for so much of the time."""
    return "poor" if long >= SPOKEN else "fair" if share >= 1 else ""


def hardest(row: Row) -> tuple[str, float]:
    """Return the joint whose torque comes closest to its limit, and the share of it."""
    shares = np.max([np.abs(run.tau[run.counted]).max(axis=0) / run.tau_max for run in row.runs], axis=0)
    return row.runs[0].joints[int(np.argmax(shares))], float(shares.max())


def controllers(contest: Contest) -> Markup:
    """Return the table of all controllers."""
    rows = contest.rows
    head: list[Content] = ["Controller", "Jitter, ° rms", "Largest, °", "Drift, °"]
    head += [f"{joint}, N m rms" for joint in rows[0].runs[0].joints] + ["At torque limit, of the time"]
    fair = [row for row in rows if row.controller != ORACLE]  # it cannot be built, and competes with nobody
    body: list[list[Content]] = []
    jitters, largest = [row.jitter_rms for row in fair], [row.jitter_max for row in fair]
    for row in rows:
        own: list[Content] = [controller_name(row.controller)]
        for value, every in ((row.jitter_rms, jitters), (row.jitter_max, largest)):
            own.append(marked(figures(degrees(value)), value, every))
        own += [figures(degrees(row.drift)), *(figures(torque) for torque in row.torque_rms.values())]
        own += [limited(row.at_limit) or f"{figures(100 * max(row.at_limit.values()), 2)} %"]
        body.append(own)
    drawn = table(head, body, label="Controllers on the platform")
    weak = any(limited(row.at_limit) for row in rows)
    return join([drawn, paragraph(f"At the torque limit for long: {PUSHED}.", "side")]) if weak else drawn


def targets(found: Verified) -> Markup:
    """Return the figures that are asked for, beside their bounds."""
    rows: list[list[Content]] = [
        [
            target.name,
            DASH if target.value is None else figures(target.value),
            figures(target.must),
            figures(target.aim),
            toned(target.verdict, VERDICTS[target.verdict]) if target.verdict in VERDICTS else target.verdict,
        ]
        for target in found.targets
    ]
    notes = [f"{target.name}: {target.note}." for target in found.targets if target.note and target.value is not None]
    judged = table(["Target", "Reached", "Must", "Aim", "Verdict"], rows, caption="Targets")
    return join([judged, *(paragraph(note, "side") for note in notes)])


def margins(found: Verified) -> list[Markup]:
    """Return the margins of every controller's loops, joint by joint."""
    loops = found.loops or {BASELINE: (found.margins,) * len(found.joints)}
    rows = [
        [listed(map(controller_name, names)), listed(joints), *margin_row(own)]
        for names, joints, own in distinct(loops, found.joints)
    ]
    head: list[Content] = ["Controllers", "Joints", "Crossover", "Phase margin", "Gain margin", "Disk margin"]
    head += ["Delay margin"]
    said = "No loop crosses higher or has a smaller disk margin: bandwidth alone would win a simulation."
    if any(row.controller == TUNED for row in found.contest.rows):
        said += f" Apart from {controller_name(TUNED)}, whose margins stand where it was tuned."
    return [heading("Margins"), table(head, rows, label="Margins of the loops"), paragraph(said, "side")]


def margin_row(own: Margins) -> list[Content]:
    """Return one loop's margins."""
    return [
        f"{figures(own.crossover_hz)} Hz",
        toned(f"{figures(own.phase_margin_deg)}°", tone(own.phase_margin_deg, PHASE_DEG)),
        toned(f"{figures(own.gain_margin_db)} dB", tone(own.gain_margin_db, GAIN_DB)),
        figures(own.disk_margin),
        f"{figures(1e3 * own.delay_margin)} ms",
    ]


def told(found: Verified) -> list[Markup]:
    """Return what is compensated, what is not, who is unstable, and what happened."""
    every = [(controller_name(row.controller), swing) for row in found.contest.rows for swing in row.swings]
    swings = [
        f"{who}: {swing.joint} swings by itself at {figures(swing.hz, 2)} Hz, with "
        f"{figures(100 * swing.share, 2)} % of its torque limit (rms): its figures say nothing."
        for who, swing in every
    ]
    events = [f"{controller_name(row.controller)}: {event}" for row in found.contest.rows for event in row.happened]
    parts = [heading("Compensated"), bullets(found.causes)] if found.causes else []
    parts += [heading("Planted and not compensated"), bullets(found.missed)] if found.missed else []
    parts += [notice("Unstable", bullets(swings))] if swings else []
    parts += [notice("Too slow", bullets(found.slack))] if found.slack else []
    more = [f"and {len(events) - EVENTS} more, all in the JSON"] if len(events) > EVENTS else []
    return [*parts, notice("What happened", bullets([*events[:EVENTS], *more]))] if events else parts
