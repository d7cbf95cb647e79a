"""Where the camera's error goes: the budget, the line of sight and its price, and models that are wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import degrees, isfinite

from markupsafe import Markup

from gimbal_pin.control.controllers import BASELINE, ORACLE, OURS
from gimbal_pin.pointing import chart
from gimbal_pin.pointing.budget import Budget
from gimbal_pin.pointing.contest import Contest, Row
from gimbal_pin.pointing.sweep import Sweep
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.html import heading, paragraph
from gimbal_pin.report.pages.numbers import figures, listed
from gimbal_pin.report.view.names import controller_name

OWN = chart.COLOURS[OURS]


def angle(value: float) -> str:
    """Return an angle, rad, in degrees."""
    return f"{figures(degrees(value), 2)}°"


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


def wrong_models(sweep: Sweep) -> list[Markup]:
    """Return jitter against the model's error."""
    said = f"{sweep.sentence[:1].upper()}{sweep.sentence[1:]}."
    sides = " (left), and along what the log left least certain, in standard deviations (right)"
    caption = (
        f"Jitter of {figures(sweep.seconds, 2)} s with models that are wrong on purpose: all masses, moments and "
        f"inertias by one share{sides if sweep.uncertain else ''}. "
        f"Dashed: the {controller_name(BASELINE)}, which takes nothing but inertias from the model."
    )
    drawn = plots.picture(partial(against_error, sweep), f"Jitter against the model's error. {said}", caption)
    return [heading("How wrong the model may be"), paragraph(said), drawn]


def against_error(sweep: Sweep) -> plots.Figure:
    """Draw jitter against the model's error, per cent and, where the model has a covariance, standard deviations."""
    swept = [(sweep.scaled, 100.0), ({**sweep.uncertain, 0.0: sweep.scaled[0.0]}, 1.0)]
    swept = swept if sweep.uncertain else swept[:1]
    figure, (panels,) = plots.panels(1, len(swept), 2.6, share=(False, True))
    for axes, (found, unit) in zip(panels, swept):
        errors = [error for error in sorted(found) if isfinite(found[error])]
        axes.plot(
            [unit * error for error in errors], [degrees(found[error]) for error in errors], "o-", color=OWN, ms=3.5
        )
        axes.axhline(degrees(sweep.pid), color=chart.COLOURS[BASELINE], ls="--", lw=1.2)
    panels[0].set(xlabel="error of masses and inertias, %", ylabel="jitter, ° rms", ylim=(0, None))
    for axes in panels[1:]:
        axes.set(xlabel="error along what is least certain, standard deviations")
    pid = controller_name(BASELINE)
    plots.named(panels[0], [(controller_name(OURS), OWN), (pid, chart.COLOURS[BASELINE])], dashed=[pid])
    return figure


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
