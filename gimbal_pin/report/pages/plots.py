"""What the sections' figures are drawn with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import html
from gimbal_pin.report.pages.joints import PALETTE
from gimbal_pin.report.pages.svg import INK as INK
from gimbal_pin.report.pages.svg import MUTED as MUTED
from gimbal_pin.report.pages.svg import PAPER as PAPER
from gimbal_pin.report.pages.svg import drawn

if TYPE_CHECKING:  # for the sections, too: they annotate with plots.Axes and plots.Figure
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLAIN = "#8d98a7"
"""Colour of what joints' colours are compared with: what was measured, the other controller."""
POINTS = 2000
"""Most points of a curve that are drawn."""

WIDTH = 10.2
"""Width of every figure, in; the page scales it to fit."""


def picture(make: Callable[[], Figure], alt: str, caption: str, colours: Sequence[str] = PALETTE) -> Markup:
    """Return the figure that `make` draws, with its caption; `alt` is for those who cannot see it."""
    return html.picture(drawn(make, alt, colours), caption)


def panels(
    rows: int,
    columns: int,
    height: float,
    *,
    ratios: Sequence[float] | None = None,
    left: float = 0.85,
    gaps: tuple[float, float] = (0.75, 0.35),
    share: tuple[bool, bool] = (False, False),
) -> tuple[Figure, Any]:
    """Return a figure of the page's width and its axes, (rows, columns), placed by lengths in inches.

    Matplotlib's own arranging looks at every label several times and doubles the time a report takes.

    Args:
        rows: Number of rows.
        columns: Number of columns.
        height: Height of the figure, in.
        ratios: The rows' heights to each other.
        left: Room for the labels at the left, in.
        gaps: Room between columns, and between rows, in.
        share: Whether all rows share one x axis, and all columns one y axis.
    """
    from matplotlib.figure import Figure

    right, bottom, top = 0.12, 0.55, 0.35
    wide = (WIDTH - left - right - (columns - 1) * gaps[0]) / columns
    high = (height - bottom - top - (rows - 1) * gaps[1]) / rows
    figure = Figure(figsize=(WIDTH, height))
    grid: dict[str, Any] = dict(
        left=left / WIDTH, right=1 - right / WIDTH, bottom=bottom / height, top=1 - top / height
    )
    grid |= dict(wspace=gaps[0] / wide, hspace=gaps[1] / high, height_ratios=ratios)
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=share[0], sharey=share[1], gridspec_kw=grid)


def thinned(t: Array, values: Array, most: int = POINTS) -> tuple[Array, Array]:
    """Return at most so many points that look like the curve: the lowest and highest of each stretch, in order.

    Args:
        t: Increasing, (N,).
        values: Values, nan where the curve is broken, (N,).
        most: Largest number of points returned.
    """
    if len(t) <= most:
        return t, values
    edges = np.linspace(0, len(t), most // 3 + 1).astype(int)
    keep: set[int] = set()
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist()):
        stretch = values[first:last]
        gaps = np.flatnonzero(np.isnan(stretch))
        if len(gaps):
            keep.add(first + int(gaps[0]))
        if len(gaps) < len(stretch):
            keep |= {first + int(np.nanargmin(stretch)), first + int(np.nanargmax(stretch))}
    places = np.array(sorted(keep))
    return t[places], values[places]


def curve(axes: Axes, t: Array, values: Array, **looks: Any) -> None:
    """Draw a curve, thinned to what can be seen."""
    axes.plot(*thinned(t, values), **looks)


def dots(axes: Axes, x: Array, y: Array, colour: str) -> None:
    """Draw a cloud of dots as one path, which takes a tenth of the space of as many markers."""
    xs = np.column_stack([x, x, np.full_like(x, np.nan)]).ravel()
    ys = np.column_stack([y, y, np.full_like(y, np.nan)]).ravel()
    (line,) = axes.plot(xs, ys, color=colour, lw=2.4, solid_capstyle="round", alpha=0.35)
    line.get_path().should_simplify = False


def zero_line(axes: Axes) -> None:
    """Draw where y is zero."""
    axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1)


def named(axes: Axes, entries: Sequence[tuple[str, str]], dashed: Sequence[str] = ()) -> None:
    """Put a legend of names and colours above the axes, in one line; unlike Matplotlib's own it shows any name."""
    from matplotlib.lines import Line2D

    ways = ["--" if name in dashed else "-" for name, _ in entries]
    handles = [Line2D([], [], color=colour, lw=2.2, ls=way, label="x") for (_, colour), way in zip(entries, ways)]
    placed: Any = dict(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(entries) or 1, borderpad=0.2)
    legend = axes.legend(handles, ["x"] * len(entries), **placed)
    for text, (name, _) in zip(legend.get_texts(), entries):
        text.set_text(name)
