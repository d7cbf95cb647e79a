"""Figures of a page: Matplotlib's SVG in one style, without global state, light and dark by the page's style sheet."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from markupsafe import Markup, escape

from gimbal_pin.log.log import Array
from gimbal_pin.report import elements
from gimbal_pin.report.format import PALETTE, figures

if TYPE_CHECKING:  # for the sections, too: they annotate with plots.Axes and plots.Figure
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gimbal_pin.report.charts import Charts

INK, MUTED, FAINT, PAPER = "#0a0b0c", "#0a0b0d", "#0a0b0e", "#0a0b0f"
"""Text, side matters, lines and ground: the page's style sheet gives what is drawn in these its own colours."""
PLAIN = "#8d98a7"
"""Colour of what joints' colours are compared with: what was measured, the other controller."""
MOST_DRAWN_POINTS = 2000
"""Most points of a curve that are drawn."""
WIDTH = 10.2
"""Width of every figure, in; the page scales it to fit."""
STYLE: Mapping[str, object] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "text.color": INK,
    "text.parse_math": False,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": MUTED,
    "axes.edgecolor": FAINT,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "lines.linewidth": 1.4,
    "patch.linewidth": 0.0,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "path.simplify_threshold": 0.4,
}
"""Matplotlib's settings in a report."""

DAYLIGHT: Mapping[str, str] = {INK: "#17212d", MUTED: "#5d6a7a", FAINT: "#dde3ea", PAPER: "#ffffff"}
"""Stand-in → its colour on white: a page's by day."""

SUBS: Mapping[float, Sequence[float]] = {
    3.0: (1,),
    1.53: (1, 3),
    1.0: (1, 2, 5),
    0.7: (1, 2, 3, 5, 7),
    0.0: range(1, 10),
}
"""Decades → the multiples of powers of ten of which any stretch of so many decades holds three."""


@contextmanager
def style(name: str = "", shades: Mapping[str, str] = MappingProxyType({})) -> Iterator[None]:
    """Draw in the report's style within the block.

    `name`: what the figure's identifiers in a page are made of; `shades`: stand-in → the colour that is drawn instead.
    """
    import matplotlib
    from cycler import cycler

    settings: Any = {key: shades.get(str(value), value) for key, value in STYLE.items()}
    settings |= {"axes.prop_cycle": cycler(color=list(PALETTE)), "svg.hashsalt": name}
    settings |= {"figure.facecolor": shades.get(PAPER, "none")}
    with matplotlib.rc_context(settings):
        yield


@dataclass(frozen=True)
class Drawing:
    """A figure with its caption, which is drawn when a page shows it; a terminal does not.

    Attributes:
        make: Draws it.
        alt: For those who cannot see it.
        caption: Below it.
        charts: The same for a page's script to draw, which a screen then shows; paper has the figure.
    """

    make: Callable[[], Figure]
    alt: str
    caption: str
    charts: Callable[[], Charts] | None = None

    def __html__(self) -> str:
        """Return it as an element of a page."""
        charts = "" if self.charts is None else self.charts()
        return elements.figure(drawn(self.make, self.alt), self.caption, charts)

    def __str__(self) -> str:
        """Return no lines."""
        return ""

    def draw(self) -> Figure:
        """Return it as a figure of its own, in the colours of a page in daylight, for a file of any format."""
        with style(self.alt, DAYLIGHT):
            figure = self.make()
            plain_powers(figure)
            paint(figure)
        return figure


def drawn(make: Callable[[], Figure], alt: str) -> Markup:
    """Return the figure that `make` draws in the report's style as an SVG element of a page.

    Of its identifiers only those stay that something points to, made from `alt`; coordinates keep a tenth of a point,
    which is a seventh of a pixel; texts have the page's font; its style sheet, which would reach the whole page, and
    white space are left out.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = StringIO()
    with style(alt):
        figure = make()
        plain_powers(figure)
        FigureCanvasSVG(figure).print_svg(out, metadata={"Date": None, "Creator": None})
    text = re.sub(
        r"<metadata>.*?</metadata>|<style[^>]*>.*?</style>|<!--.*?-->",
        "",
        out.getvalue(),
        flags=re.S,
    )
    head, _, body = text[text.index("<svg") :].partition(">")
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    body = re.sub(r">\s+<", "><", re.sub(r" font-family: [^;]*;", "", body))
    body = re.sub(
        r"<[^>]*>", lambda tag: re.sub(r"\d+\.\d{3,}", lambda x: f"{float(x[0]):.1f}", tag[0]), body
    )
    body = re.sub(
        r' d="[^"]*"', lambda path: re.sub(r"(?<=[MLCQ]) | ?\n|\.0(?=[ \n])", "", path[0]), body
    )
    body = re.sub(r"M([\d.-]+ [\d.-]+)L\1(?=[M\"])", r"M\1h0", body)  # a dot
    body = re.sub(
        r'(<path id="[^>]*?) style="[^"]*"', r"\1", body
    )  # of `use`, whose style a page's sheet reaches
    (box,) = re.findall(r'viewBox="[^"]*"', head)
    return Markup(f'<svg {box} role="img" aria-label="{escape(alt)}">{body}')


def paint(figure: Figure) -> None:
    """Give what a drawing itself drew in stand-ins the colours of daylight."""
    from matplotlib.colors import to_hex

    for artist in figure.findobj():
        for name in ("color", "edgecolor", "facecolor", "markeredgecolor", "markerfacecolor"):
            held = getattr(artist, f"get_{name}", lambda: None)()
            if isinstance(held, str | tuple) and (shade := DAYLIGHT.get(to_hex(held))):
                getattr(artist, f"set_{name}")(shade)
            elif isinstance(held, np.ndarray) and held.ndim == 2 and len(held):
                every = [
                    (DAYLIGHT.get(to_hex(one), one[:3]), float(one[3])) for one in held.tolist()
                ]
                getattr(artist, f"set_{name}")(every)


def plain_powers(figure: Figure) -> None:
    """Label logarithmic axes with plain text, for formulas are switched off: names may hold dollar signs.

    Within few decades there are labels between the powers of ten, three in all at the least.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                low, high = sorted(axis.get_view_interval())
                subs = next(subs for least, subs in SUBS.items() if np.log10(high / low) >= least)
                axis.set_major_locator(LogLocator(subs=subs))
                axis.set_major_formatter(lambda value, _: figures(value, 1).removeprefix("1·"))
                axis.set_minor_formatter(NullFormatter())


def panels(
    rows: int,
    columns: int,
    height: float,
    *,
    ratios: Sequence[float] | None = None,
    left: float = 0.85,
    right: float = 0.2,
    top: float = 0.35,
    gaps: tuple[float, float] = (0.75, 0.35),
    share: tuple[bool, bool | Literal["row"]] = (False, False),
) -> tuple[Figure, Any]:
    """Return a figure of the page's width and its axes, (rows, columns), placed by lengths in inches.

    Matplotlib's own arranging looks at every label several times and doubles the time a report takes.

    Args:
        rows: Number of rows.
        columns: Number of columns.
        height: Height of the figure, in.
        ratios: The rows' heights to each other.
        left: Room for the labels at the left, in.
        right: Room at the right, in: half of the last tick's label.
        top: Room for the titles, in.
        gaps: Room between columns, and between rows, in.
        share: Whether all rows share one x axis, and all panels one y axis; "row": each row has one.
    """
    from matplotlib.figure import Figure

    bottom = 0.55
    wide = (WIDTH - left - right - (columns - 1) * gaps[0]) / columns
    high = (height - bottom - top - (rows - 1) * gaps[1]) / rows
    figure = Figure(figsize=(WIDTH, height))
    grid: dict[str, Any] = dict(
        left=left / WIDTH, right=1 - right / WIDTH, bottom=bottom / height, top=1 - top / height
    )
    grid |= dict(wspace=gaps[0] / wide, hspace=gaps[1] / high, height_ratios=ratios)
    return figure, figure.subplots(
        rows, columns, squeeze=False, sharex=share[0], sharey=share[1], gridspec_kw=grid
    )


def thinned(t: Array, values: Array, most: int = MOST_DRAWN_POINTS) -> tuple[Array, Array]:
    """Return at most so many points that look like the curve: the lowest and highest of each stretch, in order.

    Args:
        t: Increasing, (N,).
        values: Values, nan where the curve is broken, (N,).
        most: Largest number of points returned.
    """
    if len(t) <= most:
        return t, values
    import pandas as pd

    series = pd.Series(values)
    stretch = np.arange(len(t)) * (most // 3) // len(t)
    drawn = series.dropna()
    gaps = np.flatnonzero(series.isna())
    each = drawn.groupby(stretch[drawn.index])
    (_, first) = np.unique(stretch[gaps], return_index=True)
    places = np.unique(np.concatenate([gaps[first], each.idxmin(), each.idxmax()]).astype(int))
    return t[places], values[places]


def curve(axes: Axes, t: Array, values: Array, **looks: Any) -> None:
    """Draw a curve, thinned to what can be seen."""
    axes.plot(*thinned(t, values), **looks)


def dots(axes: Axes, x: Array, y: Array, colour: str) -> None:
    """Draw a cloud of dots as one path, which takes a tenth of the space of as many markers.

    Matplotlib simplifies dots away: of what it clips, and of a path whose x is sorted, it draws a simplified copy; and
    in a PNG those that have no length.
    """
    if not len(x):
        return
    xs = np.column_stack([x, x + 1e-9 * (np.ptp(x) or 1.0), np.full_like(x, np.nan)]).ravel()
    ys = np.column_stack([y, y, np.full_like(y, np.nan)]).ravel()
    alpha = float(np.clip(200 / max(len(x), 1), 0.35, 0.9))
    (line,) = axes.plot(
        xs, ys, color=colour, lw=2.4, solid_capstyle="round", alpha=alpha, clip_on=False
    )
    line.get_path().should_simplify = False
    line.set_snap(False)


def nest_dashes(count: int) -> list[tuple[float, ...]]:
    """Return dashes, length and gap, by which curves that lie on each other are all seen in turn; none of the first."""
    return [(9.0 * (count - k), 9.0 * k) if k else () for k in range(count)]


def zero_line(axes: Axes) -> None:
    """Draw where y is zero."""
    axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1)


def put_legend(axes: Axes, entries: Sequence[tuple[str, str]], dashed: Sequence[str] = ()) -> None:
    """Put a legend of names and colours above the axes, in one line; unlike Matplotlib's own it shows any name."""
    from matplotlib.lines import Line2D

    ways = ["--" if name in dashed else "-" for name, _ in entries]
    handles = [
        Line2D([], [], color=colour, lw=2.2, ls=way, label="x")
        for (_, colour), way in zip(entries, ways)
    ]
    placed: Any = dict(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=len(entries) or 1, borderpad=0.2
    )
    legend = axes.legend(handles, ["x"] * len(entries), **placed)
    for text, (name, _) in zip(legend.get_texts(), entries):
        text.set_text(name)
