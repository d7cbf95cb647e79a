"""Matplotlib figures as SVG inside a page: one style, no global state, light and dark by the page's own colours."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup, escape

from gimbal_pin.log import Array
from gimbal_pin.report.joints import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, FAINT, PAPER = "#0a0b0c", "#0a0b0d", "#0a0b0e", "#0a0b0f"
"""Stand-ins for the page's colours of text, of side matters, of lines and of the ground: `inlined` replaces them."""
INKS = {INK: "currentColor", MUTED: "var(--muted)", FAINT: "var(--line)", PAPER: "var(--ground)"}
PLAIN = "#8d98a7"
"""Colour of what joints' colours are compared with: what was measured, the other controller."""
POINTS = 2000
"""Most points of a curve that are drawn."""

WIDTH = 10.2
"""Width of every figure, in; the page scales it to fit."""


@contextmanager
def style(colours: Sequence[str] = PALETTE) -> Iterator[None]:
    """Draw in the report's style within the block; figures made in it cycle through `colours`."""
    import matplotlib
    from cycler import cycler

    settings = {
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
        "axes.prop_cycle": cycler(color=list(colours)),
        "axes.unicode_minus": True,
        "grid.color": FAINT,
        "grid.linewidth": 0.6,
        "xtick.color": FAINT,
        "ytick.color": FAINT,
        "xtick.labelcolor": MUTED,
        "ytick.labelcolor": MUTED,
        "xtick.minor.visible": False,
        "lines.linewidth": 1.4,
        "patch.linewidth": 0.0,
        "legend.frameon": False,
        "legend.fontsize": 9,
        "figure.facecolor": "none",
        "savefig.facecolor": "none",
        "svg.fonttype": "none",
        "svg.hashsalt": "gimbal-pin",
        "path.simplify_threshold": 0.2,
    }
    with matplotlib.rc_context(settings):
        yield


def drawn(make: Callable[[], Figure], alt: str, colours: Sequence[str] = PALETTE) -> Markup:
    """Return the figure that `make` draws in the report's style as SVG for a page.

    Args:
        make: Draws it; called within `style`.
        alt: What is to be seen, for those who cannot see it.
        colours: Colours of the curves that ask for none.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = StringIO()
    with style(colours):
        FigureCanvasSVG(make()).print_svg(out, metadata={"Date": None, "Creator": None})
    return inlined(out.getvalue(), alt)


def inlined(document: str, alt: str) -> Markup:
    """Return an SVG document as an element of a page.

    Its identifiers become the figure's own, its colours the page's, its size the page's; coordinates keep a
    hundredth of a point; its style sheet, which would reach the whole page, is left out.
    """
    text = document[document.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<style[^>]*>.*?</style>|<!--.*?-->", "", text, flags=re.S)
    box = re.search(r'viewBox="([^"]*)"', text)
    assert box is not None  # Matplotlib always writes one
    body = text[text.index(">") + 1 :]
    key = "f" + hashlib.sha256(body.encode()).hexdigest()[:8]
    used = set(re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", body))
    body = re.sub(r' id="([^"]*)"', lambda m: f' id="{key}{m[1]}"' if m[1] in used else "", body)
    body = re.sub(r"(url\(#|href=\"#)", rf"\g<1>{key}", body.replace("xlink:href", "href"))
    body = re.sub(r"(\d\.\d\d)\d+", r"\1", body)
    for stand_in, colour in {**INKS, "#000000": "currentColor"}.items():
        body = body.replace(stand_in, colour)
    body = re.sub(r"font: (?:[\w.]+ )*?([\d.]+px) [^;\"]*", r"font-size: \1", body)
    head = f'<svg viewBox="{box[1]}" role="img" aria-label="{escape(alt)}">'
    return Markup(head + body)


def figure(height: float) -> Figure:
    """Return an empty figure of the page's width, its parts arranged by themselves."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")


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


def curve(axes: Axes, t: Array, values: Array, **looks: object) -> None:
    """Draw a curve, thinned to what can be seen."""
    axes.plot(*thinned(t, values), **looks)  # type: ignore[arg-type]  # Line2D's own keywords


def dots(axes: Axes, x: Array, y: Array, colour: str, size: float = 2.4) -> None:
    """Draw a cloud of dots as one path, which takes a tenth of the space of as many markers."""
    xs = np.column_stack([x, x, np.full_like(x, np.nan)]).ravel()
    ys = np.column_stack([y, y, np.full_like(y, np.nan)]).ravel()
    (line,) = axes.plot(xs, ys, color=colour, lw=size, solid_capstyle="round", alpha=0.35)
    line.get_path().should_simplify = False


def zero_line(axes: Axes) -> None:
    """Draw where y is zero."""
    axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1)


def named(axes: Axes, entries: Sequence[tuple[str, str]]) -> None:
    """Put a legend of names and colours above the axes, in one line; unlike Matplotlib's own it shows any name."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, lw=2.2, label="x") for _, colour in entries]
    legend = axes.legend(handles, ["x"] * len(entries), loc="lower left", bbox_to_anchor=(0, 1), ncols=len(entries) or 1)
    for text, (name, _) in zip(legend.get_texts(), entries):
        text.set_text(name)
