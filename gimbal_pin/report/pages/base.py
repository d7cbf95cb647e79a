"""A report: a list of small sections, written as one HTML file that needs nothing but a browser."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from markupsafe import Markup

from gimbal_pin.log.io.files import atomic_write
from gimbal_pin.report.view.template import filled


@dataclass(frozen=True)
class Section:
    """One part of a report. A new one is a function that returns this, from the parts in `report.html`.

    Attributes:
        title: Heading, and entry of the table of contents.
        html: The content; `Markup` says that every text in it has been escaped.
        lead: A sentence under the heading that says what is seen here.
    """

    title: str
    html: Markup
    lead: str = ""


def render(title: str, sections: Sequence[Section], subtitle: str = "") -> str:
    """Return the report as one HTML page: no script or picture from elsewhere, every text escaped."""
    entries = list(zip(anchors([section.title for section in sections]), sections))
    return filled("gimbal_pin.report.pages", "page.html.j2", title=title, subtitle=subtitle, entries=entries)


def write(title: str, sections: Sequence[Section], path: str | Path, subtitle: str = "") -> None:
    """Write what `render` returns to a file, whole or not at all.

    Raises:
        UsageError: The path cannot be written.
    """
    atomic_write(path, render(title, sections, subtitle))


def anchors(titles: Sequence[str]) -> list[str]:
    """Return a distinct name per title that an address can point to."""
    found: list[str] = []
    for title in titles:
        plain = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        others = (f"{plain}-{k}" for k in count(2))
        found.append(next(name for name in chain([plain], others) if name not in found))
    return found
