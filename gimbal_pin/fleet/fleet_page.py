"""A fleet as a person reads it: in a terminal, and as one page that shows who is not like the others, in what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import shortened
from gimbal_pin.fleet.fleet import Fleet, JudgedUnit, Verdict
from gimbal_pin.fleet.population import Deviation, Kind
from gimbal_pin.report import plots
from gimbal_pin.report.format import DASH, PALETTE, figures, interval
from gimbal_pin.report.html import Card, Section, cards, join, paragraph, render
from gimbal_pin.report.table import Table

if TYPE_CHECKING:
    from gimbal_pin.report.plots import Axes, Figure

FIRST = 20
"""Units that are listed one by one."""
FACTS = 4
"""Facts that are listed of one unit."""
PANELS = 6
"""Parameters that are drawn over time."""
OUTSIDE = 3.0
"""Deviation at which the axis ends, in what a unit's logs show: what lies beyond is drawn there as an arrow."""
COLOURS = {Verdict.FAIL: "poor", Verdict.RETEST: "fair", Verdict.PASS: "good"}


def _summarise(found: Fleet) -> str:
    """How many units pass, in a sentence."""
    counts = found.counts
    against = f", against {found.reference}" if found.reference else ""
    logs = f"{found.logs} logs, {found.failed} of which could not be used{against}"
    passing, failing, others = (counts[one] for one in Verdict)
    result = f"{passing} pass, {failing} fail, {others} to be tested again"
    return f"{found.rig}: {len(found.units)} units, {logs}: {result}."


def _list_facts(found: Fleet, unit: JudgedUnit) -> Iterator[tuple[str, str, str, str]]:
    """Yield what speaks against a unit: what, its size, how many standard deviations, since when."""
    for own in unit.deviations:
        size, half = interval(own.shift, own.shift_std)
        text = f"{'+' if own.shift > 0 else ''}{size} {half} {found.parameter_units[own.parameter]}"
        score = f"{'+' if own.score > 0 else ''}{figures(own.score, 2)}"
        since = found.since(own) or {Kind.OFFSET: "first log", Kind.DRIFT: "drifts"}[own.kind]
        yield own.parameter, text, score, since
    yield from ((cause, DASH, DASH, DASH) for cause in unit.causes)
    yield from ((shortened(error, 72), DASH, DASH, DASH) for error in unit.errors)
    if unit.uncertain:
        yield f"its logs do not tell {_join_names(unit.uncertain)}", DASH, DASH, DASH


def _join_names(names: Sequence[str]) -> str:
    """The first two names, and how many more there are."""
    return ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def _tabulate_units(found: Fleet) -> Table:
    """The units that do not pass, with what speaks against them."""
    rows = []
    for unit in [one for one in found.units if one.verdict is not Verdict.PASS][:FIRST]:
        facts = list(_list_facts(found, unit))
        more = len(facts) - FACTS
        facts = facts[:FACTS] + ([(f"and {more} more", "", "", "")] if more > 0 else [])
        reasons = ", ".join(reason.value for reason in unit.reasons)
        names = [(unit.unit, f"{unit.verdict.value}: {reasons}")] + [("", "")] * (len(facts) - 1)
        rows += [(*name, *fact) for name, fact in zip(names, facts)]
    heads = ["Unit", "Verdict", "What", "By how much", "Deviations", "Since"]
    return Table(heads, rows, texts=3, label="Units that do not pass")


def _tabulate_population(found: Fleet) -> Table:
    """The parameters over the fleet."""
    rows, has_repeats = [], any(unit.logs > 1 for unit in found.units)
    for own in found.population:
        mean, half = interval(own.mean, own.mean_std)
        repeat = own.repeat if has_repeats or found.reference else None
        numbers = (mean, half, *(figures(x, 2) for x in (own.spread, own.p_value, repeat, found.detectable[own.name])))
        rows.append((own.name, found.parameter_units[own.name], *numbers))
    heads = ["Parameter", "Unit", "Mean", "±", "Between units", "p, all alike", "Between logs", "Shown from"]
    return Table(heads, rows, texts=2, label="Parameters over the fleet")


def _tabulate_causes(found: Fleet) -> Table:
    """Causes and faults, the most common first."""
    rows = [(one.cause, one.joint or "the rig", f"{one.units} of {one.of}") for one in found.causes[:FIRST]]
    return Table(["Cause", "Joint", "Units"], rows, texts=2, label="Causes")


def summarise_fleet(found: Fleet) -> str:
    """What a terminal shows."""
    parts = [_summarise(found)]
    parts += [str(_tabulate_units(found))] if found.counts[Verdict.PASS] < len(found.units) else []
    parts += [str(_tabulate_population(found))]
    parts += [str(_tabulate_causes(found))] if found.causes else []
    return "\n\n".join(parts)


def _draw_units(found: Fleet) -> Figure:
    """Draw every log's parameters about the fleet's means; those of units that deviate in them are named."""
    height = 1.0 + 0.3 * len(found.population)
    figure, ((axes,),) = plots.panels(1, 1, height, left=2.6)
    odd = {(own.parameter, unit.unit): own for unit in found.units for own in unit.deviations}
    used = found.table[found.table["error"].isna()]
    units = used["serial"].to_numpy()
    for row, own in enumerate(found.population):
        off = (used[f"value.{own.name}"].to_numpy(dtype=float) - own.mean) / found.detectable[own.name]
        there = np.isfinite(off)
        is_odd = np.array([(own.name, unit) in odd for unit in units])
        places = row + 0.12 * (np.arange(len(off)) % 5 - 2)
        plain = there & ~is_odd
        drawn = np.clip(off[plain], -OUTSIDE, OUTSIDE), places[plain]
        if len(off) * len(found.population) > plots.POINTS:
            plots.dots(axes, *drawn, PALETTE[0])
        else:
            axes.plot(*drawn, "o", color=PALETTE[0], ms=3, alpha=0.6, clip_on=False)
        for k, unit in enumerate(sorted({*units[is_odd]})):
            mine = off[(units == unit) & there]
            ends = np.clip(mine, -OUTSIDE, OUTSIDE)
            for x, marker in ((ends[ends == mine], "o"), (ends[mine < -OUTSIDE], "<"), (ends[mine > OUTSIDE], ">")):
                axes.plot(x, np.full(len(x), float(row)), marker, color=PALETTE[1], ms=5, clip_on=False)
            x = float(ends[np.abs(mine).argmax()])
            side, shift = ("right", -7) if x > 0 else ("left", 7)
            axes.annotate(
                shortened(unit, 16),
                (x, row),
                (shift, 5 - 12 * (k % 2)),
                textcoords="offset points",
                ha=side,
                fontsize=8,
            )
    for x in (-1, 1):
        axes.axvline(x, color=plots.INK, lw=1.0, ls="--")
    axes.set_yticks(range(len(found.population)), [shortened(own.name, 36) for own in found.population])
    axes.set_ylim(len(found.population) - 0.4, -0.6)
    axes.set_xlim(-OUTSIDE, OUTSIDE)
    axes.set_xlabel("offset from the fleet's mean, in offsets that a unit's logs show")
    return figure


def _draw_changes(found: Fleet, changes: Sequence[Deviation]) -> Figure:
    """Draw a unit's parameter over time, one that began to deviate or drifts."""
    rows = -(-len(changes) // 2)
    figure, axes = plots.panels(rows, 2, 0.9 + 1.9 * rows, gaps=(0.75, 0.85))
    means = {own.name: own.mean for own in found.population}
    for panel, own in zip(axes.flat, changes):
        mine = found.table[(found.table["serial"] == own.unit) & found.table["error"].isna()].sort_values("time")
        values, std = (mine[f"{kind}.{own.parameter}"].to_numpy(dtype=float) for kind in ("value", "std"))
        _draw_band(panel, means[own.parameter], found.detectable[own.parameter])
        times = mine["time"].to_numpy(dtype=float)
        x = times.astype("datetime64[s]") if found.is_dated else times
        panel.errorbar(x, values, 1.96 * std, fmt="o-", color=PALETTE[1], ms=4, lw=1.2)
        if found.is_dated:
            _label_dates(panel)
        panel.set_title(shortened(f"{own.unit}: {own.parameter}", 44))
        panel.set_ylabel(found.parameter_units[own.parameter])
    for panel in axes.flat[len(changes) :]:
        panel.set_axis_off()
    return figure


def _draw_band(axes: Axes, mean: float, half: float) -> None:
    """Draw the fleet's mean, and what a unit's logs do not tell from it."""
    axes.axhspan(mean - half, mean + half, color=plots.PLAIN, alpha=0.2)
    axes.axhline(mean, color=plots.PLAIN, lw=1.0)


def _label_dates(axes: Axes) -> None:
    """Let a panel's axis of dates have few labels."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=3, maxticks=6)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))


def render_fleet(found: Fleet) -> str:
    """Return the comparison as HTML."""
    counts = found.counts
    titles = {Verdict.FAIL: "Fail", Verdict.RETEST: "Test again", Verdict.PASS: "Pass"}
    top = [
        Card(title, str(counts[verdict]), f"of {len(found.units)} units", COLOURS[verdict] if counts[verdict] else "")
        for verdict, title in titles.items()
    ]
    top.append(Card("Logs", str(found.logs), f"{found.failed} could not be used", "fair" if found.failed else "good"))
    rest = len(found.units) - counts[Verdict.PASS]
    listed: list[object] = [_tabulate_units(found)] if rest else []
    listed += [paragraph(f"{rest - FIRST} more are in the JSON.")] if rest > FIRST else []
    sections = [Section("Verdict", join([paragraph(_summarise(found)), cards(top), *listed]))]
    strip = plots.picture(
        partial(_draw_units, found),
        "Every log's parameters about the fleet's means",
        "A dot per log. Dashed: the offset that the median unit's logs show in one of two cases. Named: units that are "
        "not like their siblings; an arrow is beyond the axis.",
    )
    sections.append(Section("Parameters", join([strip, _tabulate_population(found)])))
    changes = [own for unit in found.units for own in unit.deviations if own.kind is not Kind.OFFSET][:PANELS]
    if changes:
        drawn = plots.picture(
            partial(_draw_changes, found, changes),
            "Parameters that changed, over time",
            "Each log with its 95 % interval; grey: the fleet's mean, and what a unit's logs do not tell from it.",
        )
        sections.append(Section("Changes", join([drawn])))
    if found.causes:
        sections.append(
            Section("Causes", join([_tabulate_causes(found)]), "What diagnose names, and of how many units.")
        )
    return render(f"Fleet: {found.rig}", sections, found.payload or "")
