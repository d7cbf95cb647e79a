"""A table of a result, made once: the terminal renders it as aligned text, a page as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from textwrap import wrap

from markupsafe import Markup

from gimbal_pin.errors import shortened
from gimbal_pin.report.format import DASH

Content = str | Markup
"""Text, or markup whose texts have been escaped; the terminal shows it without its tags."""
WIDEST = 48
"""Widest first column in a terminal; a longer sum of parameters is wrapped."""
LONGEST = 120
"""Most characters of another cell in a terminal."""


@dataclass(frozen=True)
class Table:
    """Rows under headings; the first column names the rows.

    Attributes:
        head: Headings, units included.
        rows: Cells, as many as headings; None: a dash.
        texts: How many columns from the left hold text; the others hold numbers, set flush right.
        caption: A line above it.
        label: What it is, for those who cannot see the heading above it; not needed with a caption.
        is_detail: Whether a terminal shows it only where everything is asked for.
    """

    head: Sequence[Content]
    rows: Sequence[Sequence[Content | None]]
    texts: int = 1
    caption: str = ""
    label: str = ""
    is_detail: bool = False

    def __html__(self) -> str:
        """Return it as an element of a page."""
        top = Markup("<caption>{}</caption>").format(self.caption) if self.caption else ""
        kinds = ["text" if k < self.texts else "number" for k in range(len(self.head))]
        heads = join(Markup('<th scope="col" class="{}">{}</th>').format(*pair) for pair in zip(kinds, self.head))
        body = [
            Markup('<tr><th scope="row">{}</th>{}</tr>').format(
                filled(row[0]),
                join(Markup('<td class="{}">{}</td>').format(kind, filled(x)) for kind, x in zip(kinds[1:], row[1:])),
            )
            for row in self.rows
        ]
        inside = Markup("<table>{}<thead><tr>{}</tr></thead><tbody>{}</tbody></table>").format(top, heads, join(body))
        label = self.caption or self.label or "Table"
        return Markup('<div class="table" tabindex="0" role="region" aria-label="{}">{}</div>').format(label, inside)

    def __str__(self) -> str:
        """Return it as lines in aligned columns under its caption, long cells cut."""
        lines = [[plain(cell) for cell in row] for row in (self.head, *self.rows)]
        lines = [[first, *(shortened(cell, LONGEST) for cell in rest)] for first, *rest in lines]
        folded = []
        for first, *rest in lines:
            some, *more = wrap(first, WIDEST, break_long_words=False, break_on_hyphens=False) or [""]
            folded += [[some, *rest], *([f"  {part}", *[""] * len(rest)] for part in more)]
        widths = [max(map(len, column)) for column in zip(*folded)]
        aligned = [
            "  ".join(
                cell.ljust(width) if k < self.texts else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(row, widths))
            ).rstrip()
            for row in folded
        ]
        return "\n".join([*([self.caption] if self.caption else []), *aligned])


def join(parts: Iterable[object]) -> Markup:
    """Return parts of a page one after the other."""
    return Markup("\n").join(parts)  # type: ignore[arg-type]  # it takes what has `__html__`, too


def filled(cell: Content | None) -> Content:
    """Return a cell, a dash for none."""
    return DASH if cell is None else cell


def plain(cell: Content | None) -> str:
    """Return a cell's text without tags, on one line, with plain spaces."""
    text = filled(cell)
    return " ".join((text.striptags() if isinstance(text, Markup) else text).split())
