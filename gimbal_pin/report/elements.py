"""A section and its parts: a page shows them in one HTML file that needs nothing but a browser, a terminal as lines.

What is not `Markup` is escaped.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from tqdm import tqdm

from gimbal_pin.errors import UsageError, shortened
from gimbal_pin.log.io.files import atomic_write
from gimbal_pin.report.format import DASH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gimbal_pin.report.origin import Origin

Content = str | Markup
"""Text, or markup whose texts have been escaped; the terminal shows it without its tags."""
WIDEST = 48
"""Widest first column in a terminal; a longer sum of parameters is wrapped."""
LONGEST = 120
"""Most characters of another cell in a terminal."""
INFLATE = Markup(
    "<script>{const frame = document.currentScript.previousElementSibling,"
    " bytes = Uint8Array.from(atob(frame.dataset.deflated), letter => letter.charCodeAt(0));"
    " new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))).text()"
    ".then(page => { frame.srcdoc = page; });"
    " addEventListener('beforeprint', () => frame.closest('details')?.setAttribute('open', ''));}</script>"
)
"""Shows what lies compressed in the frame before it; what that is folded into opens for paper, to give it its size."""


@dataclass(frozen=True)
class Element:
    """A piece of a section.

    Attributes:
        html: What a page shows.
        text: What a terminal shows; of what needs a page, nothing.
        is_detail: Whether a terminal shows it only where everything is asked for.
    """

    html: Markup
    text: str = ""
    is_detail: bool = False

    def __html__(self) -> str:
        """Return it as an element of a page."""
        return self.html

    def __str__(self) -> str:
        """Return its lines."""
        return self.text


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
        heads = join(
            Markup('<th scope="col" class="{}">{}</th>').format(*pair)
            for pair in zip(kinds, self.head)
        )
        body = [
            Markup('<tr><th scope="row">{}</th>{}</tr>').format(
                filled(row[0]),
                join(
                    Markup('<td class="{}">{}</td>').format(kind, filled(x))
                    for kind, x in zip(kinds[1:], row[1:])
                ),
            )
            for row in self.rows
        ]
        inside = Markup("<table>{}<thead><tr>{}</tr></thead><tbody>{}</tbody></table>").format(
            top, heads, join(body)
        )
        label = self.caption or self.label or "Table"
        return Markup(
            '<div class="table" tabindex="0" role="region" aria-label="{}">{}</div>'
        ).format(label, inside)

    def __str__(self) -> str:
        """Return it as lines in aligned columns under its caption, long cells cut."""
        lines = [[plain(cell) for cell in row] for row in (self.head, *self.rows)]
        lines = [[first, *(shortened(cell, LONGEST) for cell in rest)] for first, *rest in lines]
        folded = []
        for first, *rest in lines:
            some, *more = wrap(first, WIDEST, break_long_words=False, break_on_hyphens=False) or [
                ""
            ]
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


@dataclass(frozen=True)
class Section:
    """One part of a page, or of what a terminal prints. A new one is a function that returns this.

    Attributes:
        title: Heading, and entry of the table of contents.
        parts: The content: a `Element`, a `Table`, a picture, or plain `Markup`, which a terminal leaves out.
        lead: A sentence under the heading that says what is seen here.
        is_detail: Whether only a page shows it, folded, and a terminal where everything is asked for.
        is_folded: Whether a page shows it folded.
    """

    title: str
    parts: Sequence[object]
    lead: str = ""
    is_detail: bool = False
    is_folded: bool = False

    @property
    def html(self) -> Markup:
        """The content as elements of a page."""
        return join(self.parts)

    def to_text(self, detailed: bool = False) -> str:
        """Return the content as lines, tables apart; `detailed`: with what is a detail."""
        lines = list[str]()
        after_table = False
        for one in self.parts:
            text = (
                ""
                if isinstance(one, Markup) or (getattr(one, "is_detail", False) and not detailed)
                else str(one)
            )
            if text:
                apart = (
                    bool(lines)
                    and (after_table or isinstance(one, Table))
                    and not text.startswith("\n")
                )
                lines += [""] * apart + [text]
                after_table = isinstance(one, Table)
        return "\n".join(lines)


@dataclass(frozen=True)
class Folded:
    """Something that opens on a click; its parts are made when they are shown.

    Attributes:
        summary: What is clicked.
        parts: What opens, as a section's parts.
        is_detail: Whether a terminal shows it only where everything is asked for.
    """

    summary: Content
    parts: Sequence[object]
    is_detail: bool = True

    def __html__(self) -> str:
        """Return it as an element of a page."""
        return Markup("<details><summary>{}</summary>{}</details>").format(
            self.summary, join(self.parts)
        )

    def __str__(self) -> str:
        """Return the lines of what opens under the summary."""
        lines = Section("", self.parts).to_text(detailed=True)
        return f"\n{plain(self.summary)}\n{lines}" if lines else ""


@dataclass(frozen=True)
class Document:
    """Sections under a title, one list for terminal, page and notebook; those without parts are left out.

    `origin`: where it comes from, which a page alone says.
    `scene`: returns its animation, a `view.Animation`, and writes it where a path is given; None: nothing moves.
    """

    title: str
    subtitle: str
    sections: Sequence[Section]
    origin: Origin | None = None
    scene: Callable[[str | Path | None], object] | None = None

    def to_text(self, detailed: bool = False) -> str:
        """Return what a terminal shows; `detailed`: with what is a detail."""
        return join_text((one for one in self.sections if detailed or not one.is_detail), detailed)

    def to_html(self) -> str:
        """Return it as a page of HTML: no script or picture from elsewhere, every text escaped."""
        return self._fill("report.html.j2", self.sections)

    def to_inline_html(self) -> str:
        """Return the sections that are no details as an element of another page, such as a notebook."""
        return self._fill("inline.html.j2", [one for one in self.sections if not one.is_detail])

    def _fill(self, name: str, sections: Sequence[Section]) -> str:
        """Return a template filled with sections."""
        bar = tqdm(sections, desc="report", unit="section", disable=None, leave=False)
        drawn = [
            (one.title, one.lead, one.html, one.is_detail or one.is_folded)
            for one in bar
            if one.parts
        ]
        has_charts = any('<div class="charts"' in html for _, _, html, _ in drawn)
        values = {
            "title": self.title,
            "subtitle": self.subtitle,
            "sections": drawn,
            "origin": self.origin,
        }
        return template("gimbal_pin.report", name, **values, has_charts=has_charts, load=load_file)

    def write(self, path: str | Path) -> None:
        """Write the page, whole or not at all."""
        atomic_write(path, self.to_html())

    def animate(self, path: str | Path | None) -> object:
        """Return its animation, and write it where a path is given; `UsageError` where nothing moves."""
        if self.scene is None:
            raise UsageError(
                "animate",
                f"has nothing that moves of {self.title}",
                "give animate() a log and a rig",
            )
        return self.scene(path)

    def draw(self) -> Figure:
        """Return the first drawing, folded ones last, as a figure of Matplotlib; `UsageError` where there is none."""
        parts = [part for one in self.sections for part in one.parts]
        for part in [*parts, *unfold(parts)]:
            if draw := getattr(part, "draw", None):
                figure: Figure = draw()
                return figure
        raise UsageError(
            "plot", f"has nothing to draw of {self.title}", "what it holds is in to_frame()"
        )


def join_documents(several: Sequence[Document]) -> Document:
    """Return documents as one under the first one's title: sections of a title once, details last."""
    every = {section.title: section for one in several for section in one.sections}
    sections = sorted(every.values(), key=lambda one: one.is_detail)
    return replace(several[0], sections=sections)


@dataclass(frozen=True)
class Card:
    """One headline number.

    Attributes:
        label: What it is.
        value: The number with its unit.
        note: A line below.
        tone: "good", "fair" or "poor", which colours it and is never the only sign of what it says; or nothing.
        is_headline: Whether it stands in `auto`'s few lines.
    """

    label: str
    value: str
    note: str = ""
    tone: str = ""
    is_headline: bool = True


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


def join_text(sections: Iterable[Section], detailed: bool = False) -> str:
    """Return sections as a terminal shows them; `detailed`: with what is a detail."""
    return "\n\n".join(filter(None, (one.to_text(detailed) for one in sections)))


def load_file(name: str) -> str:
    """Return the text of a file that lies beside this module."""
    return files("gimbal_pin.report").joinpath(name).read_text(encoding="utf-8")


def template(package: str, name: str, **values: Any) -> str:
    """Return the template of a package, filled: what is put in is escaped unless the template calls it safe.

    Values of a page's scripts go through ``tojson``: no name in them holds a character that ends a script or begins an
    element (<, >, &, ', U+2028, U+2029).
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    loader = FunctionLoader(lambda part: files(package).joinpath(part).read_text(encoding="utf-8"))
    looks: Any = {
        "autoescape": True,
        "undefined": StrictUndefined,
        "trim_blocks": True,
        "lstrip_blocks": True,
    }
    return Environment(loader=loader, **looks).get_template(name).render(**values)


def paragraph(text: Content, kind: str = "") -> Element:
    """Return a paragraph."""
    html = (
        Markup('<p class="{}">{}</p>').format(kind, text)
        if kind
        else Markup("<p>{}</p>").format(text)
    )
    return Element(html, plain(text))


def heading(text: Content) -> Element:
    """Return a heading inside a section."""
    return Element(Markup("<h3>{}</h3>").format(text), f"\n{plain(text)}")


def bullets(items: Iterable[Content], *, is_detail: bool = False) -> Element:
    """Return a list."""
    several = list(items)
    html = Markup("<ul>{}</ul>").format(
        join(Markup("<li>{}</li>").format(item) for item in several)
    )
    return Element(html, "\n".join(f"  {plain(item)}" for item in several), is_detail)


def toned(text: Content, tone: str) -> Content:
    """Return a text marked with a tone, if there is one."""
    return Markup('<span class="{}">{}</span>').format(tone, text) if tone else text


def bar(share: float, text: str) -> Markup:
    """Return a text over a bar whose length is a share in [0, 1]."""
    width = 100 * min(max(share, 0.0), 1.0)
    return Markup('<span class="bar"><i style="width:{:.1f}%"></i><b>{}</b></span>').format(
        width, text
    )


def cards(several: Sequence[Card], *, is_detail: bool = True) -> Element:
    """Return headline numbers side by side, in rows of equal length; in a terminal below each other."""
    one = Markup('<div class="card {}"><span>{}</span><strong>{}</strong><small>{}</small></div>')
    inside = join(one.format(card.tone, card.label, card.value, card.note) for card in several)
    labels, values = (
        max(map(len, column)) for column in zip(*((card.label, card.value) for card in several))
    )
    lines = "\n".join(
        f"{one.label:<{labels}}  {one.value:<{values}}  {one.note}" for one in several
    )
    columns = min(range(2, 6), key=lambda k: (-len(several) % k, -k))
    return Element(
        Markup('<div class="cards" style="--columns:{}">{}</div>').format(columns, inside),
        f"\n{lines}",
        is_detail,
    )


def figure(svg: Markup, caption: Content, charts: object = "") -> Markup:
    """Return a drawing with its caption; `charts`, which a script draws, take its place on a screen."""
    html = Markup('<figure>{}<div class="plot">{}</div><figcaption>{}</figcaption></figure>')
    return html.format(charts, svg, caption)


def hash_clock(run: str) -> str:
    """Return what stands for a run's name in a page, where the path of a log does not belong."""
    return f"{zlib.crc32(run.encode('utf-8', 'backslashreplace')):08x}"


def embed(page: str, title: str, kind: str, clock: str) -> Markup:
    """Return a frame that shows another page, which lies compressed in this one: a scene then has a third of its bytes.

    Browsers inflate it once it is read. `clock`: name of the run that it plays, see `charts.Charts`.
    """
    packed = base64.b64encode(zlib.compress(page.encode(), 9)).decode()
    frame = Markup(
        '<iframe class="{}" title="{}" data-clock="{}" data-deflated="{}" allow="fullscreen"></iframe>'
    )
    return frame.format(kind, title, hash_clock(clock), packed) + INFLATE


def notice(title: str, content: Element) -> Element:
    """Return something that must not be missed."""
    html = Markup('<aside class="notice"><strong>{}</strong>{}</aside>').format(title, content)
    return Element(html, f"{title}\n{content}")


def folded(summary: Content, *parts: object, is_detail: bool = True) -> Folded:
    """Return something that opens on a click; in a terminal it is a detail, if nothing else is said."""
    return Folded(summary, parts, is_detail)


def unfold(parts: Iterable[object]) -> Iterator[object]:
    """Yield parts, and what is folded in them."""
    for part in parts:
        yield from unfold(part.parts) if isinstance(part, Folded) else (part,)


def list_warnings(sentences: Sequence[str]) -> list[Element]:
    """Return what speaks against taking the rest at its word, if anything does."""
    return [notice("Warning", bullets(sentences))] if sentences else []
