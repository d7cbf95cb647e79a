"""A Monte Carlo study and a fleet as a person reads them: the same sections in a terminal and as one page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import NORMAL_95, shortened
from gimbal_pin.fleet.fleet import Fleet, JudgedUnit, Verdict
from gimbal_pin.fleet.montecarlo import SHOWN, MonteCarlo
from gimbal_pin.fleet.population import Deviation, DeviationKind
from gimbal_pin.fleet.study import PLATFORM, SCALES, STEPS
from gimbal_pin.report import plots
from gimbal_pin.report.elements import Card, Document, Section, Table, cards, folded, paragraph
from gimbal_pin.report.format import DASH, PALETTE, figures, interval, percent

if TYPE_CHECKING:
    from gimbal_pin.report.plots import Axes, Figure

FIRST = 20
"""Units and causes that are listed one by one."""
FACTS = 4
"""Facts that are listed of one unit."""
PANELS = 6
"""Parameters that are drawn over time."""
OUTSIDE = 3.0
"""Deviation at which the axis ends, in what a unit's logs show: what lies beyond is drawn there as an arrow."""


def _make_panels(count: int, top: float) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with so many panels, two in a row, with room for titles at the `top`, in."""
    rows = -(-count // 2)
    figure, axes = plots.panels(
        rows, 2, 0.55 + top + 1.9 * rows, right=0.3, top=top, gaps=(0.75, 0.8)
    )
    for panel in axes.flat[count:]:
        panel.set_axis_off()
    return figure, axes.flat[:count]


# -- a Monte Carlo study -----------------------------------------------------------------------------------------------


def describe_monte_carlo(found: MonteCarlo) -> Document:
    """Return how many rigs meet what was asked for, how the figures are spread, what costs most, and the worst."""
    failed = Card(
        "Not simulated",
        str(found.failed),
        "impossible, or diverged",
        "poor" if found.failed else "good",
    )
    top = [Card("Rigs", str(found.count), f"{len(found.inputs)} inputs vary"), failed]
    said = f"{found.count} rig{'s' * (found.count != 1)}"
    said += f", {found.failed} of which could not be simulated" if found.failed else ""
    if own := found.yield_:
        share, low, high = (percent(100 * x) for x in (own.value, own.low, own.high))
        top.insert(0, Card("Yield", share, f"{low} to {high}, 95 % confidence"))
        asked = " and ".join(limit.text for limit in found.specification)
        said = f"{share} meet {asked} (95 % confidence: {low} to {high} of {own.of}); {said}."
    else:
        said += "; nothing was asked of them."
    picture = plots.Drawing(
        partial(_draw_distributions, found),
        "Histograms of the figures over all rigs",
        "All rigs that could be simulated; dashed: the specification.",
    )
    lead = "What each input does to how much of the specification a rig uses; without one, to the first figure."
    sections = [
        Section("Yield", [paragraph(f"{found.rig}: {said}"), cards(top)]),
        Section("Distributions", [picture, _tabulate_spreads(found)]),
        Section("What costs most", [_tabulate_influences(found)] if found.inputs else [], lead),
        Section(
            "The worst", [_tabulate_worst(found)], "Rigs that failed, then those that use most."
        ),
    ]
    return Document(f"Monte Carlo: {found.rig}", found.payload or "", sections)


def _format_figure(unit: str, value: float | None) -> str:
    """Return a figure's value in its unit for people."""
    return figures(None if value is None else value / SCALES[unit])


def _label_figure(found: MonteCarlo, name: str) -> str:
    """Return a figure's name with its unit."""
    return f"{name}, {found.units[name] or 'share of the limit'}"


def _tabulate_spreads(found: MonteCarlo) -> Table:
    """The figures' medians and tails."""
    rows = [
        (_label_figure(found, name), *(_format_figure(found.units[name], x) for x in spread))
        for name, *spread in found.figures.itertuples()
    ]
    return Table(["Figure", "Median", "5 %", "95 %", "Worst"], rows, label="Figures")


def _tabulate_influences(found: MonteCarlo) -> Table:
    """What each input does, largest first."""
    first = found.sensitivity[:SHOWN].drop(columns="rank_correlation")
    if first["total"].notna().any():
        rows = [(name, *map(figures, own)) for name, *own in first.itertuples()]
        return Table(
            ["Input", "First order", "± 95 %", "Total", "± 95 %"], rows, label="Sobol indices"
        )
    used = "the share of the specification used" if found.specification else next(iter(found.units))
    ranks = [
        (name, figures(x)) for name, x in found.sensitivity["rank_correlation"][:SHOWN].items()
    ]
    return Table(["Input", f"Rank correlation with {used}"], ranks, label="Rank correlations")


def _tabulate_worst(found: MonteCarlo) -> Table:
    """The rigs that use most of the specification, with what costs most of it."""
    asked = (
        list(dict.fromkeys(limit.figure for limit in found.specification)) or list(found.units)[:1]
    )
    inputs = list(found.sensitivity.index[:3])
    errors = ["error"] * any(row["error"] for row in found.worst)
    rows = [
        (
            str(row["unit"]),
            *(row[name] or "" for name in errors),
            *(_format_figure(found.units[name], row[name]) for name in asked),
            *(figures(row[name]) for name in inputs),
        )
        for row in found.worst
    ]
    heads = [
        "Rig",
        *(name.title() for name in errors),
        *(_label_figure(found, name) for name in asked),
        *inputs,
    ]
    return Table(heads, rows, texts=1 + len(errors), label="Worst rigs")


def _draw_distributions(found: MonteCarlo) -> Figure:
    """Draw how the main figures and those that were asked for are spread, and where the specification ends."""
    bounds = {limit.figure: limit.bound for limit in found.specification}
    names = [name for name in found.figures.index if name in {*bounds, *STEPS, *PLATFORM}]
    figure, panels = _make_panels(len(names), top=0.1)
    for panel, name in zip(panels, names):
        scale = SCALES[found.units[name]]
        values = found.table[name].to_numpy(dtype=float)
        there = values[np.isfinite(values)] / scale
        panel.hist(there, min(40, 1 + round(len(there) ** 0.5)), color=PALETTE[0])
        panel.locator_params(axis="x", nbins=6)
        if name in bounds:
            panel.axvline(bounds[name] / scale, color=plots.INK, lw=1.2, ls="--")
        panel.set_xlabel(_label_figure(found, name))
        panel.set_ylabel("rigs")
    return figure


# -- a fleet -----------------------------------------------------------------------------------------------------------


def describe_fleet(found: Fleet) -> Document:
    """Return who passes and why the others do not, the fleet's parameters, what changed, and the causes."""
    looks = {
        Verdict.FAIL: ("Fail", "poor"),
        Verdict.RETEST: ("Test again", "fair"),
        Verdict.PASS: ("Pass", "good"),
    }
    units = len(found.units)
    counts = found.counts
    top = [
        Card(title, str(counts[verdict]), f"of {units} units", tone * bool(counts[verdict]))
        for verdict, (title, tone) in looks.items()
    ]
    unusable = f"{found.failed} could not be used" if found.failed else "all could be used"
    top.append(Card("Logs", str(found.logs), unusable, "fair" if found.failed else "good"))
    odd = units - counts[Verdict.PASS]
    passing = [one.unit for one in found.units if one.verdict is Verdict.PASS]
    verdicts: list[object] = [paragraph(_describe_verdicts(found)), cards(top)]
    verdicts += [_tabulate_units(found)] if odd else []
    verdicts += [paragraph(f"{odd - FIRST} more are in the JSON.")] if odd > FIRST else []
    verdicts += [paragraph(f"Pass: {_join_names(passing, FIRST)}")] if passing else []
    verdicts += [folded("All that pass", ", ".join(passing))] if len(passing) > FIRST else []
    strip = plots.Drawing(
        partial(_draw_units, found),
        "Every log's parameters about the fleet's means",
        "A dot per log. Dashed: the offset that the median unit shows in one of two cases. Named: units that deviate; "
        "an arrow is beyond the axis. All logs of a unit count together: a dot beyond the dashes need not be of one "
        "that deviates.",
    )
    changes = [
        own
        for unit in found.units
        for own in unit.deviations
        if own.kind is not DeviationKind.OFFSET
    ][:PANELS]
    drawn = plots.Drawing(
        partial(_draw_changes, found, changes),
        "Parameters that changed, over time",
        "Each log with its 95 % interval; grey: the fleet's mean, and what a unit's logs do not tell from it.",
    )
    rows = [
        (one.cause, one.joint or "the rig", f"{one.units} of {one.of}")
        for one in found.causes[:FIRST]
    ]
    causes = [Table(["Cause", "Joint", "Units"], rows, texts=2, label="Causes")] if rows else []
    sections = [
        Section("Verdict", verdicts),
        Section("Parameters", [strip, _tabulate_population(found)]),
        Section("Changes", [drawn] if changes else []),
        Section("Causes", causes, "What diagnose names, and of how many units."),
    ]
    return Document(f"Fleet: {found.rig}", found.payload or "", sections)


def _describe_verdicts(found: Fleet) -> str:
    """How many units pass, in a sentence."""
    units, logs = (
        f"{n} {word}{'s' * (n != 1)}"
        for n, word in ((len(found.units), "unit"), (found.logs, "log"))
    )
    failed = f", {found.failed} of which could not be used" if found.failed else ""
    against = f", against {found.reference}" if found.reference else ""
    passing, failing, others = (found.counts[one] for one in Verdict)
    result = f"{passing} pass, {failing} fail" + (
        f", {others} to be tested again" if others else ""
    )
    return f"{found.rig}: {units}, {logs}{failed}{against}: {result}."


def _join_names(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _list_facts(found: Fleet, unit: JudgedUnit) -> Iterator[tuple[str, str, str, str]]:
    """Yield what speaks against a unit: what, its size, how many standard deviations, since when."""
    for own in unit.deviations:
        sign = "+" if own.shift > 0 else ""
        size = " ".join(
            [
                *interval(own.shift, NORMAL_95 * own.shift_std),
                found.population["unit"][own.parameter],
            ]
        )
        since = own.since or ("drifts" if own.kind is DeviationKind.DRIFT else "first log")
        yield own.parameter, f"{sign}{size}", f"{sign}{figures(own.score, 2)}", since
    yield from ((str(own), DASH, DASH, own.since or "first log") for own in unit.causes)
    yield from ((error, DASH, DASH, DASH) for error in unit.errors)
    if unit.uncertain:
        yield f"its logs do not tell {_join_names(unit.uncertain, 2)}", DASH, DASH, DASH


def _tabulate_units(found: Fleet) -> Table:
    """The units that do not pass, with what speaks against them."""
    rows = []
    for unit in [one for one in found.units if one.verdict is not Verdict.PASS][:FIRST]:
        facts = list(_list_facts(found, unit))
        if len(facts) > FACTS:
            facts[FACTS:] = [(f"and {len(facts) - FACTS} more", "", "", "")]
        names = [
            unit.unit,
            f"{unit.verdict.value}: {', '.join(reason.value for reason in unit.reasons)}",
        ]
        rows += [(*(names if k == 0 else ("", "")), *fact) for k, fact in enumerate(facts)]
    heads = ["Unit", "Verdict", "What", "By how much, ± 95 %", "Deviations", "Since"]
    return Table(heads, rows, texts=3, label="Units that do not pass")


def _tabulate_population(found: Fleet) -> Table:
    """The parameters over the fleet that units are judged against."""
    rows = []
    has_repeats = found.reference or any(unit.logs > 1 for unit in found.units)
    for own in found.population.itertuples():
        repeat = own.repeat if has_repeats else None
        middle = interval(own.mean, NORMAL_95 * own.mean_std)
        rows.append(
            (
                own.Index,
                own.unit,
                *middle,
                *(figures(x, 2) for x in (own.spread, own.p_value, repeat, own.detectable)),
            )
        )
    heads = [
        "Parameter",
        "Unit",
        "Mean",
        "± 95 %",
        "Between units",
        "p, all alike",
        "Between logs",
        "Shown from",
    ]
    caption = (
        "Parameters of the reference fleet" if found.reference else "Parameters over the fleet"
    )
    return Table(heads, rows, texts=2, caption=caption)


def _draw_units(found: Fleet) -> Figure:
    """Draw every log's parameters about the fleet's means; those of units that deviate in them are named."""
    figure, ((axes,),) = plots.panels(1, 1, 0.75 + 0.3 * len(found.population), left=2.6, top=0.1)
    used = found.table[found.table["error"].isna()]
    for row, own in enumerate(found.population.itertuples()):
        off = (used[f"value.{own.Index}"].astype(float) - own.mean) / own.detectable
        odd = sorted(
            unit.unit
            for unit in found.units
            if any(one.parameter == own.Index for one in unit.deviations)
        )
        plain = (off.notna() & ~used["serial"].isin(odd)).to_numpy()
        places = row + 0.12 * (np.arange(len(off)) % 5 - 2)
        plots.dots(
            axes, np.clip(off.to_numpy()[plain], -OUTSIDE, OUTSIDE), places[plain], PALETTE[0]
        )
        for k, unit in enumerate(odd):
            mine = off[used["serial"] == unit].dropna().to_numpy()
            for marker, is_so in (
                ("o", np.abs(mine) <= OUTSIDE),
                ("<", mine < -OUTSIDE),
                (">", mine > OUTSIDE),
            ):
                x = np.clip(mine[is_so], -OUTSIDE, OUTSIDE)
                axes.plot(
                    x, np.full(len(x), float(row)), marker, color=PALETTE[1], ms=5, clip_on=False
                )
            farthest = float(np.clip(mine[np.abs(mine).argmax()], -OUTSIDE, OUTSIDE))
            side, shift = ("right", -7) if farthest > 0 else ("left", 7)
            beside = (shift, 5 - 12 * (k % 2))
            text = shortened(unit, 16)
            axes.annotate(
                text, (farthest, row), beside, textcoords="offset points", ha=side, fontsize=8
            )
    for x in (-1, 1):
        axes.axvline(x, color=plots.INK, lw=1.0, ls="--")
    axes.set_yticks(
        range(len(found.population)), [shortened(name, 36) for name in found.population.index]
    )
    axes.set_ylim(len(found.population) - 0.4, -0.6)
    axes.set_xlim(-OUTSIDE, OUTSIDE)
    whose = "reference fleet" if found.reference else "fleet"
    axes.set_xlabel(f"offset from the {whose}'s mean, in offsets that a unit's logs show")
    return figure


def _draw_changes(found: Fleet, changes: Sequence[Deviation]) -> Figure:
    """Draw parameters over time that began to deviate or drift, about the fleet's mean and what is not told from it."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    figure, panels = _make_panels(len(changes), top=0.35)
    for panel, own in zip(panels, changes):
        mine = found.table[
            (found.table["serial"] == own.unit) & found.table["error"].isna()
        ].sort_values("time")
        times, values, std = (
            mine[name].astype(float)
            for name in ("time", f"value.{own.parameter}", f"std.{own.parameter}")
        )
        mean, half = found.population.loc[own.parameter, ["mean", "detectable"]]
        panel.axhspan(mean - half, mean + half, color=plots.PLAIN, alpha=0.2)
        panel.axhline(mean, color=plots.PLAIN, lw=1.0)
        x = times.astype("datetime64[s]") if found.is_dated else times
        panel.errorbar(x, values, NORMAL_95 * std, fmt="o-", color=PALETTE[1], ms=4, lw=1.2)
        if found.is_dated:
            locator = AutoDateLocator(minticks=3, maxticks=6)
            panel.xaxis.set_major_locator(locator)
            panel.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        panel.set_title(shortened(f"{own.unit}: {own.parameter}", 44))
        panel.set_ylabel(found.population["unit"][own.parameter])
    return figure
