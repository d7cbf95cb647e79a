"""Holding the camera still while the platform moves: what it sees, where the error goes, what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from gimbal_pin.control.controllers import BASELINE, ORACLE, OURS, TUNED
from gimbal_pin.log.limited import LEAST_SHARE_TOLD, PUSHED, describe_limits
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.result import Budget, Contest, Row
from gimbal_pin.pointing.verify import Verified
from gimbal_pin.report import camera_chart as chart
from gimbal_pin.report import plots, tables
from gimbal_pin.report.format import angle, controller_name, figures, listed
from gimbal_pin.report.html import Card, Section, bullets, cards, heading, notice, paragraph
from gimbal_pin.report.table import join
from gimbal_pin.report.view import gaze
from gimbal_pin.report.view.gaze import ASPECT, Picture, Scenery
from gimbal_pin.report.view.outlook import Outlook, outlook, shown

MOTIONS = {"S": "profile S (hand or airframe, engine and propellers)", "log": "the recorded motion"}
FALLBACK = (
    f"The controller \u201c{controller_name(OURS)}\u201d knows all that the others know; joints whose model is "
    "worth less than its uncertainty it leaves to a PID."
)
FAILED = "Sensors were failed on purpose while it ran."
EVENTS = 12
"""Most events that are listed."""
EXPOSURES = 14
"""Moments that a wide picture shows on top of each other."""
MARGIN = 1.08
"""Picture over what is in it."""
RED = "#d8321f"
OWN = chart.COLOURS[OURS]


def pointing(found: Verified, note: str = "", title: str = "Camera") -> Section:
    """Return what the camera sees on a platform that moves, the error and its parts, torque and margins.

    `note`: what the plant and the model were, as sentences.
    """
    contest = found.contest
    tone = "good" if (contest.gain or 0.0) > 1 else "fair"
    weak = any(describe_limits(row.at_limit) for row in contest.rows)
    equal = "No loop crosses higher or has a smaller disk margin: bandwidth alone would win a simulation."
    if TUNED in contest.jitter:
        equal += f" Apart from {controller_name(TUNED)}, whose margins stand where it was tuned."
    parts: list[object] = [
        paragraph(" ".join(filter(None, [headline(contest), FAILED * found.failed])), f"headline {tone}"),
        paragraph(" ".join(filter(None, [circumstances(contest), note]))),
        cards(numbers(found)),
        heading("What the camera sees"),
        gazes(outlook(contest, WANTED), WANTED),
        *diagrams(contest),
        heading("Every controller"),
        tables.contest(contest),
        *([paragraph(f"At the torque limit for long: {PUSHED}.", "side")] if weak else []),
        *[heading("Margins"), tables.equal_margins(found), paragraph(equal, "side")],
        *remarks(found),
    ]
    return Section(title, join(parts), "The platform moves; the camera should not.")


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
    what = f" {FALLBACK}" if OURS in contest.jitter else ""
    return (
        f"Simulated {times} for {figures(float(runs[0].t[-1]), 2)} s on {platform}, every controller with the same "
        f"motion, sensors, delay, torque limits and margins{own}. Jitter is the line of sight above 0.2 Hz; what is "
        f"slower is drift, which integrated gyros have whoever controls.{what}"
    )


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
    return "poor" if long >= LEAST_SHARE_TOLD else "fair" if share >= 1 else ""


def hardest(row: Row) -> tuple[str, float]:
    """Return the joint whose torque comes closest to its limit, and the share of it."""
    shares = np.max([np.abs(run.tau[run.counted]).max(axis=0) / run.tau_max for run in row.runs], axis=0)
    return row.runs[0].joints[int(np.argmax(shares))], float(shares.max())


def remarks(found: Verified) -> list[Markup]:
    """Return whose loops are too slow, and what happened."""
    rows = [(controller_name(row.controller), row) for row in found.contest.rows]
    events = [f"{who}: {event}" for who, row in rows for event in row.happened]
    events = events if len(events) <= EVENTS else [*events[:EVENTS], f"and {len(events) - EVENTS} more, in the JSON"]
    asides = {"Too slow": found.slack, "What happened": events}
    return [notice(title, bullets(lines)) for title, lines in asides.items() if lines]


def diagrams(contest: Contest) -> list[Markup]:
    """Return the budget as a bar, then the line of sight, its spectrum and the torque."""
    rows, budget = chart.drawn(contest), contest.budget
    names = listed(controller_name(row.controller) for row in rows)
    seeds = " of the first run" if len(rows[0].runs) > 1 else ""
    oracle = "; the oracle is the one that knows the motion ahead" if ORACLE in contest.jitter else ""
    alt = f"Line of sight over time, its cumulative spectrum, and torque as a share of its limit, for {names}"
    caption = (
        f"Line of sight{seeds}: the largest distance from its slow part in each {stretch(rows[0])}; the jitter that "
        f"all frequencies up to one add up to{oracle}; torque, rms as a bar and the largest as a line, and its limit."
    )
    told = budget is not None and budget.telling
    parts = [heading("Where the error goes"), budget_picture(budget)] if budget is not None and told else []
    return [*parts, heading("The line of sight, and its price"), plots.picture(partial(curves, rows), alt, caption)]


def stretch(row: Row) -> str:
    """Say how long the stretches are of which the largest error is drawn."""
    run = row.runs[0]
    return f"{figures(1e3 * len(run.sight) * run.dt / min(chart.POINTS, len(run.sight)), 2)} ms"


def budget_picture(budget: Budget) -> Markup:
    """Return the bar that splits the baseline's error."""
    said = ", ".join(f"{what} {100 * share:.1f} %" for what, share in budget.parts.items())
    caption = (
        f"{controller_name(BASELINE)}'s mean square of {angle(budget.baseline)} rms, by what knowing one thing more "
        f"takes off it, from left to right. What is left at the end, {angle(budget.left)} rms, none of them undoes."
    )
    caption += f" {budget.note[:1].upper()}{budget.note[1:]}." if budget.note else ""
    return plots.picture(partial(bar, budget), f"Error budget: {said}", caption[:1].upper() + caption[1:])


def bar(budget: Budget) -> plots.Figure:
    """Draw the budget."""
    height = 0.75 + 0.24 * -(-len(budget.parts) // 3)
    figure, panels = plots.panels(1, 1, height, left=0.12)
    axes = panels[0, 0]
    chart.budgeted(axes, budget)
    axes.set_position((0.01, 1 - 0.5 / height, 0.98, 0.5 / height))
    axes.set(xticks=[])
    axes.spines[:].set_visible(False)
    return figure


def curves(rows: Sequence[Row]) -> plots.Figure:
    """Draw line of sight, cumulative spectrum and torque."""
    figure, panels = plots.panels(2, 2, 6.0, gaps=(0.75, 0.75))
    grid = panels[0, 0].get_gridspec()
    for axes in panels[1]:
        axes.remove()
    torque = figure.add_subplot(grid[1, :])
    chart.over_time(panels[0, 0], rows)
    chart.spectra(panels[0, 1], rows)
    chart.torques(torque, rows)
    looks = chart.looks(rows)
    plots.named(panels[0, 0], [(controller_name(name), colour) for name, colour in looks.items()])
    return figure


def gazes(seen: Outlook, wanted: Array) -> Markup:
    """Return the cameras' pictures as an animation, and on top of each other as a still that can be printed."""
    several = gaze.pictures(seen)
    page = gaze.page(seen, wanted)
    played = Markup('<div class="animation"><iframe class="gaze" title="{}" srcdoc="{}"></iframe></div>').format(
        "What the cameras see", page
    )
    alt = "Pictures of the cameras on top of each other. " + "; ".join(f"{one.title}: {one.note}" for one in several)
    held = listed(controller_name(str(one.controller)) for one in seen.held)
    caption = (
        f"The same {figures(float(np.ptp(seen.t)), 2)} s as one long exposure. Above, {EXPOSURES} moments of a camera "
        "that the platform carries along and of the one that is held: horizon, hills and target. Below, the way of the "
        f"line of sight through a long lens for {held}, to one scale; what is slower than 0.2 Hz, the gyros' drift, is "
        "left out there. All that is seen is far away, so that only the camera's turning shows."
    )
    return join([played, plots.picture(partial(exposed, several, gaze.scenery(wanted)), alt, caption)])


def exposed(several: Sequence[Picture], world: Scenery) -> plots.Figure:
    """Draw the pictures on top of each other, the wide ones above, those through a long lens below."""
    columns = max(2, len(several) - 2)
    figure, panels = plots.panels(2, columns, 7.2, gaps=(0.75, 0.55), left=0.75)
    for axes in panels.flat[len(several) :]:
        axes.set_axis_off()
    across = max((reach(one) for one in several if one.long), default=0.0)
    for axes, one in zip([*panels[0, :2], *panels[1]], several):
        long_exposure(axes, one, across) if one.long else wide_exposure(axes, one, world)
        axes.set_title(one.title)
    return figure


def wide_exposure(axes: plots.Axes, one: Picture, world: Scenery) -> None:
    """Draw some moments of a wide picture: skyline, horizon, target."""
    across, moments = one.half, np.linspace(0, len(one.turned) - 1, EXPOSURES).astype(int)
    axes.set(xlim=(-across, across), ylim=(-across / ASPECT, across / ASPECT), xticks=[], yticks=[], aspect="equal")
    for turned in one.turned[moments]:
        hills, edge = gaze.placed(world.hills, turned), gaze.placed(horizon(world), turned)
        axes.plot(*hills.T, color=plots.MUTED, lw=0.9, alpha=0.4)
        axes.plot(*edge.T, color=plots.INK, lw=0.9, alpha=0.55)
        (centre,) = gaze.placed(np.array([[1.0, 0.0, 0.0]]), turned)
        for ring in one.rings:
            axes.plot(*circle(centre, np.tan(ring)).T, color=RED, lw=0.9, alpha=0.6)
    axes.plot(0, 0, "+", color=plots.INK, ms=14, mew=1.2)
    axes.grid(False)
    axes.spines[:].set_visible(True)


def way(one: Picture) -> Array:
    """Return the way of the line of sight over the target, degrees, (N, 2)."""
    return np.degrees(np.arctan([gaze.placed(np.array([[1.0, 0.0, 0.0]]), turned)[0] for turned in one.turned]))


def reach(one: Picture) -> float:
    """Half of what a picture has to hold across, degrees: what the lens does, or more where the sight leaves that."""
    return max(float(np.degrees(np.arctan(one.half))), MARGIN * float(np.abs(way(one) * [1.0, ASPECT]).max()))


def long_exposure(axes: plots.Axes, one: Picture, across: float) -> None:
    """Draw the way of the line of sight over the target, `across` degrees to either side."""
    for ring in one.rings:
        axes.plot(*circle(np.zeros(2), np.degrees(ring)).T, color=RED, lw=0.9, alpha=0.6)
    axes.plot(*way(one).T, color=plots.INK, lw=0.8)
    axes.set(xlim=(-across, across), ylim=(-across / ASPECT, across / ASPECT), aspect="equal")
    axes.set(xlabel="degrees", ylabel="degrees")


def circle(centre: Array, radius: float) -> Array:
    """Return points on a circle, (K, 2)."""
    angle = np.linspace(0, 2 * np.pi, 49)
    return np.asarray(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def horizon(world: Scenery) -> Array:
    """Return directions on the horizon from left to right, (K, 3): the skyline without its height."""
    return np.asarray(world.hills - np.outer(world.hills @ world.up, world.up))
