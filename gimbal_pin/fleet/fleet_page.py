"""A fleet as a person reads it: in a terminal, and as one page that shows who is not like the others, in what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import shortened
from gimbal_pin.fleet.fleet import Fleet, JudgedUnit, Verdict
from gimbal_pin.fleet.population import Deviation, DeviationKind
from gimbal_pin.report import plots
from gimbal_pin.report.format import DASH, PALETTE, figures, interval
from gimbal_pin.report.html import Card, Section, cards, folded, join, paragraph, render
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
    units, logs = (f"{n} {word}{'s' * (n != 1)}" for n, word in ((len(found.units), "unit"), (found.logs, "log")))
    failed = f", {found.failed} of which could not be used" if found.failed else ""
    against = f", against {found.reference}" if found.reference else ""
    passing, failing, others = (found.counts[one] for one in Verdict)
    result = f"{passing} pass, {failing} fail" + (f", {others} to be tested again" if others else "")
    return f"{found.rig}: {units}, {logs}{failed}{against}: {result}."


def _list_passing(found: Fleet) -> list[str]:
    """Serial numbers of the units that pass."""
    return [one.unit for one in found.units if one.verdict is Verdict.PASS]


def _list_facts(found: Fleet, unit: JudgedUnit, longest: int | None) -> Iterator[tuple[str, str, str, str]]:
    """Yield what speaks against a unit: what, its size, how many standard deviations, since when.

    `longest`: characters of an error; None: all.
    """
    for own in unit.deviations:
        size, half = interval(own.shift, own.shift_std)
        text = f"{'+' if own.shift > 0 else ''}{size} {half} {found.parameter_units[own.parameter]}"
        score = f"{'+' if own.score > 0 else ''}{figures(own.score, 2)}"
        since = found.since(own) or {DeviationKind.OFFSET: "first log", DeviationKind.DRIFT: "drifts"}[own.kind]
        yield own.parameter, text, score, since
    yield from ((str(own), DASH, DASH, own.since or "first log") for own in unit.causes)
    yield from ((shortened(error, longest or len(error)), DASH, DASH, DASH) for error in unit.errors)
    if unit.uncertain:
        yield f"its logs do not tell {_join_names(unit.uncertain, 2)}", DASH, DASH, DASH


def _join_names(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _tabulate_units(found: Fleet, longest: int | None = None) -> Table:
    """The units that do not pass, with what speaks against them; errors shortened to `longest` characters."""
    rows = []
    for unit in [one for one in found.units if one.verdict is not Verdict.PASS][:FIRST]:
        facts = list(_list_facts(found, unit, longest))
        more = len(facts) - FACTS
        facts = facts[:FACTS] + ([(f"and {more} more", "", "", "")] if more > 0 else [])
        reasons = ", ".join(reason.value for reason in unit.reasons)
        names = [(unit.unit, f"{unit.verdict.value}: {reasons}")] + [("", "")] * (len(facts) - 1)
        rows += [(*name, *fact) for name, fact in zip(names, facts)]
    heads = ["Unit", "Verdict", "What", "By how much", "Deviations", "Since"]
    return Table(heads, rows, texts=3, label="Units that do not pass")


def _name_population(found: Fleet) -> str:
    """Whose parameters those of `Fleet.population` are."""
    return "Parameters of the reference fleet" if found.reference else "Parameters over the fleet"


def _tabulate_population(found: Fleet) -> Table:
    """The parameters over the fleet that units are judged against."""
    rows, has_repeats = [], any(unit.logs > 1 for unit in found.units)
    for own in found.population:
        mean, half = interval(own.mean, own.mean_std)
        repeat = own.repeat if has_repeats or found.reference else None
        numbers = (mean, half, *(figures(x, 2) for x in (own.spread, own.p_value, repeat, found.detectable[own.name])))
        rows.append((own.name, found.parameter_units[own.name], *numbers))
    heads = ["Parameter", "Unit", "Mean", "±", "Between units", "p, all alike", "Between logs", "Shown from"]
    return Table(heads, rows, texts=2, caption=_name_population(found))


def _tabulate_causes(found: Fleet) -> Table:
    """Causes and faults, the most common first."""
    rows = [(one.cause, one.joint or "the rig", f"{one.units} of {one.of}") for one in found.causes[:FIRST]]
    return Table(["Cause", "Joint", "Units"], rows, texts=2, label="Causes")


def summarise_fleet(found: Fleet) -> str:
    """What a terminal shows."""
    passing = _list_passing(found)
    parts = [_summarise(found)]
    parts += [str(_tabulate_units(found, 72))] if len(passing) < len(found.units) else []
    parts += [f"Pass: {_join_names(passing, FIRST)}"] if passing else []
    parts += [f"{_name_population(found)}:\n{_tabulate_population(found)}"]
    parts += [str(_tabulate_causes(found))] if found.causes else []
    return "\n\n".join(parts)


def _draw_units(found: Fleet) -> Figure:
    """Draw every log's parameters about the fleet's means; those of units that deviate in them are named."""
    height = 0.75 + 0.3 * len(found.population)
    figure, ((axes,),) = plots.panels(1, 1, height, left=2.6, top=0.1)
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
    whose = "reference fleet" if found.reference else "fleet"
    axes.set_xlabel(f"offset from the {whose}'s mean, in offsets that a unit's logs show")
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
    unusable = f"{found.failed} could not be used" if found.failed else "all could be used"
    top.append(Card("Logs", str(found.logs), unusable, "fair" if found.failed else "good"))
    rest = len(found.units) - counts[Verdict.PASS]
    listed: list[object] = [_tabulate_units(found)] if rest else []
    listed += [paragraph(f"{rest - FIRST} more are in the JSON.")] if rest > FIRST else []
    if passing := _list_passing(found):
        line = f"Pass: {_join_names(passing, FIRST)}"
        listed.append(folded(line, paragraph(", ".join(passing))) if len(passing) > FIRST else paragraph(line))
    sections = [Section("Verdict", join([paragraph(_summarise(found)), cards(top), *listed]))]
    strip = plots.picture(
        partial(_draw_units, found),
        "Every log's parameters about the fleet's means",
        "A dot per log. Dashed: the offset that the median unit's logs show in one of two cases. Named: units that are "
        "not like their siblings; an arrow is beyond the axis. A dot beyond the dashes without a name is of a unit "
        "whose logs, together, do not tell it from its siblings, such as an uncertain one.",
    )
    sections.append(Section("Parameters", join([strip, _tabulate_population(found)])))
    changes = [own for unit in found.units for own in unit.deviations if own.kind is not DeviationKind.OFFSET][:PANELS]
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
