"""A contest as a figure: the line of sight over time, its cumulative spectrum, torque against limits, the budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gimbal_pin.control.controllers import BASELINE, ORACLE, OURS, TUNED
from gimbal_pin.log.log import Array
from gimbal_pin.pointing.result import Budget, Contest, Pointing, Row, cumulative, split

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {BASELINE: "#8d98a7", OURS: "#1a75f2", TUNED: "#d98200", ORACLE: "#14a05a"}
OTHERS = ("#d98200", "#8a4fd0", "#0b96a8")
"""For controllers that stand in for one of those."""
PARTS = ("#e23b2f", "#8a4fd0", "#d98200", "#1a75f2", "#0b96a8", "#d23f8d", "#14a05a")
"""For the budget's parts, what is left last."""
POINTS = 400
"""Points of a curve."""
SHORTEST = 4.0
"""Parts of the budget below so many per cent carry no figure inside the bar."""


def chart(found: Contest) -> Figure:
    """Return diagrams of the first seed: PID, ours and the oracle; below, if it is told, the budget of all seeds."""
    from matplotlib.figure import Figure

    budget = found.budget if found.budget is not None and found.budget.telling else None
    figure = Figure(figsize=(11, 7.0 if budget is None else 8.4))
    room = dict(left=0.08, right=0.98, top=0.91, bottom=0.08 if budget is None else 0.12, hspace=0.5, wspace=0.2)
    rows, places = drawn(found), list[Any]([["sight", "spectrum"], ["torque"] * 2, ["bar"] * 2])
    places = places if budget is not None else places[:2]
    heights = [3, 3, 0.6][: len(places)]
    axes = figure.subplot_mosaic(places, gridspec_kw=room, height_ratios=heights)
    over_time(axes["sight"], rows)
    spectra(axes["spectrum"], rows)
    torques(axes["torque"], rows)
    axes["sight"].set_title("Line of sight, above 0.2 Hz: the largest of each stretch")
    axes["spectrum"].set_title("Cumulative spectrum")
    axes["torque"].set_title("Torque: rms as a bar, the largest as a line")
    names = [row.controller for row in rows]
    figure.legend(axes["spectrum"].get_lines(), names, loc="upper center", ncols=len(names), frameon=False)
    if budget is not None:
        budgeted(axes["bar"], budget)
        axes["bar"].set_title("Error budget of the world-frame PID, % of its mean square")
    return figure


def drawn(found: Contest) -> tuple[Row, ...]:
    """Return the rows that are drawn: PID, ours and the oracle, or the first three."""
    return tuple(row for row in found.rows if row.controller in COLOURS) or found.rows[:3]


def looks(rows: Sequence[Row]) -> Mapping[str, str]:
    """Return controller → colour."""
    return {row.controller: COLOURS.get(row.controller, OTHERS[k % 3]) for k, row in enumerate(rows)}


def over_time(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw the first run's distance of the line of sight from its slow part, degrees: the largest of each stretch."""
    for row in rows:
        run = row.runs[0]
        t, largest = envelope(run)
        axes.plot(t, largest, lw=1.0, color=looks(rows)[row.controller])
    axes.set(xlabel="time, s", ylabel="line of sight off by, °", xlim=(t[0], t[-1]), ylim=(0, None))


def envelope(run: Pointing) -> tuple[Array, Array]:
    """Return the middle of each of `POINTS` stretches, s, and the largest jitter in it, degrees."""
    fast, _ = split(run.sight, run.dt)
    size, t = np.degrees(np.hypot(*fast.T)), run.t[run.counted]
    edges = np.linspace(0, len(t), min(POINTS, len(t)) + 1).astype(int)
    pairs = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
    return np.array([t[a:b].mean() for a, b in pairs]), np.array([size[a:b].max() for a, b in pairs])


def spectra(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw jitter up to each frequency, degrees rms, of the first run, both logarithmic: orders of magnitude apart."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for row in rows:
        f, rms = cumulative(row.runs[0].sight, row.runs[0].dt)
        some = np.unique(np.geomspace(1, len(f) - 1, POINTS).astype(int))
        axes.loglog(f[some], np.degrees(rms[some]), color=looks(rows)[row.controller])
    axes.set(xlabel="frequency, Hz", ylabel="jitter up to there, ° rms", xlim=(max(f[1], 0.1), f[-1]))
    # What is below a thousandth of the largest is the high-pass's own flank, not jitter.
    axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-3 * axes.get_ylim()[1]))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def torques(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw each joint's torque as a share of its limit: rms as a bar, the largest of the first run as a whisker."""
    first, high = rows[0].runs[0], 0.8 / len(rows)
    limited = np.isfinite(first.tau_max)
    scale = np.where(limited, 100 / np.where(limited, first.tau_max, 1.0), 1.0)
    for k, row in enumerate(rows):
        run = row.runs[0]
        at = np.arange(len(run.joints)) + (k - (len(rows) - 1) / 2) * high
        share = scale * np.abs(run.tau[run.counted])
        axes.barh(at, np.sqrt(np.mean(share**2, axis=0)), 0.85 * high, color=looks(rows)[row.controller])
        axes.hlines(at, 0, share.max(axis=0), color=looks(rows)[row.controller], lw=1.4)
    axes.axvline(100, color="#b3261e", lw=1.2, ls=(0, (4, 3)))
    axes.set(xlabel="% of the limit" if limited.all() else "% of the limit, N m without one", xlim=(0, 108))
    axes.set_yticks(range(len(first.joints)), first.joints)
    axes.invert_yaxis()


def budgeted(axes: Axes, parted: Budget) -> None:
    """Draw the error budget as one bar; its legend below has every figure, also of what did harm."""
    left = 0.0
    for what, share, colour in zip(parted.parts, parted.parts.values(), shades(len(parted.parts))):
        width = 100 * max(share, 0.0)
        axes.barh(0, width, 0.8, left=left, color=colour, label=f"{what}  {100 * share:.1f} %")
        if width >= SHORTEST:
            axes.text(left + width / 2, 0, f"{width:.0f}", ha="center", va="center", color="white", fontweight="bold")
        left += width
    axes.legend(loc="upper left", bbox_to_anchor=(-0.01, -0.12), ncols=3, frameon=False, borderaxespad=0.0)
    axes.set(xlim=(0, max(left, 100.0)), xticks=[], yticks=[])
    axes.grid(False)


def shades(count: int) -> tuple[str, ...]:
    """Return the parts' colours, that of what is left last."""
    return (*PARTS[: count - 1], PARTS[-1])
