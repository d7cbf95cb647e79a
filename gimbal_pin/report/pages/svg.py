"""Matplotlib figures as SVG inside a page: one style, no global state, light and dark by the page's own colours."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import StringIO
from math import ceil, floor, log10
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from gimbal_pin.report.pages.joints import PALETTE
from gimbal_pin.report.pages.numbers import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, MUTED, FAINT, PAPER = "#0a0b0c", "#0a0b0d", "#0a0b0e", "#0a0b0f"
"""Stand-ins for the page's colours of text, of side matters, of lines and of the ground: `inlined` replaces them."""
INKS = {INK: "currentColor", MUTED: "var(--muted)", FAINT: "var(--line)", PAPER: "var(--ground)"}
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
"""Matplotlib's settings in a report; beside them the curves' colours."""
SUBS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), tuple(map(float, range(1, 10))))
"""Which multiples of the powers of ten a logarithmic axis may label, the fewest first."""
LABELS = 3
"""Least labels of one, if there are so many."""


@contextmanager
def style(colours: Sequence[str] = PALETTE) -> Iterator[None]:
    """Draw in the report's style within the block; figures made in it cycle through `colours`."""
    import matplotlib
    from cycler import cycler

    settings: Any = {**STYLE, "axes.prop_cycle": cycler(color=list(colours))}
    with matplotlib.rc_context(settings):
        yield


def drawn(make: Callable[[], Figure], alt: str, colours: Sequence[str] = PALETTE) -> Markup:
    """Return the figure that `make` draws in the report's style as SVG for a page.

    `make` is called within `style`; `alt` is for those who cannot see it; `colours` are those of curves that ask for
    none.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = StringIO()
    with style(colours):
        made = make()
        plain_powers(made)
        FigureCanvasSVG(made).print_svg(out, metadata={"Date": None, "Creator": None})
    return inlined(out.getvalue(), alt)


def plain_powers(figure: Figure) -> None:
    """Label logarithmic axes with plain text: formulas are switched off, as names may hold dollar signs.

    Within a decade or two there are labels between the powers of ten: one alone tells no scale.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                low, high = sorted(axis.get_view_interval())
                between = next((subs for subs in SUBS if count(low, high, subs) >= LABELS), SUBS[-1])
                axis.set_major_locator(LogLocator(subs=between))
                axis.set_major_formatter(FuncFormatter(lambda value, _: power(value)))
                axis.set_minor_formatter(NullFormatter())


def count(low: float, high: float, subs: Sequence[float]) -> int:
    """How many of ``s 10^k``, s one of `subs`, lie between two values above zero."""
    decades = range(floor(log10(low)), ceil(log10(high)) + 1)
    return sum(low <= s * 10.0**k <= high for k in decades for s in subs)


def power(value: float) -> str:
    """Return a tick's label: ``0.01``, ``100``, ``10⁻⁵``."""
    return figures(value, 1) if 1e-4 < value < 1e4 or value <= 0 else figures(value, 1).removeprefix("1·")


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
    body = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), body)
    for stand_in, colour in {**INKS, "#000000": "currentColor"}.items():
        body = body.replace(stand_in, colour)
    body = re.sub(r"font: (?:[\w.]+ )*?([\d.]+px) [^;\"]*", r"font-size: \1", body)
    head = f'<svg viewBox="{box[1]}" role="img" aria-label="{escape(alt)}">'
    return Markup(head + body)
