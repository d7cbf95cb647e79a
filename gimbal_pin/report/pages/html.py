"""The parts that sections are made of; what is not `Markup` is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from gimbal_pin.report.pages.numbers import DASH

Content = str | Markup


@dataclass(frozen=True)
class Card:
    """One headline number.

    Attributes:
        label: What it is.
        value: The number with its unit.
        note: A line below.
        tone: "good", "fair" or "poor", a class that colours it and is never the only sign of what it says; or nothing.
    """

    label: str
    value: str
    note: str = ""
    tone: str = ""


def join(parts: Iterable[Markup]) -> Markup:
    """Return parts one after the other."""
    return Markup("\n").join(parts)


def paragraph(text: Content, kind: str = "") -> Markup:
    """Return a paragraph."""
    return Markup('<p class="{}">{}</p>').format(kind, text) if kind else Markup("<p>{}</p>").format(text)


def heading(text: Content) -> Markup:
    """Return a heading inside a section."""
    return Markup("<h3>{}</h3>").format(text)


def bullets(items: Sequence[Content]) -> Markup:
    """Return a list."""
    return Markup("<ul>{}</ul>").format(join(Markup("<li>{}</li>").format(item) for item in items))


def toned(text: Content, tone: str) -> Markup:
    """Return a text marked with a tone."""
    return Markup('<span class="{}">{}</span>').format(tone, text)


def dot(colour: str, text: Content) -> Markup:
    """Return a text behind a dot of a joint's colour."""
    return Markup('<span class="joint"><i style="background:{}"></i>{}</span>').format(colour, text)


def bar(share: float, text: str) -> Markup:
    """Return a text over a bar whose length is a share in [0, 1]."""
    width = 100 * min(max(share, 0.0), 1.0)
    return Markup('<span class="bar"><i style="width:{:.1f}%"></i><b>{}</b></span>').format(width, text)


def cards(several: Sequence[Card]) -> Markup:
    """Return headline numbers side by side."""
    one = Markup('<div class="card {}"><span>{}</span><strong>{}</strong><small>{}</small></div>')
    inside = join(one.format(card.tone, card.label, card.value, card.note) for card in several)
    return Markup('<div class="cards">{}</div>').format(inside)


def table(
    head: Sequence[Content],
    rows: Sequence[Sequence[Content | None]],
    texts: int = 1,
    caption: str = "",
    label: str = "",
) -> Markup:
    """Return a table whose first column names the rows.

    Args:
        head: Column headings, units included.
        rows: Cells; None: a dash.
        texts: How many columns from the left hold text; the others hold numbers, set flush right.
        caption: A line above it.
        label: What it is, for those who cannot see the heading above it. Not needed with a caption.
    """
    top = Markup("<caption>{}</caption>").format(caption) if caption else Markup()
    heads = join(
        Markup('<th scope="col" class="{}">{}</th>').format(kind(k, texts), title) for k, title in enumerate(head)
    )
    body = join(Markup("<tr>{}</tr>").format(join(cell(k, texts, x) for k, x in enumerate(row))) for row in rows)
    inside = Markup("<table>{}<thead><tr>{}</tr></thead><tbody>{}</tbody></table>").format(top, heads, body)
    return Markup('<div class="table" tabindex="0" role="region" aria-label="{}">{}</div>').format(
        caption or label or "Table", inside
    )


def kind(column: int, texts: int) -> str:
    """Return the class of a column's cells."""
    return "text" if column < texts else "number"


def cell(column: int, texts: int, content: Content | None) -> Markup:
    """Return one cell of a table's body."""
    shown = DASH if content is None else content
    if column == 0:
        return Markup('<th scope="row">{}</th>').format(shown)
    return Markup('<td class="{}">{}</td>').format(kind(column, texts), shown)


def picture(svg: Markup, caption: Content) -> Markup:
    """Return a drawing with its caption."""
    return Markup('<figure><div class="plot">{}</div><figcaption>{}</figcaption></figure>').format(svg, caption)


def notice(title: str, content: Markup) -> Markup:
    """Return something that must not be missed."""
    return Markup('<aside class="notice"><strong>{}</strong>{}</aside>').format(title, content)


def folded(summary: Content, content: Content) -> Markup:
    """Return something that opens on a click."""
    return Markup("<details><summary>{}</summary>{}</details>").format(summary, content)
