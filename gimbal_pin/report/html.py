"""A page: a list of sections in one HTML file that needs nothing but a browser, and the parts they are made of.

What is not `Markup` is escaped.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from gimbal_pin.report.table import Content, join


@dataclass(frozen=True)
class Section:
    """One part of a page. A new one is a function that returns this.

    Attributes:
        title: Heading, and entry of the table of contents.
        html: The content.
        lead: A sentence under the heading that says what is seen here.
    """

    title: str
    html: Markup
    lead: str = ""


@dataclass(frozen=True)
class Card:
    """One headline number.

    Attributes:
        label: What it is.
        value: The number with its unit.
        note: A line below.
        tone: "good", "fair" or "poor", which colours it and is never the only sign of what it says; or nothing.
    """

    label: str
    value: str
    note: str = ""
    tone: str = ""


def render(title: str, sections: Sequence[Section], subtitle: str = "") -> str:
    """Return the page of some sections: no script or picture from elsewhere, every text escaped."""
    return template("gimbal_pin.report", "report.html.j2", title=title, subtitle=subtitle, sections=sections)


def template(package: str, name: str, **values: Any) -> str:
    """Return the template of a package, filled: what is put in is escaped unless the template calls it safe.

    Values of a page's scripts go through ``tojson``: no name in them holds a character that ends a script or begins an
    element (<, >, &, ', U+2028, U+2029).
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(files(package).joinpath(name).read_text(encoding="utf-8")).render(**values)


def paragraph(text: Content, kind: str = "") -> Markup:
    """Return a paragraph."""
    return Markup('<p class="{}">{}</p>').format(kind, text) if kind else Markup("<p>{}</p>").format(text)


def heading(text: Content) -> Markup:
    """Return a heading inside a section."""
    return Markup("<h3>{}</h3>").format(text)


def bullets(items: Iterable[Content]) -> Markup:
    """Return a list."""
    return Markup("<ul>{}</ul>").format(join(Markup("<li>{}</li>").format(item) for item in items))


def toned(text: Content, tone: str) -> Content:
    """Return a text marked with a tone, if there is one."""
    return Markup('<span class="{}">{}</span>').format(tone, text) if tone else text


def bar(share: float, text: str) -> Markup:
    """Return a text over a bar whose length is a share in [0, 1]."""
    width = 100 * min(max(share, 0.0), 1.0)
    return Markup('<span class="bar"><i style="width:{:.1f}%"></i><b>{}</b></span>').format(width, text)


def cards(several: Sequence[Card]) -> Markup:
    """Return headline numbers side by side, in rows of equal length."""
    one = Markup('<div class="card {}"><span>{}</span><strong>{}</strong><small>{}</small></div>')
    inside = join(one.format(card.tone, card.label, card.value, card.note) for card in several)
    columns = min(range(2, 5), key=lambda k: (-len(several) % k, -k))
    return Markup('<div class="cards" style="--columns:{}">{}</div>').format(columns, inside)


def picture(svg: Markup, caption: Content) -> Markup:
    """Return a drawing with its caption."""
    return Markup('<figure><div class="plot">{}</div><figcaption>{}</figcaption></figure>').format(svg, caption)


def notice(title: str, content: Markup) -> Markup:
    """Return something that must not be missed."""
    return Markup('<aside class="notice"><strong>{}</strong>{}</aside>').format(title, content)


def folded(summary: Content, content: Content) -> Markup:
    """Return something that opens on a click."""
    return Markup("<details><summary>{}</summary>{}</details>").format(summary, content)
