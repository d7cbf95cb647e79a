"""A Monte Carlo study as a person reads it: in a terminal, and as one page with the figures' distributions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gimbal_pin.fleet.montecarlo import SHOWN, MonteCarlo
from gimbal_pin.fleet.study import PLATFORM, SCALES, STEPS
from gimbal_pin.report import plots
from gimbal_pin.report.format import PALETTE, figures, percent
from gimbal_pin.report.html import Card, Section, cards, paragraph, render
from gimbal_pin.report.table import Table, join

if TYPE_CHECKING:
    from gimbal_pin.report.plots import Figure

ACROSS = 2
"""Distributions in a row."""
MOST = 40
"""Most columns of a distribution."""


def format_figure(found: MonteCarlo, name: str, value: float | None) -> str:
    """Return a figure's value as people read it."""
    return figures(None if value is None else value / find_scale(found, name))


def find_scale(found: MonteCarlo, name: str) -> float:
    """Return a figure's unit for people in SI units."""
    unit = found.units[name]
    return SCALES.get(unit, {unit: 1.0})[unit]


def label_figure(found: MonteCarlo, name: str) -> str:
    """Return a figure's name with its unit."""
    return f"{name}, {found.units[name] or 'share of the limit'}"


def describe_yield(found: MonteCarlo) -> str:
    """How many rigs meet what was asked for, in a sentence."""
    rigs = f"{found.count} rig{'s' * (found.count != 1)}"
    rigs += f", {found.failed} of which could not be simulated" if found.failed else ""
    if found.yield_ is None:
        return f"{found.rig}: {rigs}; nothing was asked of them."
    own, asked = found.yield_, " and ".join(limit.text for limit in found.specification)
    interval = f"95 % confidence: {percent(100 * own.low)} to {percent(100 * own.high)} of {own.of}"
    return f"{found.rig}: {percent(100 * own.value)} meet {asked} ({interval}); {rigs}."


def tabulate_spreads(found: MonteCarlo) -> Table:
    """The figures' medians and tails."""
    rows = [
        (label_figure(found, name), *(format_figure(found, name, x) for x in (own.median, own.p5, own.p95, own.worst)))
        for name, own in found.figures.items()
    ]
    return Table(["Figure", "Median", "5 %", "95 %", "Worst"], rows, label="Figures")


def tabulate_influences(found: MonteCarlo) -> Table:
    """What each input does, largest first."""
    if any(own.total is not None for own in found.sensitivity):
        rows: list[Sequence[str]] = [
            (own.input, *map(figures, (own.first, own.first_confidence, own.total, own.total_confidence)))
            for own in found.sensitivity[:SHOWN]
        ]
        return Table(["Input", "First order", "±", "Total", "±"], rows, label="Sobol indices")
    rows = [(own.input, figures(own.rank_correlation)) for own in found.sensitivity[:SHOWN]]
    used = "the share of the specification used" if found.specification else next(iter(found.units))
    return Table(["Input", f"Rank correlation with {used}"], rows, label="Rank correlations")


def tabulate_worst(found: MonteCarlo) -> Table:
    """The rigs that use most of the specification, with what costs most of it."""
    asked = list(dict.fromkeys(limit.figure for limit in found.specification)) or list(found.units)[:1]
    inputs = [own.input for own in found.sensitivity[:3]]
    has_errors = any(row["error"] for row in found.worst)
    rows: list[Sequence[Any]] = [
        (
            str(row["unit"]),
            *([row["error"] or ""] if has_errors else []),
            *(format_figure(found, name, row[name]) for name in asked),
            *(figures(row[name]) for name in inputs),
        )
        for row in found.worst
    ]
    heads = ["Rig", *(["Error"] if has_errors else []), *(label_figure(found, name) for name in asked), *inputs]
    return Table(heads, rows, texts=1 + has_errors, label="Worst rigs")


def summarise_monte_carlo(found: MonteCarlo) -> str:
    """What a terminal shows."""
    parts = [describe_yield(found), str(tabulate_spreads(found))]
    parts += [str(tabulate_influences(found))] if found.sensitivity else []
    return "\n\n".join([*parts, str(tabulate_worst(found))])


def draw_distributions(found: MonteCarlo, names: Sequence[str]) -> Figure:
    """Draw how figures are spread, and where the specification ends."""
    rows = -(-len(names) // ACROSS)
    figure, axes = plots.panels(rows, ACROSS, 0.65 + 1.9 * rows, right=0.3, top=0.1, gaps=(0.75, 0.75))
    bounds = {limit.figure: limit.bound for limit in found.specification}
    for panel, name in zip(axes.flat, names):
        values = found.table[name].to_numpy(dtype=float) / find_scale(found, name)
        there = values[np.isfinite(values)]
        panel.hist(there, min(MOST, 1 + round(len(there) ** 0.5)), color=PALETTE[0])
        panel.locator_params(axis="x", nbins=6)
        if name in bounds:
            panel.axvline(bounds[name] / find_scale(found, name), color=plots.INK, lw=1.2, ls="--")
        panel.set_xlabel(label_figure(found, name))
        panel.set_ylabel("rigs")
    for panel in axes.flat[len(names) :]:
        panel.set_axis_off()
    return figure


def render_monte_carlo(found: MonteCarlo) -> str:
    """Return the study as HTML."""
    asked = {limit.figure for limit in found.specification}
    names = [name for name in found.figures if name in asked or name in STEPS or name in PLATFORM]
    own = found.yield_
    top = [
        Card("Rigs", str(found.count), f"{len(found.inputs)} inputs vary"),
        Card("Not simulated", str(found.failed), "impossible, or diverged", "poor" if found.failed else "good"),
    ]
    if own is not None:
        top.insert(
            0,
            Card(
                "Yield",
                percent(100 * own.value),
                f"{percent(100 * own.low)} to {percent(100 * own.high)}, 95 % confidence",
            ),
        )
    drawn = "Histograms of the figures over all rigs"
    dashed = "All rigs that could be simulated; dashed: the specification."
    picture = plots.picture(partial(draw_distributions, found, names), drawn, dashed)
    sections = [
        Section("Yield", join([paragraph(describe_yield(found)), cards(top)])),
        Section("Distributions", join([picture, tabulate_spreads(found)])),
    ]
    if found.sensitivity:
        lead = "What each input does to how much of the specification a rig uses; without one, to the first figure."
        sections.append(Section("What costs most", join([tabulate_influences(found)]), lead))
    sections.append(Section("The worst", join([tabulate_worst(found)]), "Rigs that failed, then those that use most."))
    return render(f"Monte Carlo: {found.rig}", sections, found.payload or "")
